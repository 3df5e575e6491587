"""Scans as folders: writing and reading, recording of sweeps, import, calibration."""
