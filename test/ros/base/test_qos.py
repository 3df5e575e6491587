"""Reliability of the strain: best effort unless overridden."""

import pytest

ENDS = {"driver": "publisher", "mapping": "subscription", "filter": "subscription"}


@pytest.mark.parametrize("wanted", ["best_effort", "reliable"])
def test_reliability_of_strain_can_be_overridden(node_process, probe, valid, wanted):
    for node, end in ENDS.items():
        override = {f"qos_overrides./strain.{end}.reliability": wanted} if wanted != "best_effort" else {}
        node_process(f"{node}_node", valid[node] | override)

    def reliabilities():
        infos = [
            *probe.node.get_publishers_info_by_topic("/strain"),
            *probe.node.get_subscriptions_info_by_topic("/strain"),
        ]
        return {info.node_name: info.qos_profile.reliability.name.lower() for info in infos}

    probe.until(lambda: len(reliabilities()) == 3, "all three")
    assert set(reliabilities().values()) == {wanted}
