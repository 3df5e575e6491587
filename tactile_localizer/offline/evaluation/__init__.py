"""Many sweeps by many methods, on simulated and recorded conditions, and what they show."""
