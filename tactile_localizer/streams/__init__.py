"""Streams of strain and palm poses: their stamps, frames and pairs, sweeps, coverage and plausibility."""
