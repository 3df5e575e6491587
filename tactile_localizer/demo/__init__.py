"""The demonstration: all nodes scan a simulated feature, then localize new sweeps on the scan."""
