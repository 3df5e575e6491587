"""Evaluation of many methods on simulated and recorded conditions."""
