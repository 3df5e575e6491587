"""Parameters of the nodes, accessed through their services."""

from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.ros


by_node = pytest.mark.parametrize("node", ["adapter", "driver", "filter", "mapping", "simulator"])


@by_node
def test_all_parameters_have_values_and_descriptions(
    node_process: Callable[..., Any], probe: Any, node: str
) -> None:
    from rcl_interfaces.msg import ParameterType
    from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters

    node_process(f"{node}_node", {"autostart": False})
    names = probe.call(ListParameters, f"tactile_{node}/list_parameters").result.names
    values = probe.call(
        GetParameters, f"tactile_{node}/get_parameters", GetParameters.Request(names=names)
    ).values
    assert len(values) == len(names) > 3
    assert all(value.type != ParameterType.PARAMETER_NOT_SET for value in values)
    of_rclpy = ("use_sim_time", "start_type_description_service", "qos_overrides.")
    own = DescribeParameters.Request(names=[name for name in names if not name.startswith(of_rclpy)])
    for one in probe.call(DescribeParameters, f"tactile_{node}/describe_parameters", own).descriptors:
        assert len(one.description) > 10, one.name
        assert bool(one.integer_range) == (one.type == ParameterType.PARAMETER_INTEGER), one.name
        assert bool(one.floating_point_range) == (one.type == ParameterType.PARAMETER_DOUBLE), one.name
        assert one.description.endswith(" [s]") == one.name.endswith("_s"), one.name


@by_node
@pytest.mark.parametrize("allowed", [False, True])
def test_files_devices_and_code_are_given_at_the_start(
    node_process: Callable[..., Any], probe: Any, node: str, allowed: bool
) -> None:
    """Any participant of the domain can set parameters."""
    from rcl_interfaces.srv import DescribeParameters, ListParameters

    node_process(f"{node}_node", {"autostart": False, "allow_remote_configuration": allowed})
    name = f"tactile_{node}"
    names = probe.call(ListParameters, f"{name}/list_parameters").result.names
    request = DescribeParameters.Request(names=names)
    descriptors = probe.call(DescribeParameters, f"{name}/describe_parameters", request).descriptors
    at_start = {one.name for one in descriptors if "given at the start" in one.additional_constraints}
    named = {one for one in names if one.endswith(("_file", "_directory", "_frames"))}
    named |= {"dbc", "interface", "channel", "bus_options", "model", "sync_frame"} & {*names}
    assert at_start == named | {"allow_remote_configuration"}
    for one in named:
        answer = probe.set_parameter(name, one, ["a=b"] if one.endswith("s") else "os:system")
        assert answer.successful == allowed, answer.reason
        assert allowed or answer.reason.startswith(f"{one}: expected it at the start of the node")
    assert not probe.set_parameter(name, "allow_remote_configuration", not allowed).successful


def test_an_unknown_parameter_is_reported_with_a_near_match(
    node_process: Callable[..., Any], bus: dict[str, Any]
) -> None:
    qos = {"qos_overrides./strain.publisher.reliability": "reliable"}
    driver = node_process("driver_node", {**bus, **qos, "periods": 0.1, "colour": "red"})
    driver.wait_for_line("parameter periods .did you mean period_s")
    driver.wait_for_line("parameter colour: .*ignored")
    assert driver.output.count("ignored") == 2


def test_values_that_do_not_change_can_be_set_at_any_time(
    node_process: Callable[..., Any], probe: Any
) -> None:
    """As ``ros2 param load`` does with all values of a dump."""
    from rcl_interfaces.msg import Parameter
    from rcl_interfaces.srv import GetParameters, SetParameters

    node_process("adapter_node")
    names = ["adapter_file", "frame_id", "autostart"]
    values = probe.call(
        GetParameters, "tactile_adapter/get_parameters", GetParameters.Request(names=names)
    ).values
    dump = [Parameter(name=name, value=value) for name, value in zip(names, values, strict=True)]
    answer = probe.call(
        SetParameters, "tactile_adapter/set_parameters", SetParameters.Request(parameters=dump)
    )
    assert [result.successful for result in answer.results] == [True] * 3
    dump[1].value.string_value = "wrist"
    answer = probe.call(
        SetParameters, "tactile_adapter/set_parameters", SetParameters.Request(parameters=dump)
    )
    assert [result.successful for result in answer.results] == [True, False, True]
