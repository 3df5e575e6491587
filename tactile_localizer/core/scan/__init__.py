"""The training scan: pairs of palm position and strain vector, grouped in sweeps."""
