"""JSON document of a replay: summary, settings, what was learned, and every update."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.offline.axes import MM, describe_sizes
from tactile_localizer.offline.metrics import position_error, summarize, timing, yaw_error
from tactile_localizer.offline.recordings import Read, ReplayedRecording
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.offline.verdict import Verdict, judge
from tactile_localizer.scene import Scene


@dataclass(frozen=True)
class Evaluation:
    """A replay, with all that it was made from.

    Parameters
    ----------
    scan_name : path of the scan
    load, scene : gives the pairs of the map, and their scene
    configuration, calibration : of the localizer
    localizer : it can localize a sweep again
    replayed : the recordings and the estimates
    seed : random seed
    reads : they read the recordings again
    """

    scan_name: str
    load: Callable[[], Scan]
    scene: Scene
    configuration: Configuration
    calibration: Calibration
    localizer: Localizer
    replayed: ReplayedRecording
    seed: int
    reads: Sequence[Read]

    @property
    def sweeps(self) -> list[ReplayedSweep]:
        """The estimates."""
        return self.replayed.sweeps

    def recorded(self, sweep: int) -> RecordedSweep:
        """The recorded samples of one of the sweeps, read again."""
        recording, place = self.replayed.origin[sweep]
        return self.reads[recording]()[0].sweeps[place]

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the sweeps."""
        return judge(self.sweeps)


def learned_values(localizer: Localizer, calibration: Calibration) -> dict[str, str]:
    """What was learned from a scan, by name, with units; the noise is in the unit of the scan's strain."""
    model = localizer.model
    memory = model.drift.memory
    kinds = {
        Material.CLOTH: "textured, or under a force that wanders",
        Material.SHEET: "featureless between features",
    }
    noise = np.sqrt(model.noise.variance)
    return {
        "material": kinds[model.material],
        "information length": f"{localizer.information_length * MM:.1f} mm",
        "explanation length": f"{localizer.explanation_length * MM:.1f} mm",
        "memory of the level": f"{memory * MM:.0f} mm" if memory < 1.0 else "constant",
        "noise of a channel": f"{np.median(noise):.2g} ({noise.min():.2g} to {noise.max():.2g})",
        "registration": describe_sizes(localizer.scene, calibration.registration_std),
    }


def replay_document(evaluation: Evaluation) -> dict[str, Any]:
    """JSON document of a replay; all but ``timing`` is reproducible for a seed."""
    verdict = evaluation.verdict
    summary = {
        "scene": evaluation.scene.name,
        "odometry": evaluation.replayed.odometry,
        "seed": evaluation.seed,
        **summarize(evaluation.sweeps),
    }
    return {
        "summary": summary,
        "verdict": {"success": verdict.success, **asdict(verdict)},
        "timing": timing(evaluation.sweeps),
        "recording": {"source": evaluation.replayed.source, "notes": evaluation.replayed.notes},
        "configuration": evaluation.configuration,
        "learned": learned_values(evaluation.localizer, evaluation.calibration),
        "scene": scene_to_dict(evaluation.scene),
        "axes": evaluation.scene.axis_names,
        "updates": updates(evaluation.sweeps),
    }


def updates(sweeps: Sequence[ReplayedSweep]) -> Iterator[dict[str, Any]]:
    """Rows of all estimates of a replay."""
    for sweep in sweeps:
        truth = np.full(sweep.mean.shape, np.nan) if sweep.truth is None else sweep.truth
        columns: dict[str, Iterable[Any]] = {
            "stamp_s": sweep.stamp_ns / 1e9,
            "stamp_ns": sweep.stamp_ns,
            "sweep": [sweep.number] * len(sweep),
            "mean": sweep.mean,
            "covariance": sweep.covariance,
            "trace": sweep.trace,
            "converged": sweep.converged,
            "state": [state.value for state in sweep.state],
            "travel_m": sweep.travel,
            "truth": [row if np.isfinite(row).all() else None for row in truth],
            "error_m": position_error(sweep),
        }
        for name in ("reason", "probability", "on_map", "log_marginal", "updated"):
            columns[name] = getattr(sweep, name)
        if "yaw" in sweep.scene.axis_names:
            columns["error_rad"] = yaw_error(sweep)
        for row in zip(*columns.values(), strict=True):
            yield dict(zip(columns, row, strict=True))
