"""Bayes filters: given log-likelihoods, they own no measurement model."""
