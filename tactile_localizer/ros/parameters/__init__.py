"""Parameters of each node."""
