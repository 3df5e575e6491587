"""Explanations of what is felt, their probabilities, and convergence."""
