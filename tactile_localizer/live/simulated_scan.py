"""A scan file of the simulated hand, without waiting for a hand to sweep."""

from __future__ import annotations

from pathlib import Path

from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.scan import simulate_scan


def write_simulated_scan(path: Path, feature: str, seed: int) -> None:
    """Write the training scan of a feature, with the shipped scene, as the mapping node would."""
    scan = simulate_scan(feature, seed)
    scene = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
    with ScanStore.create(path, scene) as store:
        for part in scan.slices():
            store.begin_sweep()
            store.append(scan.stamp_ns[part], scan.odometry[part], scan.strain[part])
            store.end_sweep()
