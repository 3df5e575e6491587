"""Parameters given to a node: what it does not have is said, not swallowed."""

from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.ros


def test_a_mistyped_parameter_is_named_with_the_one_that_may_be_meant(
    node_process: Callable[..., Any], simulated_can: dict[str, Any]
) -> None:
    bus = {name: simulated_can[name] for name in ("interface", "channel")}
    bus |= {"bus_options": [f"port={simulated_can['port']}"]}
    qos = {"qos_overrides./strain.publisher.reliability": "reliable"}
    driver = node_process("driver_node", {**bus, **qos, "cycle_timeout": 0.1, "colour": "red"})
    driver.wait_for_line("parameter cycle_timeout .did you mean cycle_timeout_s")
    driver.wait_for_line("parameter colour: expected one of this node's, it is ignored")
    assert driver.output.count("it is ignored") == 2
