"""Whether the map explains what is felt, and whether the position has converged."""
