"""Declared parameters of each node: name, default, description, unit, range."""
