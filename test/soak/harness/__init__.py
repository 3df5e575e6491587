"""Soak test of the live system: injects faults into running nodes and checks what must never happen."""
