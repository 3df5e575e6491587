"""Evaluation of kernel sums, for the paper's measurement models."""

EVALUATIONS = ("field", "truncated", "exact")
"""Methods of evaluation (docs/numerics.md)."""

PRECISIONS = ("float64", "float32")
"""Types of the strains in memory."""
