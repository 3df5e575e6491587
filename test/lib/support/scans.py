"""Small scenes and scans for tests of the core: smooth strains known in closed form, at uniform positions."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SIDE = 0.05
"""Extent of a metric axis, m."""
NAMES = ("index", "middle", "ring", "little", "thumb")


def axes(dimension: int, full_turn: bool = False) -> tuple[Axis, ...]:
    """x, y and yaw: 50 mm, 50 mm and half a radian to both sides, or all the way round."""
    half = math.pi if full_turn else 0.5
    every = (Axis("x", 0.0, SIDE, 0.003), Axis("y", 0.0, SIDE, 0.001), Axis("yaw", -half, half, 0.05))
    return every[:dimension]


def scene(
    dimension: int = 2, phalanges: int = 2, feature: Region | None = None, full_turn: bool = False
) -> Scene:
    """A scene whose phalanges sit 10 mm apart along x."""
    offsets = [(0.01 * f, *(0.0,) * (dimension - 1)) for f in range(phalanges)]
    fingers = tuple(Phalanx(name, offset) for name, offset in zip(NAMES, offsets, strict=False))
    return Scene("test", axes(dimension, full_turn), fingers, feature)


def strain_at(states: np.ndarray, channels: int = 2 * DEFAULT_CHANNELS) -> np.ndarray:
    """Strain without noise at palm positions (N, d): waves of a few tenths of a volt, (N, C)."""
    channel = np.arange(channels)
    scale = np.array([2.0 * math.pi / SIDE, 2.0 * math.pi / SIDE, 1.0])[: states.shape[1]]
    phase = (states * scale) @ np.stack([1 + channel % 3, 1 + channel // 3 % 2, 1 + channel % 3])[
        : states.shape[1]
    ]
    return 0.3 * np.sin(phase + 0.7 * channel)


def scan(
    rng: np.random.Generator, of: Scene, pairs: int = 400, noise: float = 0.02, sweeps: int = 10
) -> Scan:
    """Pairs at uniform positions within the bounds of the scene ``of``, in equal sweeps."""
    states = of.lower + rng.random((pairs, of.dimension)) * (of.upper - of.lower)
    strain = strain_at(states, of.layout.size)
    strain += noise * rng.standard_normal(strain.shape)
    sweep = np.arange(pairs) * sweeps // pairs
    return Scan(states, strain, sweep, of.axis_names, of.phalanx_names, of.layout.counts)


def raster(
    of: Scene,
    strain: Callable[[np.ndarray, np.ndarray], np.ndarray],
    spacing: float = 0.0025,
    first: float | None = None,
    step: float = 0.0005,
) -> Scan:
    """Parallel sweeps along x, ``spacing`` m apart along y, over a scene ``of`` these two axes.

    ``strain`` has the strains (N, C) at states (N, 2) of sweeps (N,). The first line is at ``first``, half a
    spacing from the bound.
    """
    along = np.arange(of.lower[0], of.upper[0], step)
    across = np.arange(of.lower[1] + (spacing / 2.0 if first is None else first), of.upper[1], spacing)
    states = np.stack(np.meshgrid(along, across), axis=-1).reshape(-1, 2)
    sweep = np.repeat(np.arange(len(across)), len(along))
    return Scan(states, strain(states, sweep), sweep, of.axis_names, of.phalanx_names, of.layout.counts)


def line_scan(rng: np.random.Generator, of: Scene, noise: float = 0.02) -> Scan:
    """Parallel sweeps over :func:`strain_at`, with noise."""

    def strain(states: np.ndarray, _: np.ndarray) -> np.ndarray:
        clean = strain_at(states, of.layout.size)
        return clean + noise * rng.standard_normal(clean.shape)

    return raster(of, strain)


def bump_strain(states: np.ndarray, channels: int) -> np.ndarray:
    """Strain without noise at states (N, 2) of a bump of 8 mm, 30 V high, at 25 mm of both axes: (N, C)."""
    bump = 30.0 * np.exp(-0.5 * np.sum(((states - 0.025) / 0.004) ** 2, axis=1))[:, None]
    return np.asarray(bump * np.linspace(-1.0, 1.0, channels))


def bump_scan(of: Scene, offsets: float = 0.0, seed: int = 0) -> Scan:
    """Parallel sweeps over :func:`bump_strain`, with noise of 1 V.

    ``offsets`` is the standard deviation of those of the sweeps, V.
    """
    rng, size = np.random.default_rng(seed), of.layout.size

    def strain(states: np.ndarray, sweep: np.ndarray) -> np.ndarray:
        felt = bump_strain(states, size) + rng.standard_normal((len(states), size))
        return felt + offsets * rng.standard_normal((sweep.max() + 1, size))[sweep]

    return raster(of, strain)


def slides(of: Scene, x: np.ndarray, strains: Sequence[np.ndarray]) -> Scan:
    """Sweeps along positions x (n,) on one axis, with the strains (n, C) of each."""
    sweep = np.repeat(np.arange(len(strains)), len(x))
    states = np.tile(x, len(strains))[:, None]
    return Scan(states, np.concatenate(strains), sweep, of.axis_names, of.phalanx_names, of.layout.counts)
