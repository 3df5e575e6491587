"""What is learned from a scan."""
