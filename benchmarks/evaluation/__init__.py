"""Evaluation of methods on simulated or recorded sweeps: conditions, tasks and workers, results."""
