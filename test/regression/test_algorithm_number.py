"""What is learned from a scan is kept with it, under the number of the algorithm that learned it."""

import pytest

from tactile_localizer.core.factory import learn
from tactile_localizer.io.recording import scan_of
from tactile_localizer.io.scans.learned import ALGORITHM
from tactile_localizer.sim import shipped_scene, simulate_recording

LEARNED = {29: [0.001048, 0.001419, 0.4006, 0.00934, 0.03054, 0.2047, 0.0017, 0.0017]}
"""By number, registration error, factors of the variance and lengths of a simulated scan. After a
change that alters them, add one to ``ALGORITHM`` and write the new ones here, so that scans are examined
anew."""


def test_a_calibration_has_the_number_of_the_algorithm_that_learned_it() -> None:
    scene = shipped_scene("bump")
    calibration = learn(scan_of(simulate_recording("bump", 1, sweeps=11), scene), scene)
    assert calibration.variance is not None
    variance = calibration.variance
    found = [
        *calibration.registration_std,
        *variance.factors,
        variance.gain,
        calibration.examination.information_length,
        calibration.examination.explanation_length,
    ]
    assert LEARNED[ALGORITHM] == pytest.approx(found, rel=0.01)
