"""Parameters that are learned from a scan."""
