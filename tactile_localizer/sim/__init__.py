"""A simulated hand on simulated flexible material; never imports rclpy.

:func:`simulate_scan` gives a whole session of sweeps as arrays, :func:`simulate_sweep` one of them.
"""

from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.scan import SimulatedScan, simulate_scan
from tactile_localizer.sim.sweep import SimulatedSweep, simulate_sweep

__all__ = ["FEATURES", "SimulatedScan", "SimulatedSweep", "simulate_scan", "simulate_sweep"]
