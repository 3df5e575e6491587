"""The layouts for RViz and Foxglove match the topics of the filter."""

import importlib
import json
import re

import pytest
import yaml
from support.probe import Probe
from support.processes import Process, node_command

from tactile_localizer.resources import resource_path

RVIZ_KINDS = {
    "rviz_default_plugins/PointCloud2": "sensor_msgs/msg/PointCloud2",
    "rviz_default_plugins/Marker": "visualization_msgs/msg/Marker",
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/PoseWithCovariance": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "rviz_default_plugins/SetInitialPose": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
SIMULATED = {"/tactile_simulator/ground_truth": "geometry_msgs/msg/PoseStamped"}


@pytest.fixture(scope="module")
def probe(scan_file):
    """A probe beside a running filter."""
    process = Process(node_command("filter_node", {"scan_file": scan_file, "cell": 2.0}))
    probe = Probe()
    try:
        yield probe
    finally:
        probe.close()
        process.kill()
        print(process.output)


@pytest.fixture(scope="module")
def topics(probe):
    """Function that waits for topics of the filter; returns all that are known by then, with their types."""

    def types(wanted):
        def known():
            return {name: kinds[0] for name, kinds in probe.node.get_topic_names_and_types()}

        probe.until(lambda: wanted <= known().keys(), wanted)
        return known()

    return types


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load(resource_path("config/rviz/localize.rviz").read_text())["Visualization Manager"]


def test_rviz_topics_exist_with_their_types(topics, rviz):
    shown = {
        display["Topic"]["Value"]: RVIZ_KINDS[display["Class"]]
        for display in rviz["Displays"] + rviz["Tools"]
        if "Topic" in display
    }
    assert shown.items() <= topics(shown.keys()).items()
    assert {
        "/tactile_filter/map",
        "/tactile_filter/particles",
        "/tactile_filter/pose",
        "/tactile_filter/markers",
    } <= set(shown)
    assert rviz["Global Options"]["Fixed Frame"] == "material"


def foxglove_paths(config):
    """Message paths in the panels of a layout."""
    if isinstance(config, dict):
        for key, value in config.items():
            if key in ("value", "topicPath", "topicToRender", "poseEstimateTopic") and isinstance(value, str):
                yield value
            elif key == "topics":
                yield from value
            else:
                yield from foxglove_paths(value)
    elif isinstance(config, list):
        for value in config:
            yield from foxglove_paths(value)


def message_class(kind):
    package, _, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def test_foxglove_fields_exist(topics):
    layout = json.loads(resource_path("config/foxglove/localize.json").read_text())
    paths = list(foxglove_paths(layout["configById"]))
    assert len(paths) > 12
    types = topics({path.split(".")[0] for path in paths} - SIMULATED.keys()) | SIMULATED
    for path in paths:
        topic, *fields = path.split(".")
        kind = types[topic]
        for field in fields:
            name = re.sub(r"\[\d+\]$", "", field)
            known = message_class(kind).get_fields_and_field_types()
            assert name in known, f"{path}: {kind} has {', '.join(known)}"
            kind = known[name].replace("/", "/msg/", 1)
