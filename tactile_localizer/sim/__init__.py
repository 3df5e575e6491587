"""Simulation of a hand that slides along flexible material, without ROS.

:func:`simulate_recording` returns the sweeps of a session, :func:`simulate_scan` the pairs of a training
session, :func:`simulate_sweep` a single sweep. Constants of the material, the hand and the load cells are
chosen by judgement so that simulated scans resemble the figures of the paper;
``test/sim/test_simulated_scan.py`` checks the resemblance.
"""

from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.scan import shipped_scene, simulate_recording, simulate_scan
from tactile_localizer.sim.sweep import simulate_sweep

__all__ = ["FEATURES", "shipped_scene", "simulate_recording", "simulate_scan", "simulate_sweep"]
