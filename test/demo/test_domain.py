"""Runs on one machine are separate."""

from tactile_localizer.demo.domain import own_domain


def test_runs_have_different_domains_and_ports():
    with own_domain() as one, own_domain() as other:
        assert one.number != other.number
        assert one.can_port != other.can_port
        assert one.environment == {
            "ROS_DOMAIN_ID": str(one.number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }


def test_a_domain_is_released_after_its_run():
    with own_domain() as first:
        pass
    with own_domain() as second:
        assert second == first
