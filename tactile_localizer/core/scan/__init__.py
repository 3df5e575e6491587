"""The training scan: pairs of palm position and strain, in sweeps."""
