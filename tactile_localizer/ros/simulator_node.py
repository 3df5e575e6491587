"""Simulator node: a simulated hand that publishes palm poses and sends load cell frames on a CAN bus.

Between sweeps the fingers are open. ``~/prepare`` moves the palm to the start of the next sweep and closes
the fingers; ``~/sweep`` starts the motion. After a sweep the fingers stay closed until the next sweep is
prepared, so that a recorder has time to stop.
"""

import threading
import time

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from tactile_localizer.errors import CanError, LiveError
from tactile_localizer.io.can.bus import BusSettings, open_bus, parse_options
from tactile_localizer.io.can.protocol import protocol_of
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.background import run_in_thread
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.base.qos import LATCHED, STRAIN
from tactile_localizer.ros.conversions import from_ns
from tactile_localizer.sim.can_cells import CanLoadCells, Faults
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.material import FEATURES
from tactile_localizer.sim.noise import child
from tactile_localizer.sim.rig import Phase, Reading, Rig
from tactile_localizer.sim.sweep import RATE_HZ, SPEED_MPS

MODES = {"scan": "train", "localize": "test"}
"""Kind of the simulated sweeps, by mode."""

PARAMETERS = (
    Parameter("feature", "bump", "Feature in the simulated material", choices=FEATURES),
    Parameter("seed", 1, "Seed of all random numbers", "", 0, 2**31 - 1),
    Parameter(
        "mode",
        "scan",
        "Next sweeps: scan (training, fixtured material) or localize (hanging material, unknown start)",
        choices=tuple(MODES),
        live=True,
    ),
    Parameter(
        "speed", 1.0, "Simulated seconds per real second; scales all rates", "", 0.01, 100.0, live=True
    ),
    Parameter("pose_rate_hz", 100.0, "Rate of the palm poses, in simulated time", "Hz", 0.1, 1000.0),
    Parameter("load_cell_rate_hz", RATE_HZ, "Rate of the load cells, in simulated time", "Hz", 0.1, 2000.0),
    Parameter("frame_id", "base_link", "Frame of the palm poses"),
    Parameter("material_frame_id", "material", "Frame of the ground truth"),
    Parameter("interface", "udp_multicast", "python-can interface of the CAN bus", at_start=True),
    Parameter("channel", "239.74.163.2", "Channel of the interface", at_start=True),
    Parameter(
        "bus_options",
        [],
        "Options of the interface, such as ['port=43114']",
        at_start=True,
    ),
    Parameter("dbc", "loadcells.dbc", "CAN database (DBC): path or shipped file name", at_start=True),
    Parameter("fault.drop", 0.0, "Probability that a frame is lost", "", 0.0, 1.0, live=True),
    Parameter("fault.garbage", 0.0, "Probability of garbage after each frame", "", 0.0, 1.0, live=True),
    Parameter("fault.silent", [], "Phalanges whose load cell sends no frames", choices=PHALANGES, live=True),
)


_CELL_PHASE = 0.37
"""Delay of the load cells relative to the poses, in load cell periods."""
_BUS_NOISE = 5 << 30
_MOST_UNPUBLISHED = 32
"""Most cycles in the queue of the driver, a tenth of what it holds."""
_PATIENCE_S = 5.0
"""Time in which a driver publishes the cycles in its queue, s, else they are lost; a busy machine holds it up
for 1 s."""
_DEPTH = 1000
"""Poses that are kept for a reliable subscriber that a busy machine holds up."""
_POLL_S = 0.001
_PUNCTUAL = 0.25
"""Most lateness of a pose or a sample, in load cell periods; during more than that the hand stands still."""


class SimulatorNode(ManagedNode):
    """Runs a :class:`~tactile_localizer.sim.rig.Rig` in a thread that paces and publishes its readings."""

    def __init__(self) -> None:
        super().__init__("tactile_simulator", PARAMETERS)
        self._stop = threading.Event()
        self._lock = threading.Lock()

    def configure(self) -> None:
        """Create the rig, publishers and services, and open the bus."""
        parameters, seed = self.parameters, self.parameters["seed"]
        self._time_s = 0.0  # simulated; stands still while the node is inactive
        self._rig = Rig(parameters["feature"], seed, SPEED_MPS, parameters["load_cell_rate_hz"])
        protocol = protocol_of(PHALANGES, {"dbc": parameters["dbc"]})
        options = parse_options(parameters["bus_options"])
        bus = open_bus(BusSettings(parameters["interface"], parameters["channel"], options), protocol)
        self.defer(bus.shutdown)
        self._cells = CanLoadCells(protocol, bus, child(seed, _BUS_NOISE))
        self._pose = self.create_lifecycle_publisher(PoseStamped, "palm_pose", _DEPTH)
        self._truth = self.create_lifecycle_publisher(PoseStamped, "~/ground_truth", _DEPTH)
        self._active = self.create_lifecycle_publisher(Bool, "~/sweep_active", LATCHED)
        group = MutuallyExclusiveCallbackGroup()  # one motion after the other, while strain is counted
        self.create_service(Trigger, "~/prepare", self._on_prepare, callback_group=group)
        self.create_service(Trigger, "~/sweep", self._on_sweep, callback_group=group)

    def activate(self) -> None:
        """Start simulated time."""
        self._sent = self._published = self._ignored = self._pose_ns = 0
        self._published_before, self._until_s = 0, 0.0
        self.create_subscription(StrainVectors, "strain", self._on_strain, STRAIN, raw=True)
        self._stop.clear()
        thread = threading.Thread(target=self._publish_until_stopped, name="simulated hand", daemon=True)
        thread.start()
        self.defer(thread.join)
        self.defer(self._stop.set)

    def _publish_until_stopped(self) -> None:
        """Read the rig at the times of poses and samples, none of which is left out.

        When this process or the driver is late, simulated time stands still, and so does the palm: it has
        one pose when it was due, and the same pose now.
        """
        pose_period_s = 1 / self.parameters["pose_rate_hz"]
        cell_period_s = 1 / self.parameters["load_cell_rate_hz"]
        pose_s, cell_s = self._time_s, self._time_s + _CELL_PHASE * cell_period_s
        due_s, active = time.monotonic(), None
        while True:
            now_s, speed = min(pose_s, cell_s), self.parameters["speed"]
            due_s += (now_s - self._time_s) / speed
            if self._stop.wait(max(0.0, due_s - time.monotonic())):
                return
            late_s, stamp_ns = time.monotonic() - due_s, self.now_ns
            is_late = late_s > _PUNCTUAL * cell_period_s / speed
            with self._lock:
                self._time_s = now_s
                reading = self._rig.read(now_s)
            if is_late:
                self._publish(reading, stamp_ns - round(late_s * 1e9))
                due_s += late_s
            if is_late or now_s == pose_s:
                self._publish(reading, stamp_ns)
            if now_s == cell_s:
                self._send(reading)
                self._wait_for_driver()
                cell_s += cell_period_s
            if now_s == pose_s:
                pose_s += pose_period_s
            if active != (reading.phase is Phase.SWEEPING):
                active = reading.phase is Phase.SWEEPING
                self._active.publish(Bool(data=active))

    def _on_strain(self, message: bytes) -> None:
        self._published += 1

    def _wait_for_driver(self) -> None:
        """Wait until a driver has published most cycles that were sent, if it publishes any.

        A driver that lost some, as while it was stopped, publishes the newest one much later, as nothing
        follows it. So the patience is for as many cycles as its queue holds, not for the next one.
        """
        self._sent = max(self._sent + 1, self._published)
        if self._sent - self._published <= _MOST_UNPUBLISHED:
            self._published_before = self._published - _MOST_UNPUBLISHED
        while self._published != self._ignored and self._sent - self._published > _MOST_UNPUBLISHED:
            if self._published - self._published_before >= _MOST_UNPUBLISHED:
                self._published_before, self._until_s = self._published, time.monotonic() + _PATIENCE_S
            if time.monotonic() > self._until_s:
                self._ignored = self._published
            if self._stop.wait(_POLL_S):
                return
        if self._published == self._ignored:
            self._sent = self._published

    def _send(self, reading: Reading) -> None:
        faults = Faults(*(self.parameters[f"fault.{name}"] for name in ("drop", "garbage", "silent")))
        try:
            self._cells.send(reading.strain, faults)
        except CanError as error:
            self.get_logger().error(str(error), throttle_duration_sec=1.0)

    def _publish(self, reading: Reading, stamp_ns: int) -> None:
        self._pose_ns = max(stamp_ns, self._pose_ns + 1)
        stamp = from_ns(self._pose_ns)
        self._pose.publish(_pose(stamp, self.parameters["frame_id"], reading.odometry))
        if reading.truth is not None:
            self._truth.publish(_pose(stamp, self.parameters["material_frame_id"], reading.truth))

    async def _on_prepare(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Respond when the fingers are closed at the start of the next sweep."""
        with self._lock:
            reading = self._rig.read(self._time_s)
            if reading.phase is Phase.SWEEPING:
                raise LiveError("expected a hand at rest, it is sweeping")
            sweep = self._rig.prepare(MODES[self.parameters["mode"]], self._time_s)
            self._number = sweep.number
        await run_in_thread(self, self._wait_until_ready)
        return self._respond(response)

    def _wait_until_ready(self) -> None:
        while (left_s := self._rig.ready_s - self._time_s) > 0:
            if self._stop.wait(left_s / self.parameters["speed"]):
                return

    async def _on_sweep(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Respond when the palm starts to move; prepare the sweep first if it is not prepared."""
        with self._lock:
            phase = self._rig.read(self._time_s).phase
        if phase is not Phase.READY:
            await self._on_prepare(request, response)
        with self._lock:
            self._rig.start(self._time_s)
        return self._respond(response)

    def _respond(self, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, f"{self.parameters['mode']}: sweep {self._number}"
        return response


def _pose(stamp: Time, frame_id: str, position: np.ndarray) -> PoseStamped:
    message = PoseStamped()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    message.pose.position.x, message.pose.position.y = map(float, position)
    return message


def main() -> int:
    """Run the node; returns the exit status."""
    return run(SimulatorNode)
