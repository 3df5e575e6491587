"""The package as a library, and the example of the README."""

import gzip
import json
import re
import subprocess
import sys
from contextlib import redirect_stdout
from functools import lru_cache
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

import tactile_localizer
from tactile_localizer import Configuration
from tactile_localizer.cli import main
from tactile_localizer.errors import TactileLocalizerError
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scene_file import load_scene

ROOT = Path(__file__).parents[1]
BUMP = ROOT / "examples/recordings/engine_bump"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("library")
    (folder / "test.csv.gz").symlink_to(BUMP / "test.csv.gz")
    with gzip.open(BUMP / "test.csv.gz", "rt") as file:
        header, *rows = file
    (folder / "first.csv").write_text("".join([header, *(row for row in rows if row.split(",")[1] == "0")]))
    scene = load_scene(BUMP / "scene.yaml")
    recording = read_csv(BUMP / "train.csv.gz", scene)
    import_recording(recording, scene, folder / "bump_scan")
    return folder


def example(text):
    """The lines of the library example in a text, dedented."""
    (block,) = re.findall(r"(?m)^    from tactile_localizer import .*\n(?:(?:    .*)?\n)+", text)
    return re.sub(r"(?m)^    ", "", block)


def test_the_readmes_six_lines_are_the_exact_replay(recorded, replayed, capsys):
    code = example((ROOT / "README.md").read_text())
    assert len([line for line in code.splitlines() if line]) == 6
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=recorded, capture_output=True, text=True, check=False, timeout=900
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    replay = f"replay {recorded}/first.csv --scan {recorded}/bump_scan --odometry exact --json -"
    assert main(replay.split()) == 0
    each = json.loads(capsys.readouterr().out)["updates"][-1]
    mean, truth = np.array(each["mean"]), np.array(each["truth"])
    assert done.stdout == f"true {truth} error {mean - truth} {each['reason']}\n"


@pytest.fixture(scope="module")
def replayed(recorded):
    """What the replay of the README prints; its document is ``out.json``, and what it learned is stored."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
        patch.chdir(recorded)
        assert main(["replay", "test.csv.gz", "--scan", "bump_scan", "--json", "out.json"]) == 0
    return printed.getvalue()


def test_the_readmes_replay_ends_as_it_says(replayed):
    (promised,) = re.findall(r"`(localized: .*, 0 ever wrong), \.\.\.`", (ROOT / "README.md").read_text())
    assert replayed.splitlines()[-1].startswith(promised)


def test_the_sweep_of_the_page_on_models_is_known_where_it_says(recorded, replayed, monkeypatch):
    monkeypatch.chdir(recorded)
    page = (ROOT / "docs/models.md").read_text()
    (block,) = re.findall(r"the deviation is the belief's:\n\n((?:(?:    .*)?\n)+)", page)
    with redirect_stdout(StringIO()) as printed:
        exec(re.sub(r"(?m)^    ", "", block), {})
    promised = re.findall(r"(?m)^    (\d+ mm): .*, (not converged|converged): ", page)
    found = re.findall(r"(?m)^(\d+ mm): .*, (not converged|converged): ", printed.getvalue())
    assert len(promised) == 8
    assert promised == found[:8], "those before it begin with a space"


def test_a_recording_and_its_replay_go_to_pandas_in_ten_lines(recorded, replayed, monkeypatch):
    pd = pytest.importorskip("pandas")
    monkeypatch.chdir(recorded)
    (block,) = re.findall(r"### To pandas\n\n((?:(?:    .*)?\n)+)", (ROOT / "docs/offline.md").read_text())
    code = re.sub(r"(?m)^    ", "", block)
    assert len([line for line in code.splitlines() if line]) <= 10
    made = {}
    exec(code.replace("print(", "found = ("), made)
    assert isinstance(made["found"], pd.DataFrame)
    assert made["found"]["error_m"].notna().sum() == 18
    assert made["found"].columns[-1] == 15, "the last of 16 channels"


def test_the_package_docstring_shows_the_same_example():
    of_readme = example((ROOT / "README.md").read_text())
    assert example(tactile_localizer.__doc__ + "\n").strip() == of_readme.strip()


def localizer(recorded, **options):
    scan, scene = tactile_localizer.load_scan(recorded / "bump_scan")
    kept = {"scan_file": recorded / "bump_scan"} | options
    return tactile_localizer.make_localizer(scan, scene, **kept)


def build(recorded, **choices):
    localizer(recorded, configuration=Configuration(**choices))


@lru_cache
def built(recorded):
    return localizer(recorded)


def update(recorded, stamp_ns=0, position=(0.01, 0.01), strain=(0.0,) * 16):
    built(recorded).update(stamp_ns, np.array(position), np.array(strain))


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (
            lambda folder: build(folder, model="os:system"),
            "'os:system': expected a class system in os",
        ),
        (lambda folder: build(folder, model="os:Hill"), "'os:Hill': expected a class Hill in os, found None"),
        (lambda folder: build(folder, model="none:Model"), "model 'none:Model': .*PYTHONPATH"),
        (
            lambda folder: localizer(folder, scan_file=folder / "bmup_scan"),
            "bmup_scan: expected a scan",
        ),
        (lambda folder: localizer(folder, seed=-1), "seed: expected at least 0, got -1"),
        (lambda folder: Configuration(particles="5"), "particles: expected a .*number, got '5'"),
        (lambda folder: tactile_localizer.load_scan("x" * 300), "expected a scan folder, found none"),
        (lambda folder: update(folder, stamp_ns=None), "stamp_ns: expected .* got None"),
        (lambda folder: update(folder, position=(0.01,)), "position: expected 2 finite numbers"),
        (lambda folder: update(folder, strain=(0.0,) * 7), r"strain: expected .*16"),
        (
            lambda folder: update(folder, strain=("0.1",) * 16),
            r"strain: expected real numbers, got array\(\['",
        ),
        (lambda folder: update(folder, position=(1j, 0.0)), "position: expected real numbers, got array"),
    ],
)
def test_a_mistake_is_an_error_of_one_line(recorded, mistake, message):
    with pytest.raises(TactileLocalizerError, match=message) as refusal:
        mistake(recorded)
    assert "\n" not in str(refusal.value)


def test_every_public_name_is_there():
    for name in tactile_localizer.__all__:
        assert getattr(tactile_localizer, name).__name__ == name
    assert dir(tactile_localizer) == sorted([*tactile_localizer.__all__, "__version__"])
    with pytest.raises(AttributeError, match="no attribute 'localise'"):
        tactile_localizer.localise  # noqa: B018


def test_objects_are_shown_in_one_line(recorded):
    scan, scene = tactile_localizer.load_scan(recorded / "bump_scan")
    recording = tactile_localizer.read_recording(recorded / "test.csv.gz", scene)
    shown = [repr(each) for each in (scan, recording, recording.sweeps[0], built(recorded))]
    assert shown == [
        f"<Scan of {len(scan)} pairs in 42 sweeps along x, y: index, middle, 16 channels>",
        f"<Recording {recorded / 'test.csv.gz'} of {len(recording)} samples in 18 sweeps>",
        f"<RecordedSweep {recording.sweeps[0].number} of {len(recording.sweeps[0])} samples>",
        f"<Localizer on {scene.name} (x, y): GridFilter, SweepMixture>",
    ]
