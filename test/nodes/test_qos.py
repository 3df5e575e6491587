"""Strain is best effort, unless whoever starts the nodes wants it otherwise."""

import pytest
from support.sweeps import scene_of, write_scan

from tactile_localizer.io.scene_file import save_scene

pytestmark = pytest.mark.ros


@pytest.fixture
def parameters(simulated_can, tmp_path):
    write_scan(tmp_path / "bump.db")
    save_scene(scene_of(), tmp_path / "scene.yaml")
    bus = {"interface": "udp_multicast", "bus_options": [f"port={simulated_can['port']}"]}
    return {
        "driver_node": {**bus, "channel": simulated_can["channel"], "tare_file": tmp_path / "tare.yaml"},
        "mapping_node": {"scene_file": tmp_path / "scene.yaml", "scan_file": tmp_path / "scan.db"},
        "filter_node": {"scan_file": tmp_path / "bump.db", "cell": 2.0},
    }


@pytest.mark.parametrize("wanted", [None, "reliable"])
def test_strain_is_best_effort_unless_that_is_overridden(node_process, probe, parameters, wanted):
    ends = {"driver_node": "publisher", "mapping_node": "subscription", "filter_node": "subscription"}
    for name, end in ends.items():
        override = {f"qos_overrides./strain.{end}.reliability": wanted} if wanted else {}
        node_process(name, parameters[name] | override)

    def reliabilities():
        infos = [
            *probe.node.get_publishers_info_by_topic("/strain"),
            *probe.node.get_subscriptions_info_by_topic("/strain"),
        ]
        return {info.node_name: info.qos_profile.reliability.name.lower() for info in infos}

    probe.until(lambda: len(reliabilities()) == 3, "all three", 60.0)
    assert set(reliabilities().values()) == {wanted or "best_effort"}
