"""Calibration of a scan and what a filter needs of it, kept in its folder for the next start.

They are used only for exactly the pairs and the scene that they were learned from, whatever the scene's name.
The calibration for the scan's own scene is in ``calibration.json``, what the filter needs in
``calibration.npz``, and each other scene has files beside them. A failure to store them costs only the time
to learn them again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import logging
import zlib
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.calibration.trials import Outcome
from tactile_localizer.core.configuration import SWEEP_MIXTURE, Configuration
from tactile_localizer.core.factory import LEARNED, Prepared, assemble, build_localizer, learn_model, prepare
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import TactileMap, make_map
from tactile_localizer.core.scan.tracks import Tracks
from tactile_localizer.errors import ScanError, SceneError, refusing
from tactile_localizer.io.recording import SCENE_OF_SCAN, Recording, scan_of, sharing
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.kept import key_of, load, store
from tactile_localizer.io.scene_file import load_scene, scene_to_dict
from tactile_localizer.io.whole_file import RESULT, open_file, write_text
from tactile_localizer.scene import Scene

_log = logging.getLogger(__name__)

FILE = "calibration.json"
_MOST_BYTES = 2**20
ALGORITHM = 29
"""Number that changes with the algorithm of :func:`~.factory.learn`."""


def learned_calibration(
    path: str | Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> Calibration:
    """Calibration of a scan, kept in its folder or computed by :func:`~.factory.learn` and then kept.

    Parameters
    ----------
    path : folder of the scan; if it cannot be written, that is logged as a warning
    scan, scene : training pairs and their scene
    progress : called with a description of the step and its completed fraction
    """
    return _calibration(path, scan, scene, progress)[0]


def _calibration(
    path: str | Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None
) -> tuple[Calibration, SweepModel | None]:
    """The calibration, and the model of the sweeps if it was learned now."""
    digest, kept = digest_of(scan, scene), _file(Path(path), scene)
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        with open_file(kept) as file:
            content = json.loads(file.read(_MOST_BYTES))
        learned = content["learned"]
        if content == _content(digest, learned):
            return Calibration(
                np.array(learned["registration_std"]),
                Material(learned["material"]),
                learned["variance"] and VarianceModel(**learned["variance"]),
                _examination(learned["examination"]),
            ), None
    calibration, model = learn_model(scan, scene, progress)
    store_calibration(kept, digest, calibration)
    return calibration, model


class Contents(NamedTuple):
    """What is shown of a scan: its numbers of pairs and sweeps, its map, and notes on files without use."""

    pairs: int
    sweeps: int
    tactile_map: TactileMap
    notes: Sequence[str]


class Ready(NamedTuple):
    """A localizer on a scan, its calibration, and the range and contents of the scan."""

    localizer: Localizer
    calibration: Calibration
    bounds: ScanRange
    contents: Contents


class Reading(NamedTuple):
    """A scan as it was read.

    Parameters
    ----------
    folder : of the scan
    states : keys of its files and of their content, before they were read
    recording : its sweeps
    scan : the same as pairs
    """

    folder: ScanFolder
    states: tuple[str, ...]
    recording: Recording
    scan: Scan

    @classmethod
    def of(cls, folder: ScanFolder, states: tuple[str, ...] = ()) -> Reading:
        """Read a scan, with a warning for each unused file; ``states`` are given where they are known.

        Raises
        ------
        ScanError
            As :meth:`.ScanFolder.load`.
        """
        states = states or (_files_key(folder)[0], _content_key(folder))
        recording = folder.recording()
        _log_notes(recording.notes)
        scan = scan_of(recording, folder.scene)
        return cls(folder, states, sharing(recording, scan), scan)


def ready_localizer(
    path: str | Path,
    scene: Scene,
    configuration: Configuration,
    rng: np.random.Generator,
    progress: Callable[[str, float], None] | None = None,
) -> Ready:
    """A localizer on the scan in a folder, whose pairs are read only if they were not learned from before.

    Parameters
    ----------
    path : folder of the scan
    scene : its scene, or one with fewer axes and phalanges
    configuration, rng : of the localizer
    progress : called with a description of the step and its completed fraction

    Raises
    ------
    ScanError, SceneError, ParameterError
        As :meth:`.ScanFolder.load`, :func:`learned_calibration` and :func:`~.factory.build_localizer`.
    """
    folder = ScanFolder(path)
    if configuration.model != SWEEP_MIXTURE:
        return _ready_with_another_model(folder, scene, configuration, rng, progress)
    file, key = _keys(folder, scene, configuration)
    found, states = _load(folder, file, key)
    if found is None:
        found = learn_and_keep(Reading.of(folder, states), scene, configuration, progress)
    else:
        _log_notes(found[-1].notes)
    calibration, prepared, contents = found
    localizer = assemble(prepared, configuration, calibration, rng)
    if progress:
        progress("ready", 1.0)
    return Ready(localizer, calibration, prepared.bounds, contents)


def learn_and_keep(
    reading: Reading,
    scene: Scene,
    configuration: Configuration,
    progress: Callable[[str, float], None] | None = None,
) -> tuple[Calibration, Prepared, Contents]:
    """What :func:`ready_localizer` makes a localizer of, kept for its next start if no file has changed.

    Arguments and errors are those of :func:`ready_localizer`, but for the scan, which was read.
    """
    folder, states, recording, scan = reading
    _require_columns(scan, scene)
    calibration, model = _calibration(folder.path, scan, scene, progress)
    if progress:
        progress("building the map", LEARNED)
    prepared = prepare(scan, scene, configuration, calibration, model)
    tracks = model and model.scan.tracks
    found = calibration, prepared, _contents(scan, scene, recording.notes, tracks)
    if states[-1] == _content_key(folder):  # it may be recorded at this moment
        file, key = _keys(folder, scene, configuration)
        try:
            store(file, [*map(key, states)], found)
        except (ScanError, TypeError) as error:
            _log.warning("%s; the next start learns again", error)
    return found


def _ready_with_another_model(
    folder: ScanFolder,
    scene: Scene,
    configuration: Configuration,
    rng: np.random.Generator,
    progress: Callable[[str, float], None] | None,
) -> Ready:
    """A localizer whose model was made by others: nothing of it is kept but the calibration."""
    _, _, recording, scan = Reading.of(folder)
    _require_columns(scan, scene)
    calibration = learned_calibration(folder.path, scan, scene, progress)
    localizer = build_localizer(scan, scene, configuration, rng, progress, calibration)
    return Ready(
        localizer, calibration, ScanRange.of(scan, localizer.scene), _contents(scan, scene, recording.notes)
    )


def _require_columns(scan: Scan, scene: Scene) -> None:
    """Reject a foreign scene before anything is learned."""
    scene.columns(scan.axes)
    scene.channels(scan.phalanges, scan.channels)


def _contents(scan: Scan, scene: Scene, notes: Sequence[str], tracks: Tracks | None = None) -> Contents:
    return Contents(len(scan), len(scan.sweep_numbers), make_map(scan, scene, tracks), notes)


def _keys(
    folder: ScanFolder, scene: Scene, configuration: Configuration
) -> tuple[Path, Callable[[str], str]]:
    """File of what a filter needs of a scan, and what makes its key of a state of the scan."""
    kept = _file(folder.path, scene)
    key = partial(_key, kept=kept, scene=scene, configuration=configuration)
    return kept.with_suffix(".npz"), key


def _log_notes(notes: Sequence[str]) -> None:
    for note in notes:
        _log.warning("%s", note)


def _load(folder: ScanFolder, file: Path, key: Callable[[str], str]) -> tuple[Any, tuple[str, ...]]:
    """What is kept of a scan, ``None`` if it has changed; and what says so, of which ``key`` makes keys.

    The state of the sweeps' files does, read in the same time for any number of pairs, or else their content.
    """
    files, changed_ns = _files_key(folder)
    # While a file may change without a new time, only its content is trusted.
    if changed_ns < _written_ns(file) and (found := load(file, key(files))) is not None:
        return found, ()
    states = files, _content_key(folder)
    found = load(file, key(states[-1]))
    if found is not None:
        with contextlib.suppress(ScanError):  # the next start reads the sweeps again
            store(file, [*map(key, states)], found)
    return found, states


def _files_key(folder: ScanFolder) -> tuple[str, int]:
    """Key of the scene and of the sweeps' files, which is another one after each change; and the last, ns."""
    own, found = json.dumps(scene_to_dict(folder.scene)).encode(), []
    with refusing(f"{folder.path}: could not be read", ScanError, OSError):
        for file in folder.files()[0].values():
            state = file.stat()
            found.append((file.name, state.st_ino, state.st_size, state.st_mtime_ns, state.st_ctime_ns))
    return key_of([own, repr(found).encode()]), max((each[-1] for each in found), default=0)


def _written_ns(file: Path) -> int:
    """When a file was written, ns; 0: there is none."""
    with contextlib.suppress(OSError):
        return file.stat().st_mtime_ns
    return 0


def _content_key(folder: ScanFolder) -> str:
    """Key of the scene and the bytes of all sweeps."""
    files, own = folder.files()[0].values(), json.dumps(scene_to_dict(folder.scene)).encode()
    with refusing(f"{folder.path}: could not be read", ScanError, OSError):
        sweeps = (part for file in files for part in (file.name.encode(), file.read_bytes()))
        return key_of(chain([own], sweeps))


def _key(content: str, kept: Path, scene: Scene, configuration: Configuration) -> str:
    """Key of what is learned from a content for a scene and the cells of a configuration."""
    calibration = b""
    with contextlib.suppress(OSError), open_file(kept) as file:
        calibration = file.read(_MOST_BYTES)
    own = json.dumps(scene_to_dict(dataclasses.replace(scene, name="")))
    return key_of([content.encode(), calibration, own.encode(), repr(configuration.cell).encode()])


def _file(folder: Path, scene: Scene) -> Path:
    """File of the calibration of a scan for a scene."""
    own = None
    with contextlib.suppress(SceneError):
        own = dataclasses.replace(load_scene(folder / SCENE_OF_SCAN), name=scene.name)
    text = json.dumps(scene_to_dict(dataclasses.replace(scene, name="")))
    return folder / (FILE if own in (None, scene) else f"calibration_{zlib.crc32(text.encode()):08x}.json")


def store_calibration(path: Path, digest: str, calibration: Calibration) -> None:
    """Write a calibration to a file in the folder of a scan; a failure is logged as a warning."""
    learned = {
        "registration_std": calibration.registration_std.tolist(),
        "material": calibration.material.value,
        "variance": calibration.variance and dataclasses.asdict(calibration.variance),
        "examination": dataclasses.asdict(calibration.examination),
    }
    text = json.dumps(_content(digest, learned), indent=2) + "\n"
    try:
        write_text(path, text)
    except ScanError as error:
        _log.warning("%s; the next start calibrates again", error)


def _content(digest: str, learned: dict[str, Any]) -> dict[str, Any]:
    """What the file holds."""
    checksum = zlib.crc32(json.dumps(learned).encode())
    about = {"kind": RESULT, "algorithm": ALGORITHM, "digest": digest, "checksum": checksum}
    return about | {"learned": learned}


def _examination(values: dict[str, Any]) -> Examination:
    """The examination of a scan from its JSON, which has lists in place of tuples."""
    outcomes = [Outcome(**_with_tuples(each)) for each in values.pop("outcomes")]
    return Examination(**_with_tuples(values | {"outcomes": outcomes}))


def _with_tuples(values: dict[str, Any]) -> dict[str, Any]:
    def converted(value: Any) -> Any:
        return tuple(map(converted, value)) if isinstance(value, list) else value

    return {name: converted(value) for name, value in values.items()}
