"""Demonstration of the whole system: runs the nodes as processes, records them and shows the result."""
