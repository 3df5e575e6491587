"""Evaluation of kernel sums, for the paper's measurement models."""

EVALUATIONS = ("field", "truncated", "exact")
"""Ways to evaluate the sums (docs/numerics.md)."""
