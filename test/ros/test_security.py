"""The security policy matches the nodes, and no input can execute code."""

import xml.etree.ElementTree as ElementTree

import pytest

from tactile_localizer.resources import resource_path

NAMESPACE = "/guarded"
"""Of this test alone: nodes of other tests, of the same names, are not taken for these."""

NODES = ("adapter", "driver", "mapping", "filter", "simulator")


def allowed(enclave):
    """Names that the policy allows a node in the namespace, by kind."""
    root = ElementTree.parse(resource_path("config/security/policy.xml")).getroot()
    profile = root.find(f".//enclave[@path='/tactile_localizer/{enclave}']//profile")
    node = profile.get("node")

    def names(tag, way, item):
        return {
            full_name(element.text, node)
            for group in profile.findall(tag)
            if group.get(way) == "ALLOW"
            for element in group.findall(item)
        }

    return {
        "publisher": names("topics", "publish", "topic"),
        "subscriber": names("topics", "subscribe", "topic"),
        "service": names("services", "reply", "service"),
        "client": names("services", "request", "service"),
    }


def full_name(name, node):
    return name if name.startswith("/") else f"{NAMESPACE}/{name.replace('~', node, 1)}"


@pytest.mark.ros
@pytest.mark.parametrize("node", NODES)
def test_the_policy_matches_the_running_node(node_process, probe, valid, node):
    node_process(f"{node}_node", {"use_sim_time": True, **valid[node]}, namespace=NAMESPACE)
    name = f"tactile_{node}"
    expected = allowed(name)
    missing = dict(expected)

    def complete():
        """What the node has, once that is all that is expected: the graph can lose some of it again."""
        try:
            found = {
                kind: {
                    one
                    for one, _ in getattr(probe.node, f"get_{kind}_names_and_types_by_node")(name, NAMESPACE)
                }
                for kind in expected
            }
        except RuntimeError:  # the node is not known yet
            return None
        missing.update({kind: expected[kind] - names for kind, names in found.items()})
        return None if any(missing.values()) else found

    assert probe.until(complete, missing) == expected
