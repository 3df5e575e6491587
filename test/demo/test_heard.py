"""What is heard of a sweep, brought together by its stamps."""

import numpy as np
import pytest

pytestmark = pytest.mark.ros


def test_estimates_are_compared_with_the_truth_at_their_own_stamps():
    from tactile_localizer.demo.heard import Believed, Heard

    heard = Heard()
    heard.truths = [(0, 0.0, 0.0), (100, 0.01, 0.02)]
    heard.posteriors = [
        Believed(stamp, np.zeros(2), np.eye(2), False, "", 0.0) for stamp in (-10, 25, 50, 100, 150)
    ]
    sweep = heard.localised(0, 100, None)
    np.testing.assert_array_equal(sweep.stamp_ns, [25, 50, 100])
    np.testing.assert_allclose(sweep.truth, [[0.0025, 0.005], [0.005, 0.01], [0.01, 0.02]])


def test_the_mapping_is_waited_for_until_it_hears_strain_and_poses():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    from tactile_localizer.demo.heard import Heard
    from tactile_localizer.msg import ScanStatus

    def tells(poses):
        values = [KeyValue(key="poses", value=poses)]
        return DiagnosticArray(status=[DiagnosticStatus(name="mapping: scan", values=values)])

    heard, status = Heard(), ScanStatus()
    diagnose, tell = heard.work_of("/diagnostics"), heard.work_of("mapping/status")
    steps = []
    for step in (lambda: tell(status), lambda: diagnose(tells("3")), lambda: diagnose(tells("0"))):
        step()
        steps.append(heard.is_mapped)
    status.header.stamp.sec = 7
    steps.append(heard.is_mapped)
    diagnose(tells("3"))
    assert [*steps, heard.is_mapped] == [False, False, False, False, True]
