"""Parameters of the simulator node."""

from __future__ import annotations

from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.sweep import RATE_HZ, SPEED_MPS

MODES = {"scan": "train", "localize": "test"}
"""Kind of the simulated sweeps, by mode."""

PARAMETERS = (
    Parameter("feature", "bump", "What lies in the material", choices=FEATURES),
    Parameter("seed", 1, "Seed of everything random", lower=0),
    Parameter(
        "mode",
        "scan",
        "Next sweeps: to train (fixtured material), or to localize (hanging material, unknown starts)",
        choices=tuple(MODES),
        live=True,
    ),
    Parameter("speed", 1.0, "Simulated seconds in a second; every rate grows by it", "", 0.01, 100.0),
    Parameter("sweep_speed_mps", SPEED_MPS, "Speed of the palm in a sweep, simulated", "m/s", 1e-4, 1.0),
    Parameter("pose_rate_hz", 100.0, "Rate of the palm poses, simulated", "Hz", 0.1, 1000.0),
    Parameter("load_cell_rate_hz", RATE_HZ, "Rate of the load cells, simulated", "Hz", 0.1, 2000.0),
    Parameter("frame_id", "base_link", "Frame of the palm poses"),
    Parameter("material_frame_id", "material", "Frame of the ground truth"),
    Parameter("interface", "udp_multicast", "python-can interface of the bus"),
    Parameter("channel", "239.74.163.2", "Channel of the interface"),
    Parameter("bus_options", [], "Further options of the interface, each as name=value"),
    Parameter("dbc", "loadcells.dbc", "CAN database: a path, or a file in the package's config directory"),
    Parameter("fault.drop", 0.0, "Probability that a frame is lost", "", 0.0, 1.0, live=True),
    Parameter("fault.garbage", 0.0, "Probability of garbage after a frame", "", 0.0, 1.0, live=True),
    Parameter("fault.silent", [], "Phalanges whose load cell sends nothing", live=True),
    Parameter("fault.faulty", [], "Phalanges whose load cell reports a fault", live=True),
)
