"""Parameters of the driver node."""

from tactile_localizer.io.can.layout import GAUGE_SIGNALS
from tactile_localizer.ros.base.parameters import Parameter

PARAMETERS = (
    Parameter("phalanges", ["index", "middle"], "Names of the load cells, in the order of the strain vector"),
    Parameter("dbc", "loadcells.dbc", "CAN database (DBC): path or shipped file name", at_start=True),
    Parameter(
        "gauge_signals",
        list(GAUGE_SIGNALS),
        "DBC signals of a phalanx's channels, in order, each SIGNAL or MESSAGE.SIGNAL; "
        "{phalanx} is replaced by its name",
    ),
    Parameter("counter_signal", "counter", "DBC signal of the rolling counter, if the DBC has one"),
    Parameter("status_signal", "status", "DBC signal of the load cell status, if the DBC has one"),
    Parameter("status_ok", [0], "Values of the status without a fault"),
    Parameter("interface", "socketcan", "python-can interface of the CAN bus", at_start=True),
    Parameter("channel", "can0", "Channel of the interface", at_start=True),
    Parameter("bus_options", [], "Options of the interface, such as ['fd=true']", at_start=True),
    Parameter(
        "receive_buffer", 1 << 20, "Receive buffer of the kernel; 0 for its default", "byte", 0, 1 << 28
    ),
    Parameter(
        "start_frames",
        [],
        "Frames that start the load cells, such as ['064#0B']; sent while one is silent",
        at_start=True,
    ),
    Parameter(
        "stop_frames", [], "Frames that stop the load cells, sent when the node is deactivated", at_start=True
    ),
    Parameter(
        "sync_frame",
        "",
        "Frames that synchronize or poll the load cells, such as '080#' or '181#R 182#R'",
        at_start=True,
    ),
    Parameter("sync_period_s", 0.01, "Period at which sync_frame is sent", "s", 0.0005, 10.0),
    Parameter(
        "period_s",
        0.0,
        "Longest period of load cells that send irregularly. 0: estimated, for all others",
        "s",
        0.0,
        1.0,
    ),
    Parameter(
        "stale_timeout_s",
        0.5,
        "Time without frames after which a phalanx is reported as stale",
        "s",
        0.01,
        60.0,
    ),
    Parameter(
        "max_age_s",
        0.2,
        "Age from which frames that were read late are discarded",
        "s",
        0.01,
        60.0,
    ),
    Parameter("tare_duration_s", 1.0, "Averaging time of ~/tare", "s", 0.05, 10.0, live=True),
    Parameter(
        "tare_spread_limit",
        0.02,
        "Standard deviation of a strain gauge above which ~/tare fails",
        "V",
        0.0,
        10.0,
        live=True,
    ),
    Parameter(
        "tare_file",
        "",
        "File that stores the tare; if empty, tactile_localizer/NAMESPACE/tare.yaml in ROS_HOME or ~/.ros",
        at_start=True,
    ),
    Parameter("frame_id", "palm", "Frame in the header of the strain vectors"),
)


def messages_of(phalanx: str) -> Parameter:
    """The parameter that names the CAN messages of a phalanx."""
    text = f"DBC messages of {phalanx}, as NAME or NAME@IDENTIFIER; if empty, {phalanx}, {phalanx}_a, ..."
    return Parameter(f"messages.{phalanx}", [], text)
