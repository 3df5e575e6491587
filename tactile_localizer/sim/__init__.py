"""Simulation of a hand that slides along flexible material, without ROS.

:func:`simulate_scan` returns a session of sweeps as arrays, :func:`simulate_sweep` a single sweep. Constants
of the material, the hand and the load cells are chosen by judgement so that simulated scans resemble the
figures of the paper; ``test/sim/test_simulated_scan.py`` checks the resemblance.
"""

from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.scan import SimulatedScan, simulate_scan
from tactile_localizer.sim.sweep import SimulatedSweep, simulate_sweep

__all__ = ["FEATURES", "SimulatedScan", "SimulatedSweep", "simulate_scan", "simulate_sweep"]
