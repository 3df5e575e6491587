"""Transitions from, and destruction in, every state of every node."""

import signal
import subprocess
import sys
import threading

import pytest
from lifecycle_msgs.srv import GetState
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from support.waiting import wait_until

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
PATHS = {
    "driver": "dbc",
    "mapping": "scene_file",
    "filter": "scan_file",
    "simulator": "dbc",
    "adapter": "adapter_file",
}
"""A parameter of each node that names a required file."""


@pytest.fixture
def bus():
    """Parameters of a bus inside this process."""
    return {"interface": "virtual", "channel": "lifecycle"}


@pytest.fixture(params=PATHS)
def make(request, valid, construct):
    """Function that constructs the node, with valid parameters, in place of the last one."""

    def make(*transitions):
        node = construct(request.param, {**valid[request.param], "allow_remote_configuration": True})
        for transition in transitions:
            trigger(node, transition)
        return node

    return make


def state_of(node):
    for service in node.services:
        if service.srv_type is GetState:
            response = service.callback(GetState.Request(), GetState.Response())
            return response.current_state.label
    raise AssertionError("expected a service for the state")


def trigger(node, transition):
    return getattr(node, f"trigger_{transition}")()


def is_rejected(node, transition):
    """Whether the transition is invalid: Jazzy's rclpy raises an error, that of Kilted returns one."""
    try:
        return trigger(node, transition) == TransitionCallbackReturn.ERROR
    except RuntimeError:
        return True


@pytest.mark.parametrize("state", WAYS)
def test_each_transition_from_each_state(make, state):
    node = make(*WAYS[state])
    assert state_of(node) == state
    for transition in TRANSITIONS:
        if (state, transition) not in VALID:
            assert is_rejected(node, transition)
            assert state_of(node) == state
    for transition in TRANSITIONS:
        if (state, transition) in VALID:
            node = make(*WAYS[state])
            assert not is_rejected(node, transition)
            assert state_of(node) == VALID[state, transition]


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
    node = make()
    right = node.get_parameter(PATHS[node.get_name().removeprefix("tactile_")])
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
import os, sys, time
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode

class Interrupted(ManagedNode):
    def activate(self):
        self.create_timer(0.01, self.work)

    def work(self):
        os.kill(os.getpid(), int(sys.argv[1]))
        time.sleep(0.3)
        print("whole")

sys.exit(run(lambda: Interrupted("interrupted")))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lets_the_callback_finish(number):
    command = [sys.executable, "-c", INTERRUPTED, str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "whole\n", "")
