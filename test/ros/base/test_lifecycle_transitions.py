"""Transitions from, and destruction in, every state of every node."""

import itertools
import subprocess
import sys
import threading

import pytest
from support.sweeps import scene_of, write_scan
from support.waiting import wait_until

from tactile_localizer.io.scene_file import save_scene

pytestmark = pytest.mark.ros

STATES = ("unconfigured", "inactive", "active", "finalized")
VALID = {
    ("unconfigured", "configure"): "inactive",
    ("unconfigured", "shutdown"): "finalized",
    ("inactive", "activate"): "active",
    ("inactive", "cleanup"): "unconfigured",
    ("inactive", "shutdown"): "finalized",
    ("active", "deactivate"): "inactive",
    ("active", "shutdown"): "finalized",
}
TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "shutdown")
WAYS = {
    "unconfigured": (),
    "inactive": ("configure",),
    "active": ("configure", "activate"),
    "finalized": ("configure", "shutdown"),
}
NODES = {
    "driver_node": "DriverNode",
    "mapping_node": "MappingNode",
    "filter_node": "FilterNode",
    "simulator_node": "SimulatorNode",
    "adapter_node": "AdapterNode",
}

PATHS = {
    "driver": "dbc",
    "mapping": "scene_file",
    "filter": "scan_file",
    "simulator": "dbc",
    "adapter": "adapter_file",
}
"""A parameter of each node that names a required file."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lifecycle")
    write_scan(folder / "bump_scan")
    save_scene(scene_of(), folder / "scene.yaml")
    return folder


@pytest.fixture(params=NODES)
def make(request, files, tmp_path):
    """Function that constructs the node, with valid parameters, in the default context."""
    import importlib

    import rclpy

    virtual = {"interface": "virtual", "channel": request.param}
    parameters = {
        "driver_node": {**virtual, "tare_file": tmp_path / "tare.yaml"},
        "mapping_node": {"scene_file": files / "scene.yaml", "scan_file": tmp_path / "bump_scan"},
        "filter_node": {"scan_file": files / "bump_scan", "cell": 2.0},
        "simulator_node": virtual,
        "adapter_node": {"adapter_file": "wrench.yaml"},
    }[request.param]
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={value}"]
    rclpy.init(args=arguments)
    module = importlib.import_module(f"tactile_localizer.ros.{request.param}")
    made = []

    def make():
        made.append(getattr(module, NODES[request.param])())
        return made[-1]

    try:
        yield make
    finally:
        for node in made:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()


def state_of(node):
    from lifecycle_msgs.srv import GetState

    for service in node.services:
        if service.srv_type is GetState:
            response = service.callback(GetState.Request(), GetState.Response())
            return response.current_state.label
    raise AssertionError("expected a service for the state")


def trigger(node, transition):
    return getattr(node, f"trigger_{transition}")()


def is_rejected(node, transition):
    """Whether the transition is invalid: Jazzy's rclpy raises an error, that of Kilted returns one."""
    from rclpy.lifecycle import TransitionCallbackReturn

    try:
        return trigger(node, transition) == TransitionCallbackReturn.ERROR
    except RuntimeError:
        return True


@pytest.mark.parametrize("state", STATES)
def test_each_transition_from_each_state(make, state):
    node = make()
    for transition in WAYS[state]:
        trigger(node, transition)
    for transition, _ in itertools.product(TRANSITIONS, range(2)):
        assert state_of(node) == state
        if (state, transition) not in VALID:
            assert is_rejected(node, transition)
            continue
        trigger(node, transition)
        assert state_of(node) == VALID[state, transition]
        if transition == "shutdown":
            node.destroy_node()
            node = make()
            for way in WAYS[state]:
                trigger(node, way)
        else:
            bring_back(node, state)


def bring_back(node, state):
    """Return to a state by valid transitions."""
    back = {
        ("inactive", "unconfigured"): ("cleanup",),
        ("active", "inactive"): ("deactivate",),
        ("unconfigured", "inactive"): ("configure",),
        ("inactive", "active"): ("activate",),
    }
    for transition in back[state_of(node), state]:
        trigger(node, transition)


def test_transitions_leave_nothing_behind(make):
    node = make()
    before = threading.active_count()

    def entities():
        return [len(list(kind)) for kind in (node.publishers, node.subscriptions, node.services, node.timers)]

    bare = entities()
    for _ in range(2):
        for transition in ("configure", "activate", "deactivate", "activate", "deactivate", "cleanup"):
            trigger(node, transition)
        assert state_of(node) == "unconfigured"
        assert entities() == bare
        wait_until(lambda: threading.active_count() <= before, "its threads to end")


def test_a_rejected_configuration_gives_its_reason(make, tmp_path, capfd):
    from rclpy.lifecycle import TransitionCallbackReturn
    from rclpy.parameter import Parameter

    node = make()
    right = node.get_parameter(PATHS[node.get_name()])
    wrong = Parameter(right.name, value=str(tmp_path / "missing"))
    node.set_parameters([wrong])
    for _ in range(2):
        assert trigger(node, "configure") == TransitionCallbackReturn.FAILURE
        assert state_of(node) == "unconfigured"
        assert wrong.value in capfd.readouterr().err
    node.set_parameters([right])
    for transition in WAYS["active"]:
        assert trigger(node, transition) == TransitionCallbackReturn.SUCCESS
        (refused,) = node.set_parameters([wrong])
        assert "expected an unconfigured node" in refused.reason


INTERRUPTED = """
import os, signal, sys, time
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode

class Interrupted(ManagedNode):
    def activate(self):
        self.create_timer(0.01, self.work)

    def work(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.3)
        print("whole")

sys.exit(run(lambda: Interrupted("interrupted")))
"""


def test_an_interrupt_lets_the_callback_finish():
    command = [sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "whole\n", "")
