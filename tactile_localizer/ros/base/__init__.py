"""Foundation of every node: lifecycle, parameters, guarded callbacks, background work."""
