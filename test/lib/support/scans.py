"""Small scenes and scans for tests of the core: smooth strains known in closed form, at uniform positions."""

from __future__ import annotations

import math

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
    phase = (states * scale) @ np.stack([1 + channel % 2, 1 + channel // 3 % 2, 1 + channel % 3])[
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


def line_scan(rng: np.random.Generator, of: Scene, spacing: float = 0.0025, noise: float = 0.02) -> Scan:
    """Parallel sweeps along x, ``spacing`` m apart along y, over a scene ``of`` these two axes."""
    along, across = np.arange(0.0, SIDE, 0.0005), np.arange(spacing / 2.0, SIDE, spacing)
    states = np.stack(np.meshgrid(along, across, indexing="xy"), axis=-1).reshape(-1, 2)
    strain = strain_at(states, of.layout.size)
    strain += noise * rng.standard_normal(strain.shape)
    sweep = np.repeat(np.arange(len(across)), len(along))
    return Scan(states, strain, sweep, of.axis_names, of.phalanx_names)
