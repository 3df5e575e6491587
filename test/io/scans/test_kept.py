"""What a filter needs of a scan is kept, and used only as long as it is what would be learned."""

import dataclasses
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.learned import unexamined
from support.sweeps import write_scan

from tactile_localizer.cli import main
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.io.scans import kept, learned
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import ready_localizer
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_scan(tmp_path / "scan")
    return tmp_path / "scan"


@pytest.fixture
def prepared(monkeypatch: pytest.MonkeyPatch) -> list[Scene]:
    """Scenes for which a scan was read and learned from."""
    scenes, prepare = [], learned.prepare

    def counted(scan: object, scene: Scene, *others: object) -> object:
        scenes.append(scene)
        return prepare(scan, scene, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(learned, "prepare", counted)
    return scenes


def ready(path: Path, configuration: Configuration | None = None, scene: Scene | None = None) -> Localizer:
    scene = scene or ScanFolder(path).scene
    return ready_localizer(path, scene, configuration or Configuration(), np.random.default_rng(0)).localizer


def test_a_start_from_what_was_kept_imports_no_scipy(path: Path) -> None:
    """Which takes longer than all else: the pages promise how soon the first estimate is there."""
    ready(path)
    stamp_ns, position, strain, _ = next(iter(ScanFolder(path).recording().sweeps[0].samples()))
    sample = f"{stamp_ns}, np.array({position.tolist()}), np.array({strain.tolist()})"
    code = (
        "import sys, numpy as np\n"
        "import tactile_localizer.cli.replay, tactile_localizer.cli.recordings\n"
        "from tactile_localizer.core.configuration import Configuration\n"
        "from tactile_localizer.io.scans.folder import ScanFolder\n"
        "from tactile_localizer.io.scans.learned import ready_localizer\n"
        "scene, rng = ScanFolder(sys.argv[1]).scene, np.random.default_rng(0)\n"
        "localizer = ready_localizer(sys.argv[1], scene, Configuration(), rng).localizer\n"
        f"localizer.update({sample})\n"
        "print([name for name in sys.modules if name.partition('.')[0] == 'scipy'])\n"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def estimates(localizer: Localizer, path: Path) -> list[Estimate]:
    (sweep, *_) = ScanFolder(path).recording().sweeps
    return [localizer.update(*sample) for sample in sweep.samples()]


def test_a_localizer_that_was_kept_gives_the_digits_of_the_one_that_learned(
    path: Path, prepared: list[Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = estimates(ready(path), path)
    with monkeypatch.context() as patch:
        patch.setattr(ScanFolder, "recording", None)  # the pairs are not read again
        again = ready(path)
    assert len(prepared) == 1
    for one, other in zip(first, estimates(again, path), strict=True):
        for name, value in one._asdict().items():
            np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


def test_a_start_from_what_was_kept_reads_no_sweep(
    path: Path, prepared: list[Scene], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it would take the longer the larger the scan is; of a copy it does once."""
    ready(path)
    copy = shutil.copytree(path, tmp_path / "copy")
    ready(copy)
    monkeypatch.setattr(learned, "_content_key", None)
    ready(path)
    ready(copy)
    assert len(prepared) == 1


def test_a_start_after_an_import_reads_no_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor learns it the map again: an import has learned it."""
    monkeypatch.setattr(learned, "learn_model", unexamined)
    scene, scan = resource_path("examples/recordings/engine_bump") / "scene.yaml", tmp_path / "scan"
    train = scene.with_name("train.csv.gz")
    assert main(["import", "csv", f"{train}", "--scene", f"{scene}", "-o", f"{scan}"]) == 0
    monkeypatch.setattr(ScanFolder, "recording", None)
    monkeypatch.setattr(learned, "_content_key", None)
    ready(scan)


def test_what_changed_is_learned_again(
    path: Path, prepared: list[Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = ScanFolder(path).scene
    other = dataclasses.replace(scene, phalanges=scene.phalanges[:1])
    calibration, sweep, model = (
        path / name for name in ("calibration.json", "sweep_0001.npy", "calibration.npz")
    )

    def rewritten(file: Path) -> Callable[[], object]:
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        return lambda: file.write_bytes(content)

    ready(path)
    changes: dict[str, Callable[[], object]] = {
        "damage": rewritten(model),
        "code": lambda: monkeypatch.setattr(kept, "_code", lambda: b"other"),
        "pairs": rewritten(sweep),
        "calibration": calibration.unlink,
    }
    monkeypatch.setattr(learned, "learn_model", lambda *_: (learned.Calibration(np.full(2, 1e-3)), None))
    for count, (name, change) in enumerate(changes.items(), start=2):
        change()
        ready(path)
        ready(path)
        assert len(prepared) == count, name
    for choices, of in ((Configuration(cell=1.0), scene), (None, other)):
        count += 1
        ready(path, choices, of)
        ready(path, choices, of)
        assert len(prepared) == count
