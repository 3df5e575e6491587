"""Measurement models: maps of the expected strain, and likelihoods of strains on them."""
