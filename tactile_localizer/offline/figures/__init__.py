"""Matplotlib figures of scans, replays and evaluations."""
