"""Driver node: publishes one ``StrainVectors`` message per cycle of the load cells on a CAN bus.

Publishes ``strain`` (best effort, depth 100), ``~/tare_offset`` (latched) and ``/diagnostics`` at 1 Hz.
Services: ``~/tare`` and ``~/clear_tare``.

Strain is published from the receive thread, to avoid the latency of the executor.
"""

import os
from functools import partial
from pathlib import Path

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_srvs.srv import Trigger

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.assembler import Cycle
from tactile_localizer.io.can.bus import BusSettings, parse_options
from tactile_localizer.io.can.commands import Commands, parse_frames
from tactile_localizer.io.can.driver import STOP_TIMEOUT_S, LoadCellDriver
from tactile_localizer.io.can.protocol import protocol_of
from tactile_localizer.io.can.tare import load_tare, store_tare
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.background import run_in_thread
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.qos import LATCHED, STRAIN
from tactile_localizer.ros.conversions import fill
from tactile_localizer.ros.diagnostics.driver import DriverDiagnostics
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher
from tactile_localizer.ros.driver_parameters import PARAMETERS, messages_of


class DriverNode(ManagedNode):
    """Reads load cells on a CAN bus and publishes their strain."""

    def __init__(self) -> None:
        super().__init__("tactile_driver", PARAMETERS)
        self._driver: LoadCellDriver  # set while the node is configured
        self._declare_messages()

    def configure(self) -> None:
        """Read the DBC and the stored tare, create publishers and services."""
        self._declare_messages()  # the phalanges can have changed
        parameters = self.parameters
        phalanges = parameters["phalanges"]
        protocol = protocol_of(phalanges, {each.name: parameters[each.name] for each in parameters})
        bus = BusSettings(
            parameters["interface"],
            parameters["channel"],
            parse_options(parameters["bus_options"]),
            parameters["receive_buffer"],
            Commands(
                parse_frames(parameters["start_frames"]),
                parse_frames(parameters["stop_frames"]),
                parse_frames(parameters["sync_frame"].split()),
                parameters["sync_period_s"],
            ),
        )
        self._use_sim_time = self.get_parameter("use_sim_time").value
        self._tare_file = _tare_path(parameters["tare_file"], self.get_namespace())
        log = self.get_logger()
        self._driver = LoadCellDriver(
            protocol,
            bus,
            self._publish,
            period_s=parameters["period_s"],
            max_age_s=parameters["max_age_s"],
            log=log.warning,
            note=log.info,
        )
        self._driver.offset = load_tare(self._tare_file, phalanges, protocol.channels)
        self._health = DiagnosticsPublisher(self, str(bus))
        self._diagnostics = DriverDiagnostics(
            self._driver,
            self._health,
            parameters["stale_timeout_s"],
            lambda: self.count_publishers(self.resolve_topic_name("strain")),
        )
        self._message = StrainVectors(phalanges=phalanges, channels=protocol.channels.counts)
        self._message.header.frame_id = parameters["frame_id"]
        options = QoSOverridingOptions.with_default_policies()
        self._strain = self.create_lifecycle_publisher(
            StrainVectors, "strain", STRAIN, qos_overriding_options=options
        )
        self._offset = self.create_lifecycle_publisher(StrainVectors, "~/tare_offset", LATCHED)
        group = MutuallyExclusiveCallbackGroup()  # one tare after the other
        self.create_service(Trigger, "~/tare", self._on_tare, callback_group=group)
        self.create_service(Trigger, "~/clear_tare", self._on_clear_tare, callback_group=group)

    def activate(self) -> None:
        """Start reading; the bus is opened as soon as that is possible."""
        self.defer(self._stop_reading)
        self._driver.start()
        self._publish_offset()
        self._health.publish_each_second(self._diagnostics.statuses)

    def _stop_reading(self) -> None:
        if not self._driver.stop():
            found = f"expected its end within {STOP_TIMEOUT_S:g} s, it is still running"
            self.get_logger().error(f"CAN receive thread: {found}")

    def _declare_messages(self) -> None:
        """Declare the parameters that name the CAN messages of each phalanx."""
        self.parameters.declare(map(messages_of, self.parameters["phalanges"]))

    def _publish(self, cycle: Cycle) -> None:
        # Receive times cannot be converted to simulated time, so use the time of the node's clock.
        stamp_ns = self.now_ns if self._use_sim_time else cycle.stamp_ns
        fill(self._message, stamp_ns, cycle.strain, cycle.status, cycle.sequence)
        self._strain.publish(self._message)

    def _publish_offset(self) -> None:
        protocol = self._driver.protocol
        message = StrainVectors(phalanges=list(protocol.phalanges), channels=protocol.channels.counts)
        zeros = np.zeros(len(protocol.phalanges), np.uint32)
        fill(message, self.now_ns, self._driver.offset, zeros.astype(np.uint8), zeros)
        self._offset.publish(message)

    async def _on_tare(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Tare in a thread; diagnostics continue."""
        driver = self._active_driver()
        tare = partial(
            driver.tare,
            self.parameters["tare_duration_s"],
            self.parameters["tare_spread_limit"],
        )
        await run_in_thread(self, tare)
        return self._adopt_offset(driver, response)

    def _on_clear_tare(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        driver = self._active_driver()
        driver.offset = np.zeros_like(driver.offset)
        return self._adopt_offset(driver, response)

    def _adopt_offset(self, driver: LoadCellDriver, response: Trigger.Response) -> Trigger.Response:
        self._publish_offset()
        store_tare(self._tare_file, driver.protocol.phalanges, driver.offset, driver.protocol.channels)
        response.success = True
        response.message = f"offset of up to {np.abs(driver.offset).max():.4g} V, stored in {self._tare_file}"
        self.get_logger().info(f"Tare: {response.message}")
        return response

    def _active_driver(self) -> LoadCellDriver:
        if not self.is_active:
            raise CanError("driver: expected an active node, it is inactive")
        return self._driver


def _tare_path(name: str, namespace: str) -> Path:
    """File that stores the tare; by default one per namespace, because each hand has its own."""
    default = Path(
        os.environ.get("ROS_HOME", "~/.ros"), "tactile_localizer", namespace.lstrip("/"), "tare.yaml"
    )
    return (Path(name) if name else default).expanduser()


def main() -> int:
    """Run the node; returns the exit status."""
    return run(DriverNode)
