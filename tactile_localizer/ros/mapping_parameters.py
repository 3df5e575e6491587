"""Parameters of the mapping node."""

from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.subscriptions.tactile_inputs import FRAMES, SYNCHRONIZATION
from tactile_localizer.streams.coverage import SWEEP_DISTANCE_M
from tactile_localizer.streams.sweep_detector import DEFAULT_REST_S, DEFAULT_REVERSAL_M

PARAMETERS = (
    Parameter("scan_file", "", "Scan (folder) to record to; an existing one is continued", at_start=True),
    Parameter("scene_file", "", "Scene (YAML) of the recording: path or shipped file name", at_start=True),
    *SYNCHRONIZATION,
    Parameter(
        "sweep_detection",
        "off",
        "Detection of sweeps from the motion; off: services delimit them, one_way: without return motions",
        choices=("off", "both_ways", "one_way"),
    ),
    Parameter("reversal_m", DEFAULT_REVERSAL_M, "Backward travel that ends a sweep", "m", 1e-5, 1.0),
    Parameter("rest_s", DEFAULT_REST_S, "Time at rest that ends a sweep", "s", 0.1, 60.0),
    Parameter(
        "sweep_distance_m",
        SWEEP_DISTANCE_M,
        "Distance between neighbouring sweeps, for the coverage",
        "m",
        1e-5,
        1.0,
    ),
    *FRAMES,
)
