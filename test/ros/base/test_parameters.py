"""Parameters of the nodes."""

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter

by_node = pytest.mark.parametrize("node", ["adapter", "driver", "filter", "mapping", "simulator"])


@by_node
def test_all_parameters_have_values_and_descriptions(construct, node):
    made = construct(node, {})
    names = made.list_parameters([], 0).names
    assert len(names) > 3
    assert all(one.type_ != one.Type.NOT_SET for one in made.get_parameters(names))
    of_rclpy = ("use_sim_time", "start_type_description_service", "qos_overrides.")
    for one in made.describe_parameters([name for name in names if not name.startswith(of_rclpy)]):
        assert len(one.description) > 10, one.name
        assert bool(one.integer_range) == (one.type == ParameterType.PARAMETER_INTEGER), one.name
        assert bool(one.floating_point_range) == (one.type == ParameterType.PARAMETER_DOUBLE), one.name
        assert one.description.endswith(" [s]") == one.name.endswith("_s"), one.name


@by_node
@pytest.mark.parametrize("allowed", [False, True])
def test_files_devices_and_code_are_given_at_the_start(construct, node, allowed):
    """Any participant of the domain can set parameters."""
    made = construct(node, {"allow_remote_configuration": allowed})
    names = made.list_parameters([], 0).names
    descriptors = made.describe_parameters(names)
    at_start = {one.name for one in descriptors if "given at the start" in one.additional_constraints}
    named = {one for one in names if one.endswith(("_file", "_directory", "_frames"))}
    named |= {"dbc", "interface", "channel", "bus_options", "model", "sync_frame"} & {*names}
    assert at_start == named | {"allow_remote_configuration"}
    for one in named:
        value = ["a=b"] if one.endswith("s") else "os:system"
        (answer,) = made.set_parameters([Parameter(one, value=value)])
        assert answer.successful == allowed, answer.reason
        assert allowed or answer.reason.startswith(f"{one}: expected it at the start of the node")
    (answer,) = made.set_parameters([Parameter("allow_remote_configuration", value=not allowed)])
    assert not answer.successful


def test_an_unknown_parameter_is_reported_with_a_near_match(node_process, bus):
    qos = {"qos_overrides./strain.publisher.reliability": "reliable"}
    driver = node_process("driver_node", {**bus, **qos, "periods": 0.1, "colour": "red"})
    driver.wait_for_line("parameter periods .did you mean period_s")
    driver.wait_for_line("parameter colour: .*ignored")
    assert driver.output.count("ignored") == 2


def test_values_that_do_not_change_can_be_set_at_any_time(node_process, probe):
    """As ``ros2 param load`` does with all values of a dump."""
    node_process("adapter_node")
    names = ["adapter_file", "frame_id", "autostart"]
    values = probe.call(
        GetParameters, "tactile_adapter/get_parameters", GetParameters.Request(names=names)
    ).values
    dump = [ParameterMessage(name=name, value=value) for name, value in zip(names, values, strict=True)]
    answer = probe.call(
        SetParameters, "tactile_adapter/set_parameters", SetParameters.Request(parameters=dump)
    )
    assert [result.successful for result in answer.results] == [True] * 3
    dump[1].value.string_value = "wrist"
    answer = probe.call(
        SetParameters, "tactile_adapter/set_parameters", SetParameters.Request(parameters=dump)
    )
    assert [result.successful for result in answer.results] == [True, False, True]
