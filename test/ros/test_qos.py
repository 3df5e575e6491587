"""Reliability of the strain: best effort unless overridden."""

import pytest
from support.sweeps import scene_of, write_scan

from tactile_localizer.io.scene_file import save_scene

pytestmark = pytest.mark.ros

ENDS = {"driver": "publisher", "mapping": "subscription", "filter": "subscription"}


@pytest.fixture
def parameters(simulated_can, tmp_path):
    write_scan(tmp_path / "bump_scan")
    save_scene(scene_of(), tmp_path / "scene.yaml")
    bus = {"interface": "udp_multicast", "bus_options": [f"port={simulated_can['port']}"]}
    return {
        "driver": {**bus, "channel": simulated_can["channel"], "tare_file": tmp_path / "tare.yaml"},
        "mapping": {"scene_file": tmp_path / "scene.yaml", "scan_file": tmp_path / "bump_scan"},
        "filter": {"scan_file": tmp_path / "bump_scan", "cell": 2.0},
    }


@pytest.mark.parametrize("wanted", ["best_effort", "reliable"])
def test_reliability_of_strain_can_be_overridden(node_process, probe, parameters, wanted):
    for node, end in ENDS.items():
        override = {f"qos_overrides./strain.{end}.reliability": wanted} if wanted != "best_effort" else {}
        node_process(f"{node}_node", parameters[node] | override)

    def reliabilities():
        infos = [
            *probe.node.get_publishers_info_by_topic("/strain"),
            *probe.node.get_subscriptions_info_by_topic("/strain"),
        ]
        return {info.node_name: info.qos_profile.reliability.name.lower() for info in infos}

    probe.until(lambda: len(reliabilities()) == 3, "all three", 60.0)
    assert set(reliabilities().values()) == {wanted}
