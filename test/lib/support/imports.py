"""Small recordings as CSV files, for the commands that import them."""

import csv

import numpy as np

from tactile_localizer.scene import Axis, Phalanx, Scene

HEADER = ["stamp_s", "sweep", "x", "y", *(f"{p}_{g}" for p in ("index", "middle") for g in range(1, 9))]
STANDARD = ["stamp_s", "x", *(f"index_{n}" for n in range(1, 9))]
LINE = Scene("line", (Axis("x", -0.001, 0.06),), (Phalanx("index", (0.0,)),))


def write_csv(path, rows, names=HEADER):
    """Write a header and rows."""
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([names, *rows])


def sheet_rows():
    """Four sweeps in 200 rows."""
    noise = np.random.default_rng(0).normal(size=(200, 16))
    return [[0.01 * n, n // 50, 0.0004 * n % 0.02, 0.02 + 0.001 * (n // 50), *noise[n]] for n in range(200)]


def slid(channels=8, place=1.0):
    """Rows of a slide over 50 mm in 5 s: time, position, channels."""
    rng = np.random.default_rng(0)
    return [[0.05 * k, place * 0.0005 * k, *rng.normal(size=channels)] for k in range(100)]


def touch_and_poses(folder, place=1.0):
    """Strain of 19 channels at 20 Hz, and poses at 30 Hz with stamps of their own."""
    rows = [[row[0], *row[2:]] for row in slid(channels=19)]
    write_csv(folder / "touch.csv", rows, ["time", *(f"taxel{n}" for n in range(1, 20))])
    poses = [[1e3 * k / 30, place * 0.01 * k / 30] for k in range(150)]
    write_csv(folder / "poses.csv", poses, ["t_ms", "px"])
    strain = "--column stamp_s=time --column finger=taxel1..19"
    return f"csv touch.csv --poses poses.csv {strain} --column pose_stamp_s=t_ms*0.001 --column x=px"


def late_strokes(path, late_rows):
    """Strokes of 40 mm there and back at 20 mm/s, a sample each 10 ms, of smooth strain that is late."""
    rng = np.random.default_rng(2)
    places, weights = rng.uniform(0.0, 40.0, 30), rng.normal(size=(30, 8))
    x = np.abs((np.arange(2000) * 0.2 + 40) % 80 - 40)
    strain = np.exp(-0.5 * ((np.roll(x, late_rows)[:, None] - places) / 2) ** 2) @ weights
    rows = np.column_stack([0.01 * np.arange(2000), np.arange(2000) // 200, 1e-3 * x, strain])[late_rows:]
    write_csv(path, rows, ["stamp_s", "sweep", "x", *(f"index_{n}" for n in range(1, 9))])
