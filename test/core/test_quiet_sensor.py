"""A sensor with less noise is not worse: what the filter's cells do not resolve is less than its noise."""

import numpy as np
from support.scans import slides

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.scene import Axis, Phalanx, Scene

SLEEVE = Scene("sleeve", (Axis("x", -0.002, 0.047),), (Phalanx("index", (0.0,)), Phalanx("thumb", (0.0,))))
WAY = np.arange(0.0, 0.045, 0.00023)


def converged(noise: float) -> float:
    """Fraction of the strains of four sweeps over two bumps of 1 V that are converged, and right."""
    rng = np.random.default_rng(1)
    of = rng.standard_normal((2, 16))

    def felt() -> np.ndarray:
        bumps = [np.exp(-0.5 * ((WAY - at) / 0.004) ** 2) for at in (0.019, 0.026)]
        return np.transpose(bumps) @ of + noise * rng.standard_normal((len(WAY), 16))

    known = Calibration(np.array([0.001]), Material.SHEET, examination=Examination(0.005, 0.005))
    scan = slides(SLEEVE, WAY, [felt() for _ in range(6)])
    localizer, right = build_localizer(scan, SLEEVE, Configuration(), rng, calibration=known), []
    for _ in range(4):
        localizer.reset()
        for n, (place, strain) in enumerate(zip(WAY, felt(), strict=True)):
            estimate = localizer.update((1 + n) * 10**7, np.array([place]), strain)
            right.append(estimate.converged and abs(estimate.mean[0] - place) < 0.002)
    return float(np.mean(right))


def test_a_tenth_of_the_noise_is_not_worse() -> None:
    usual, quiet = converged(0.02), converged(0.002)
    assert quiet > usual - 0.05 > 0.5
