"""Continuous sweeps of the simulated hand during a soak test, whatever happens to the nodes."""

from __future__ import annotations

import contextlib
import threading
import time
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import Empty, Trigger

from harness.belief_watch import BeliefWatch
from harness.relay import Relay
from tactile_localizer.demo.observations import TOPICS
from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.errors import LiveError
from tactile_localizer.msg import ScanStatus

_ANSWER_S = 4.0
_LONGEST_SWEEP_S = 15.0
RECORDED_EVERY = 30
"""Number of sweeps per recorded one: a growing scan takes memory, which must not look like a leak."""


class Sweeping:
    """Lets the simulated hand sweep repeatedly, in a separate thread.

    The start of each sweep is unknown to the filter. If a node does not respond, because it was stopped on
    purpose, the sweep is abandoned and the next one begins.

    Attributes
    ----------
    done : number of completed sweeps
    pairs : number of pairs in the scan that is recorded
    """

    def __init__(self, watcher: Watcher, relay: Relay, belief: BeliefWatch) -> None:
        self.done = self.pairs = 0
        self._watcher, self._relay, self._belief = watcher, relay, belief
        self._stop = threading.Event()
        self._active: list[bool] = []
        self._is_recording = False
        kept = TOPICS["simulator/sweep_active"].quality
        watcher.listen(
            Bool, "simulator/sweep_active", kept, lambda message: self._active.append(message.data)
        )
        watcher.listen(ScanStatus, "mapping/status", TOPICS["mapping/status"].quality, self._on_status)
        self._thread = threading.Thread(target=self._sweep_on, name="sweeping", daemon=True)

    def __enter__(self) -> Sweeping:
        self._thread.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._stop.set()
        self._thread.join()

    def _on_status(self, message: ScanStatus) -> None:
        self._is_recording, self.pairs = message.sweep_active, message.samples

    def _sweep_on(self) -> None:
        number = 0
        while not self._stop.is_set():
            number += 1
            recorded = number % RECORDED_EVERY == 0
            try:
                self._sweep(recorded)
                self.done += 1
            except LiveError:
                self._stop.wait(0.2)
            self._belief.end_sweep()
            if recorded or self._is_recording:  # a stopped node may process a request seconds later
                self._end_recording()

    def _sweep(self, recorded: bool) -> None:
        # Only in the mode "scan" is the origin of the odometry known, which mapping requires.
        self._set_mode("scan" if recorded else "localize")
        self._ask("simulator/prepare")
        if recorded:
            self._ask("mapping/start_sweep")
        self._watcher.call(Empty, "filter/reinitialize_global_localization", timeout_s=_ANSWER_S)
        self._belief.begin_sweep(time.time_ns() + self._relay.clock_ns)
        self._active.clear()
        self._ask("simulator/sweep")
        deadline = time.monotonic() + _LONGEST_SWEEP_S
        while not (True in self._active and not self._active[-1]):
            if time.monotonic() > deadline:
                raise LiveError("sweep: expected it to end, it did not")
            if self._stop.wait(0.02):
                return

    def _end_recording(self) -> None:
        """End the recording, also of an abandoned sweep, so that the next sweep is not recorded."""
        while not self._stop.is_set():
            with contextlib.suppress(LiveError):
                self._watcher.call(Trigger, "mapping/end_sweep", timeout_s=_ANSWER_S)
                return

    def _set_mode(self, mode: str) -> None:
        request = SetParameters.Request(parameters=[Parameter("mode", value=mode).to_parameter_msg()])
        self._watcher.call(SetParameters, "simulator/set_parameters", request, timeout_s=_ANSWER_S)

    def _ask(self, service: str) -> None:
        answer = self._watcher.call(Trigger, service, timeout_s=_ANSWER_S)
        if not answer.success:
            raise LiveError(f"service {service}: {answer.message}")
