"""A strip with one strong feature, scanned by sweeps that each have a different offset."""

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = Scene(
    "strip",
    (Axis("x", 0.0, 0.1, 0.01),),
    (Phalanx("index", (0.0,)), Phalanx("middle", (0.0,))),
    Region((0.04,), (0.06,)),
    {},
)
SWEEPS, PAIRS = 12, 200
CENTRE = np.linspace(-0.2, 0.2, 16)


def felt(x: np.ndarray, offset: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Strains (N, 16) along a sweep: a strong feature, the sweep's offset, and noise of 5 mV."""
    feature = np.exp(-(((x - 0.05) / 0.004) ** 2))[:, None] * np.linspace(0.3, 0.6, 16)
    return CENTRE + feature + offset + rng.normal(0.0, 0.005, (len(x), 16))


def scanned(offsets: np.ndarray, seed: int = 0) -> Scan:
    """A scan whose sweeps have ``offsets`` (K, 16)."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0.0, 0.1, PAIRS)
    strain = np.concatenate([felt(x, offset, rng) for offset in offsets])
    sweep = np.repeat(np.arange(len(offsets)), PAIRS)
    return Scan(np.tile(x, len(offsets))[:, None], strain, sweep, ("x",), ("index", "middle"))


OFFSETS = np.random.default_rng(3).normal(0.0, 0.03, (SWEEPS, 16))
SCAN = scanned(OFFSETS)
