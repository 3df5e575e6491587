"""Observations of a sweep are combined by their stamps."""

import numpy as np
import pytest

pytestmark = pytest.mark.ros


def test_truth_is_interpolated_at_the_stamps():
    from tactile_localizer.demo.observations import Observations, PosteriorSample

    observations = Observations()
    observations.truths = [(0, 0.0, 0.0), (100, 0.01, 0.02)]
    observations.posteriors = [
        PosteriorSample(stamp, np.zeros(2), np.eye(2), False, "", 0.0) for stamp in (-10, 25, 50, 100, 150)
    ]
    sweep = observations.localized_sweep(0, 100, None)
    np.testing.assert_array_equal(sweep.stamp_ns, [25, 50, 100])
    np.testing.assert_allclose(sweep.truth, [[0.0025, 0.005], [0.005, 0.01], [0.01, 0.02]])


def test_truth_may_arrive_while_a_sweep_is_evaluated():
    from tactile_localizer.demo.observations import Observations, PosteriorSample

    class Growing(list):
        def __iter__(self):
            read = list(self[:])
            self.append((100 * len(self), 0.01, 0.02))
            return iter(read)

    observations = Observations()
    observations.truths = Growing([(0, 0.0, 0.0), (100, 0.01, 0.02)])
    observations.posteriors = [PosteriorSample(50, np.zeros(2), np.eye(2), False, "", 0.0)]
    sweep = observations.localized_sweep(0, 100, None)
    np.testing.assert_allclose(sweep.truth, [[0.005, 0.01]])


def test_mapping_is_ready_when_it_receives_strain_and_poses():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    from tactile_localizer.demo.observations import Observations
    from tactile_localizer.msg import ScanStatus

    def tells(poses):
        values = [KeyValue(key="poses", value=poses)]
        return DiagnosticArray(status=[DiagnosticStatus(name="mapping: scan", values=values)])

    observations, status = Observations(), ScanStatus()
    diagnose, tell = observations.callback_for("/diagnostics"), observations.callback_for("mapping/status")
    steps = []
    for step in (lambda: tell(status), lambda: diagnose(tells("3")), lambda: diagnose(tells("0"))):
        step()
        steps.append(observations.is_mapped)
    status.header.stamp.sec = 7
    steps.append(observations.is_mapped)
    diagnose(tells("3"))
    assert [*steps, observations.is_mapped] == [False, False, False, False, True]
