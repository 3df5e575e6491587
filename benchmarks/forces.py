"""Localization under another force than in the scan, on smooth simulated materials that are felt everywhere.

    scripts/in_env python benchmarks/forces.py [--seeds 3 4 5] [--sweeps 16] [--json FILE]

A material has six channels; the strain of each is a constant plus a random field with the given correlation
length. A scan of 50 mm x 20 mm, lines 1.4 mm apart, is made at a constant force and learned. Test sweeps
cross it along x, with noise of odometry. The force multiplies the strain; relative to that of the scan it
is

``same``
    one
``grasp``
    constant in each sweep, with a standard deviation of 0.25 between sweeps
``wanders``
    a Gauss-Markov process with a standard deviation of 0.2 and a correlation length of 12 mm
``trembles``
    drawn anew at each strain, between 0.4 and 1.6

``offset`` is the standard deviation of the channels' readings without a force, relative to that of the
field. A row is a material and a force, and has the sweeps that are ``right``, ever ``wrong``, ``lost`` and
``never`` converged, as replay counts them, the median error of the strains that are converged, and the
share of these whose 95 % region holds the true position.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Callable, Sequence
from operator import itemgetter

import numpy as np
from rows import Row, accuracy_parser, measured, print_rows

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.offline.metrics import covered, position_error
from tactile_localizer.offline.odometry import SIMULATED, with_odometry
from tactile_localizer.offline.replay import replay
from tactile_localizer.offline.tradeoff import named_configuration
from tactile_localizer.offline.verdict import judge
from tactile_localizer.scene import Axis, Phalanx, Scene

CHANNELS, NOISE, STEP, SPACING = 6, 0.06, 0.0005, 0.0014
SCENE = Scene(
    "field", (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.021)), (Phalanx("finger", (0.0, 0.0), CHANNELS),)
)
X = np.arange(0.0, 0.05, STEP)
_WAVES = 200

Force = Callable[[np.random.Generator], np.ndarray]
"""Draws the forces (n,) along a sweep, relative to the force of the scan."""


def wanders(rng: np.random.Generator) -> np.ndarray:
    """A Gauss-Markov process about one."""
    found, kept = [rng.standard_normal()], np.exp(-STEP / 0.012)
    while len(found) < len(X):
        found.append(kept * found[-1] + np.sqrt(1.0 - kept**2) * rng.standard_normal())
    return 1.0 + 0.2 * np.array(found)


FORCES: dict[str, Force] = {
    "same": lambda rng: np.ones(len(X)),
    "grasp": lambda rng: np.full(len(X), max(1.0 + 0.25 * rng.standard_normal(), 0.3)),
    "wanders": wanders,
    "trembles": lambda rng: rng.uniform(0.4, 1.6, len(X)),
}


class Field:
    """A smooth material.

    Parameters
    ----------
    seed : of the waves
    length : m over which they are correlated
    offset : standard deviation of what the channels show without a force
    """

    def __init__(self, seed: int, length: float, offset: float) -> None:
        rng = np.random.default_rng(seed)
        self._waves = rng.standard_normal((_WAVES, 2)) / length
        self._phase = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
        self._amplitudes = np.sqrt(2.0 / _WAVES) * rng.standard_normal((_WAVES, CHANNELS))
        self._even, self._offset = 1.2 * rng.standard_normal(CHANNELS), offset * rng.standard_normal(CHANNELS)

    def strain(self, states: np.ndarray, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Strains (n, C) at states (n, 2) under forces (n,), with noise."""
        felt = self._even + np.cos(states @ self._waves.T + self._phase) @ self._amplitudes
        return np.asarray(self._offset + force[:, None] * felt + NOISE * rng.standard_normal(felt.shape))

    def scan(self, rng: np.random.Generator) -> Scan:
        """A scan at a constant force."""
        lines = np.arange(0.5 * SPACING, SCENE.upper[1], SPACING)
        states = np.stack(np.meshgrid(X, lines), axis=-1).reshape(-1, 2)
        strain = self.strain(states, np.ones(len(states)), rng)
        names = SCENE.axis_names, SCENE.phalanx_names, SCENE.layout.counts
        return Scan(states, strain, np.repeat(np.arange(len(lines)), len(X)), *names)

    def sweeps(self, force: Force, count: int, rng: np.random.Generator) -> Recording:
        """Sweeps along x under a force, at random places across."""
        found = []
        for number in range(1, count + 1):
            states = np.column_stack([X, np.full(len(X), rng.uniform(0.003, 0.018))])
            stamps, status = 20_000_000 * np.arange(len(X)), np.zeros((len(X), 1), dtype=np.uint8)
            found.append(RecordedSweep(number, stamps, states, self.strain(states, force(rng), rng), status))
        return Recording("forces", tuple(found))


def measure(
    seed: int, length_mm: float, offset: float, sweeps: int, configuration: Configuration
) -> list[Row]:
    """The rows of a material."""
    field, rng = Field(seed, 1e-3 * length_mm, offset), np.random.default_rng(seed)
    scan = field.scan(rng)
    localizer = build_localizer(scan, SCENE, configuration, rng, calibration=learn(scan, SCENE))
    rows = []
    for name, force in FORCES.items():
        recording = with_odometry(field.sweeps(force, sweeps, rng), SCENE, rng, SIMULATED)
        replayed = list(replay(localizer, recording))
        verdict = judge(replayed)
        error, inside = (
            np.concatenate([of(each)[each.converged] for each in replayed])
            for of in (position_error, covered)
        )
        rows.append(
            {
                "force": name,
                "length_mm": length_mm,
                "offset": offset,
                "seed": seed,
                "sweeps": sweeps,
                **{key: getattr(verdict, key) for key in ("right", "wrong", "lost", "never")},
                "error_mm": 1e3 * float(np.median(error)) if len(error) else None,
                "coverage": float(np.mean(inside)) if len(inside) else None,
            }
        )
    return rows


def totals(rows: Sequence[Row]) -> list[Row]:
    """Sums over the materials, for each force."""
    found = []
    for name in FORCES:
        own = [row for row in rows if row["force"] == name]
        if own:
            sums = {
                key: sum(row[key] for row in own) for key in ("sweeps", "right", "wrong", "lost", "never")
            }
            found.append({"force": name, **sums})
    return found


def main() -> None:
    """Measure, print and write."""
    parser = accuracy_parser(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4, 5])
    parser.add_argument("--lengths", type=float, nargs="+", default=[9.0, 18.0], metavar="MM")
    parser.add_argument("--offsets", type=float, nargs="+", default=[0.0, 3.0])
    parser.add_argument("--sweeps", type=int, default=16)
    given = parser.parse_args()
    configuration = named_configuration(given.configuration)
    calls = [
        (seed, length, offset, given.sweeps, configuration)
        for length in given.lengths
        for offset in given.offsets
        for seed in given.seeds
    ]
    order = itemgetter("length_mm", "offset", "seed", "force")
    rows = measured(measure, calls, given, order, totals)
    columns = {
        **{key: (key, "d") for key in ("sweeps", "right", "wrong", "lost", "never")},
        "error_mm": ("error, mm", ".2f"),
        "coverage": ("cover", ".3f"),
    }
    print_rows(("force", "length_mm", "offset", "seed"), columns, rows, totals(rows))


if __name__ == "__main__":
    main()
