"""Stands in for a robot: records sweeps over a strip with three ribs into train.csv and test.csv."""

import numpy as np

RIBS = ((0.035, 0.0030, 1.0), (0.060, 0.0015, 0.6), (0.090, 0.0045, 1.3))
"""Place along the strip, m; half width, m; height."""
OFFSETS = {"index": 0.010, "middle": 0.014, "thumb": -0.012}
SPEED, RATE = 0.02, 40.0
"""m/s, Hz"""

rng = np.random.default_rng(1)
GAUGES = {name: rng.normal(0.0, 0.3, (8, 3)) for name in OFFSETS}
"""V a unit of force, for the three components of the force."""


def strain(name: str, x: np.ndarray, yaw: float) -> np.ndarray:
    """Voltages (N, 8) of one load cell with the palm at ``x`` (N,), m, and turned by ``yaw``, rad."""
    place = x + OFFSETS[name]
    slope, lift = np.zeros(len(x)), np.zeros(len(x))
    for centre, width, height in RIBS:
        scaled = (place - centre) / width
        rib = height * np.exp(-0.5 * scaled**2)
        slope += 1.6 * scaled * rib
        lift += rib
    force = np.stack([np.cos(yaw) * slope, -np.sin(yaw) * slope, lift], axis=1)
    return force @ GAUGES[name].T + rng.normal(0.0, 0.02, (len(x), 8))


def record(path: str, sweeps: list[tuple[float, float]]) -> None:
    """Write one sweep for each start, m, and yaw, rad, to the strip's end."""
    rows, now = [], 0.0
    for number, (start, yaw) in enumerate(sweeps):
        x = np.arange(start, 0.12, SPEED / RATE)
        stamps = now + np.arange(len(x)) / RATE
        felt = [strain(name, x, yaw) for name in OFFSETS]
        rows.append(np.column_stack([stamps, np.full(len(x), number), x, np.full(len(x), yaw), *felt]))
        now = stamps[-1] + 1.0
    names = [f"{name}_{gauge}" for name in OFFSETS for gauge in range(1, 9)]
    header = ",".join(["stamp_s", "sweep", "x", "yaw", *names])
    np.savetxt(path, np.concatenate(rows), "%.7g", delimiter=",", header=header, comments="")


record("train.csv", [(0.0, yaw) for yaw in np.linspace(-0.3, 0.3, 13)])
record("test.csv", [(start, yaw) for start, yaw in rng.uniform((0.0, -0.28), (0.03, 0.28), (6, 2))])
