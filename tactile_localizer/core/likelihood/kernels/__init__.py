"""Evaluation of kernel sums, for the paper's measurement models."""
