"""What is heard of a sweep, brought together by its stamps."""

import numpy as np
import pytest

pytestmark = pytest.mark.ros


def test_estimates_are_compared_with_the_truth_at_their_own_stamps():
    from tactile_localizer.live.heard import Believed, Heard

    heard = Heard()
    heard.truths = [(0, 0.0, 0.0), (100, 0.01, 0.02)]
    heard.posteriors = [
        Believed(stamp, np.zeros(2), np.eye(2), False, "", 0.0) for stamp in (-10, 25, 50, 100, 150)
    ]
    sweep = heard.localised(0, 100, None)
    np.testing.assert_array_equal(sweep.stamp_ns, [25, 50, 100])
    np.testing.assert_allclose(sweep.truth, [[0.0025, 0.005], [0.005, 0.01], [0.01, 0.02]])
