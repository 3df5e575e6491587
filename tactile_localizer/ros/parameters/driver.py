"""Parameters of the driver node."""

from __future__ import annotations

from tactile_localizer.io.can.layout import GAUGE_SIGNALS
from tactile_localizer.ros.base.parameters import Parameter

PARAMETERS = (
    Parameter("phalanges", ["index", "middle"], "Names of the load cells, in the order of the strain vector"),
    Parameter("dbc", "loadcells.dbc", "CAN database: a path, or a file in the package's config directory"),
    Parameter(
        "gauge_signals",
        list(GAUGE_SIGNALS),
        "DBC signals of the channels, in order; {phalanx} is its name",
    ),
    Parameter("counter_signal", "counter", "DBC signal of the rolling counter, where the DBC has one"),
    Parameter(
        "status_signal", "status", "DBC signal of the load cell's status, 0 is well, where there is one"
    ),
    Parameter("interface", "socketcan", "python-can interface of the bus"),
    Parameter("channel", "can0", "Channel of the interface"),
    Parameter("bus_options", [], "Further options of the interface, each as name=value"),
    Parameter(
        "receive_buffer", 1 << 20, "Kernel's buffer for frames not read yet; 0: default", "byte", 0, 1 << 28
    ),
    Parameter("cycle_timeout_s", 0.03, "How long a cycle waits for its frames", "s", 0.0005, 1.0),
    Parameter(
        "stale_timeout_s", 0.5, "Silence after which a phalanx is stale in the diagnostics", "s", 0.01, 60.0
    ),
    Parameter(
        "reconnect_delay_s",
        0.1,
        "Wait before a failed bus is opened again, doubled after each failure; 0: only when asked to",
        "s",
        0.0,
        60.0,
    ),
    Parameter(
        "reconnect_delay_limit_s", 5.0, "Longest wait before a failed bus is opened again", "s", 0.0, 600.0
    ),
    Parameter(
        "wait_for_interface",
        False,
        "Wait for a CAN interface that is absent at activation, instead of refusing to activate",
    ),
    Parameter("tare_duration_s", 1.0, "How long ~/tare averages", "s", 0.05, 10.0, live=True),
    Parameter(
        "tare_spread_limit",
        0.02,
        "Standard deviation of a gauge above which ~/tare refuses",
        "V",
        0.0,
        10.0,
        live=True,
    ),
    Parameter(
        "tare_file",
        "",
        "Where the tare is kept; empty: tactile_localizer/NAMESPACE/tare.yaml in ROS_HOME or ~/.ros",
    ),
    Parameter("frame_id", "palm", "Frame in the header of the strain vectors"),
)


def messages_of(phalanx: str) -> Parameter:
    """The parameter that names the CAN messages of a phalanx."""
    text = f"DBC messages of {phalanx}; empty: those called {phalanx}, {phalanx}_a, ..."
    return Parameter(f"messages.{phalanx}", [], text)
