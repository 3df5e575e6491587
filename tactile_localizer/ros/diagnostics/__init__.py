"""Diagnostics of each node."""
