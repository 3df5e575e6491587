"""Parameters of the simulator node."""

from __future__ import annotations

from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.sweep import RATE_HZ, SPEED_MPS

MODES = {"scan": "train", "localize": "test"}
"""Kind of the simulated sweeps, by mode."""

PARAMETERS = (
    Parameter("feature", "bump", "Feature in the simulated material", choices=FEATURES),
    Parameter("seed", 1, "Seed of all random numbers", lower=0),
    Parameter(
        "mode",
        "scan",
        "Next sweeps: scan (training, fixtured material) or localize (hanging material, unknown start)",
        choices=tuple(MODES),
        live=True,
    ),
    Parameter("speed", 1.0, "Simulated seconds per second of real time; scales all rates", "", 0.01, 100.0),
    Parameter(
        "sweep_speed_mps", SPEED_MPS, "Speed of the palm during a sweep, in simulated time", "m/s", 1e-4, 1.0
    ),
    Parameter("pose_rate_hz", 100.0, "Rate of the palm poses, in simulated time", "Hz", 0.1, 1000.0),
    Parameter("load_cell_rate_hz", RATE_HZ, "Rate of the load cells, in simulated time", "Hz", 0.1, 2000.0),
    Parameter("frame_id", "base_link", "Frame of the palm poses"),
    Parameter("material_frame_id", "material", "Frame of the ground truth"),
    Parameter("interface", "udp_multicast", "python-can interface of the CAN bus"),
    Parameter("channel", "239.74.163.2", "Channel of the interface"),
    Parameter("bus_options", [], "Options of the interface, each as name=value"),
    Parameter("dbc", "loadcells.dbc", "CAN database (DBC): path or shipped file name"),
    Parameter("fault.drop", 0.0, "Probability that a frame is lost", "", 0.0, 1.0, live=True),
    Parameter("fault.garbage", 0.0, "Probability of garbage after each frame", "", 0.0, 1.0, live=True),
    Parameter("fault.silent", [], "Phalanges whose load cell sends no frames", live=True),
    Parameter("fault.faulty", [], "Phalanges whose load cell reports a fault", live=True),
)
