"""Scans as folders: writing and reading, recording of sweeps, import, calibration."""

FORMAT = 1
"""Version of the files of a scan, which grows where an older version of the package cannot read them."""
