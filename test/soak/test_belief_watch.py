"""Detection of false convergence in the soak."""

import numpy as np
import pytest

pytestmark = pytest.mark.ros

SECOND = 1_000_000_000


class Replayed:
    """Substitute for a watcher, which passes on the messages of the test."""

    def __init__(self):
        self.works = {}

    def listen(self, kind, topic, quality, work=None):
        self.works[topic] = work

    def publisher(self, kind, topic, quality):
        return None


@pytest.fixture
def received():
    return Replayed()


@pytest.fixture
def watch(received):
    from harness.belief_watch import BeliefWatch
    from harness.relay import Relay

    return BeliefWatch(received, Relay(received))


def publish(received, stamp_ns, mean, converged=True, stale=False, reason=""):
    from tactile_localizer.msg import Posterior
    from tactile_localizer.ros.conversions.timestamps import from_ns

    message = Posterior(mean=list(mean), converged=converged, stale=stale, reason=reason)
    message.header.stamp = from_ns(stamp_ns)
    received.works["filter/posterior"](message)


def move_to(received, stamp_ns, x):
    from geometry_msgs.msg import PoseStamped

    from tactile_localizer.ros.conversions.timestamps import from_ns

    message = PoseStamped()
    message.header.stamp = from_ns(stamp_ns)
    message.pose.position.x = x
    received.works["simulator/ground_truth"](message)


def sweep(received, means, **how):
    """Truth goes from x = 0 to 10 mm in a tenth of a second; the estimates halfway."""
    move_to(received, 2 * SECOND, 0.0)
    for mean in means:
        publish(received, 2 * SECOND + SECOND // 20, mean, **how)
    move_to(received, 2 * SECOND + SECOND // 10, 0.01)


def test_the_truth_is_interpolated_at_the_posteriors_stamp(received, watch):
    watch.begin_sweep(SECOND)
    sweep(received, [(0.005, 0.0), (0.008, 0.004)])
    np.testing.assert_allclose(watch.errors_m, [0.0, 0.005], atol=1e-12)
    assert watch.wrong == {}


def test_every_posterior_before_the_next_truth_is_judged(received, watch):
    watch.begin_sweep(SECOND)
    move_to(received, 2 * SECOND, 0.0)
    for tenth, x in ((1, 0.001), (5, 0.005), (9, 0.009)):
        publish(received, 2 * SECOND + tenth * SECOND // 100, (x, 0.0))
    move_to(received, 2 * SECOND + SECOND // 10, 0.01)
    np.testing.assert_allclose(watch.errors_m, np.zeros(3), atol=1e-12)


@pytest.mark.parametrize(
    ("how", "count"),
    [({}, 1), ({"converged": False}, 0), ({"stale": True}, 0)],
    ids=["converged", "not converged", "stale"],
)
def test_convergence_is_false_far_from_the_truth(received, watch, how, count):
    watch.begin_sweep(SECOND)
    sweep(received, [(0.03, 0.0), (0.012, 0.0)], **how)
    assert watch.wrong.total() == count
    assert len(watch.false_sweeps) == count


def test_a_false_convergence_is_reported_with_its_reason(received, watch):
    watch.begin_sweep(SECOND)
    sweep(received, [(0.03, 0.0)], reason="converged: probability 0.995")
    assert watch.false_sweeps == [
        "25.0 mm off after 0.0 mm of travel at x 5.0, y 0.0 mm: converged: probability 0.995"
    ]


def test_posteriors_between_sweeps_are_ignored(received, watch):
    sweep(received, [(0.03, 0.0)])
    watch.begin_sweep(3 * SECOND)
    sweep(received, [(0.03, 0.0)])
    watch.end_sweep()
    sweep(received, [(0.03, 0.0)])
    assert watch.judged == 0


def test_a_misled_belief_is_excused_until_the_sweep_ends(received, watch):
    watch.begin_sweep(SECOND)
    watch.misled = "wrong seed"
    watch.misled = ""
    sweep(received, [(0.03, 0.0)])
    assert watch.wrong == {"wrong seed": 1}
    watch.begin_sweep(SECOND)
    sweep(received, [(0.03, 0.0)])
    assert watch.wrong == {"wrong seed": 1, "": 1}
    assert len(watch.false_sweeps) == 1


def test_a_sweep_is_reported_as_false_once(received, watch):
    for _ in range(2):
        watch.begin_sweep(SECOND)
        sweep(received, [(0.03, 0.0), (0.04, 0.0)])
    assert watch.wrong == {"": 4}
    assert len(watch.false_sweeps) == 2
