"""Angles, motion, frames, and synchronization of palm poses with strain vectors."""
