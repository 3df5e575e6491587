"""Angles, motion, palm frames, and synchronising palm poses with strains."""
