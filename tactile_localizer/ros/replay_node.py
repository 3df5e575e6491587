"""Replay node: plays a bag to a running filter, and compares what the filter did with the strain in the bag.

It starts ``ros2 bag play`` once the filter is active, waits until the filter has handled what it received,
prints the counts in one line, and ends: with status 1 if strain vectors of the bag are missing in them.
"""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosbags.highlevel import AnyReader, AnyReaderError

from tactile_localizer.errors import LiveError, ParameterError, ScanError, TactileLocalizerError
from tactile_localizer.ros.base.child_process import end_with_parent
from tactile_localizer.ros.base.executable import REJECTED
from tactile_localizer.ros.base.parameters import Parameter, Parameters

PARAMETERS = (
    Parameter("bag", "", "Bag to play"),
    Parameter("rate", 1.0, "Speed relative to the recording", "", 0.01, 100.0),
    Parameter("loop", False, "Restart at the end of the bag"),
)

_CLOCK_HZ = 200
"""Rate of ``/clock``, Hz; the default of 40 Hz is too coarse for strain at 100 Hz and more."""
_DISCOVERY_S = 3.0
"""Time for discovery, s, because ``ros2 bag play`` does not wait for subscribers; 2 s were too short on two
cores at a load of 8."""
_TIMEOUT_S = 60.0
"""Longest time without diagnostics of the filter after the end of the bag, s."""

_WITHOUT_POSTERIOR = {
    "gaps": "without a pose",
    "waiting": "waiting for a pose at the end",
    "unusable": "without a phalanx with status OK",
    "rejected": "not finite",
    "invalid_strain": "invalid",
    "earlier": "before a reset",
    "skipped": "skipped",
}
"""Diagnostics of the filter that count strain vectors without a posterior."""


class ReplayNode(Node):
    """Plays a bag, and follows the diagnostics of the filter in its namespace."""

    def __init__(self) -> None:
        super().__init__("replay")
        parameters = Parameters(self, PARAMETERS, lambda: False)
        self._bag = Path(parameters["bag"]).expanduser()
        self._rate, self._loops = parameters["rate"], parameters["loop"]
        if not parameters["bag"] or not self._bag.exists():
            raise ParameterError(f"bag: expected an existing bag, got {parameters['bag']!r}")
        self._strain, pose = self.resolve_topic_name("strain"), self.resolve_topic_name("palm_pose")
        seed = self.resolve_topic_name("filter/initial_pose")
        self._topics = [self._strain, pose, seed, "/tf", "/tf_static"]
        self._counts: list[dict[str, int]] = []
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def play(self) -> str:
        """Play the bag; returns the counts of the filter in words.

        Raises
        ------
        TactileLocalizerError
            The bag cannot be played, or strain vectors are missing in the counts of the filter.
        """
        expected = strain_vectors(self._bag, self._strain)
        if not expected:
            raise ScanError(f"{self._bag}: expected strain on {self._strain}, found none")
        while not self._counts:  # until the filter is active
            rclpy.spin_once(self, timeout_sec=0.1)
        command = [
            "ros2",
            "bag",
            "play",
            str(self._bag),
            "--clock",
            str(_CLOCK_HZ),
            "--rate",
            str(self._rate),
        ]
        command += ["--delay", str(_DISCOVERY_S), *(["--loop"] if self._loops else [])]
        try:
            player = subprocess.Popen(
                [*command, "--topics", *self._topics],
                preexec_fn=end_with_parent,  # noqa: PLW1509 - one system call, no lock
            )
        except OSError as error:
            raise LiveError(f"ros2 bag play: expected it to be installed, {error.strerror}") from None
        while player.poll() is None:
            rclpy.spin_once(self, timeout_sec=0.1)
        if player.returncode:
            raise LiveError(f"ros2 bag play ended with status {player.returncode}")
        self._wait_for_the_filter()
        return describe(self._counts[-1], expected)

    def _wait_for_the_filter(self) -> None:
        """Wait until two diagnostics after the end of the bag have the same counts."""
        self._counts.clear()
        deadline = time.monotonic() + _TIMEOUT_S
        while len(self._counts) < 2 or self._counts[-1] != self._counts[-2]:
            rclpy.spin_once(self, timeout_sec=0.1)
            if time.monotonic() > deadline:
                raise LiveError(f"filter: expected diagnostics within {_TIMEOUT_S:g} s, received none")

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        name = f"{self.get_namespace()}/filter: inputs".lstrip("/")
        for status in message.status:
            if status.name == name:
                values = {entry.key: entry.value for entry in status.values}
                self._counts.append(
                    {key: int(values[key]) for key in ("updated", "moved", *_WITHOUT_POSTERIOR)}
                )


def strain_vectors(bag: Path, topic: str) -> int:
    """Number of messages on a topic of a bag.

    Raises
    ------
    ScanError
        The bag cannot be read.
    """
    try:
        with AnyReader([bag]) as reader:
            return sum(one.msgcount for one in reader.connections if one.topic == topic)
    except (AnyReaderError, OSError) as error:
        raise ScanError(f"{bag}: expected a bag, {error}") from None


def describe(counts: dict[str, int], expected: int) -> str:
    """What became of the strain vectors of a bag, in one line.

    Raises
    ------
    LiveError
        Strain vectors of the bag are missing in ``counts``; the message is that line.
    """
    posteriors = counts["updated"] + counts["moved"]
    others = {text: counts[key] for key, text in _WITHOUT_POSTERIOR.items() if counts[key]}
    lost = expected - posteriors - sum(others.values())
    parts = [f"{posteriors} posteriors", *(f"{count} {text}" for text, count in others.items())]
    line = f"the bag has ended: {expected} strain vectors, {', '.join(parts)}, {lost} lost"
    if lost or not posteriors:
        raise LiveError(line)
    return line


def main() -> int:
    """Run the node; returns the exit status."""
    rclpy.init()
    log = rclpy.logging.get_logger("replay")
    try:
        log.info(ReplayNode().play())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except TactileLocalizerError as error:
        log.error(str(error))
        return REJECTED if isinstance(error, ParameterError) else 1
    finally:
        rclpy.try_shutdown()
    return 0
