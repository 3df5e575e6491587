"""Observations of a sweep are combined by their stamps."""

import numpy as np
import pytest

pytestmark = pytest.mark.ros


def posterior(stamp_ns):
    from tactile_localizer.msg import Posterior

    message = Posterior(mean=[0.0, 0.0], covariance=[1.0, 0.0, 0.0, 1.0], covariance_trace=2.0)
    message.header.stamp.nanosec = stamp_ns
    return message


def test_truth_is_interpolated_at_the_stamps():
    from tactile_localizer.demo.observations import Observations

    observations = Observations()
    observations.truths = [(100, 0.0, 0.0), (200, 0.01, 0.02)]
    observations.posteriors = [posterior(stamp_ns) for stamp_ns in (90, 125, 150, 200, 250)]
    sweep = observations.localized_sweep(0, 200, None)
    np.testing.assert_array_equal(sweep.stamp_ns, [125, 150, 200])
    np.testing.assert_allclose(sweep.truth, [[0.0025, 0.005], [0.005, 0.01], [0.01, 0.02]])


def test_truth_may_arrive_while_a_sweep_is_evaluated():
    from tactile_localizer.demo.observations import Observations

    class Growing(list):
        def __iter__(self):
            read = list(self[:])
            self.append((100 * len(self), 0.01, 0.02))
            return iter(read)

    observations = Observations()
    observations.truths = Growing([(0, 0.0, 0.0), (100, 0.01, 0.02)])
    observations.posteriors = [posterior(50)]
    sweep = observations.localized_sweep(0, 100, None)
    np.testing.assert_allclose(sweep.truth, [[0.005, 0.01]])


def test_mapping_is_ready_when_it_receives_strain_and_poses():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    from tactile_localizer.demo.observations import Observations
    from tactile_localizer.msg import ScanStatus

    def report(poses):
        values = [KeyValue(key="poses", value=poses)]
        return DiagnosticArray(status=[DiagnosticStatus(name="mapping: scan", values=values)])

    observations, status = Observations(), ScanStatus()
    diagnose, scan = observations.callback_for("/diagnostics"), observations.callback_for("mapping/status")
    steps = []
    for step in (lambda: scan(status), lambda: diagnose(report("3")), lambda: diagnose(report("0"))):
        step()
        steps.append(observations.is_mapped)
    status.header.stamp.sec = 7
    steps.append(observations.is_mapped)
    diagnose(report("3"))
    assert [*steps, observations.is_mapped] == [False, False, False, False, True]
