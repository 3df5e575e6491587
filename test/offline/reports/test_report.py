"""Reports: complete in one file, with what a reader looks for, and legible in a browser."""

import os
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from support.learned import unexamined

from tactile_localizer import Configuration, Recording, __version__, load_scan, make_localizer
from tactile_localizer.cli import main
from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.offline.recordings import replay_recording
from tactile_localizer.offline.replay_document import Evaluation, replay_document
from tactile_localizer.offline.reports.replay import replay_report
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import shipped_scene

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Page(HTMLParser):
    """Text, addresses and elements of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.elements: list[str] = []
        self.addresses: list[str] = []
        self.text = ""
        self.feed(self.source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_data(self, data: str) -> None:
        self.text += data


def run(arguments: str) -> int:
    return main(arguments.split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a scan, a recording of three sweeps, and the reports of both."""
    folder = tmp_path_factory.mktemp("reports")
    save_scene(shipped_scene("bump"), folder / "scene.yaml")
    for command in (
        f"simulate bump -o {folder} --test 3",
        f"import csv {folder}/train.csv --scene {folder}/scene.yaml -o {folder}/bump_scan",
        f"replay {folder}/test.csv --scan {folder}/bump_scan --report {folder}/replay.html",
        f"scan info {folder}/bump_scan --report {folder}/scan.html",
    ):
        assert run(command) == 0
    return folder


REPORTS = pytest.mark.parametrize("report", ["replay.html", "scan.html"])


@REPORTS
def test_a_report_is_one_file_that_loads_nothing(folder: Path, report: str) -> None:
    page = Page(folder / report)
    assert {"script", "link", "iframe", "object"} & set(page.elements) == set()
    outside = [
        address for address in page.addresses if not address.startswith(("#", "data:image/png;base64,"))
    ]
    assert outside == []
    assert re.findall(r"@import|url\((?!#)", page.source) == []
    assert "default-src 'none'" in page.source
    assert len(page.source) < 3_000_000


def test_a_replays_report_has_what_a_reader_looks_for(folder: Path) -> None:
    page = Page(folder / "replay.html")
    for text in (
        "test.csv on bump_scan",
        "The examination of the scan",
        "Localized: 3 of 3 sweeps right, 0 ever wrong",
        "The map",
        "Error along the sweeps",
        "The worst sweep",
        "converged after the longest travel.",
        "convergence_radius: 0.0075",
        "information length",
        f"tactile_localizer {__version__}",
        f"numpy {np.__version__}",
    ):
        assert text in page.text
    assert len(re.findall('<td class="outcome"[^>]*>right</td>', page.source)) == 3
    assert page.elements.count("svg") == 10


def test_a_recording_without_sweeps_is_an_error(folder: Path, tmp_path: Path) -> None:
    empty, report = tmp_path / "empty_scan", tmp_path / "report.html"
    empty.mkdir()
    shutil.copy(folder / "bump_scan/scene.yaml", empty)
    assert run(f"replay {empty} --scan {folder}/bump_scan --report {report}") == 2
    assert not report.exists()


def test_a_scans_report_has_its_totals_map_and_findings(folder: Path) -> None:
    page = Page(folder / "scan.html")
    for text in (
        "bump_scan",
        "No findings",
        "21",
        "channels on 2 phalanges",
        "The map",
        "import csv",
        " ever wrong, ",
    ):
        assert text in page.text
    assert page.elements.count("svg") == 6


def sheet(axes: tuple[Axis, ...], name: str = "sheet") -> Scene:
    return Scene(name, axes, (Phalanx("<b>&$", (0.0,) * len(axes)),))


X, Y, YAW = Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.01), Axis("yaw", -0.2, 0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axes", "options"),
    [((X,), ""), ((X, Y), "--filter particle"), ((X, YAW), ""), ((X, Y, YAW), "--config fast")],
    ids=["one axis", "particles", "yaw", "three axes"],
)
def test_any_scene_and_name_can_be_reported(
    axes: tuple[Axis, ...], options: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tactile_localizer.io.scans.learned.learn_model", unexamined)
    save_scene(sheet(axes, "<script>alert(1)</script>"), "scene.yaml")
    rng, x, stamp_s = np.random.default_rng(0), np.linspace(0.0, 0.05, 61), 0.0
    header = ",".join(
        ["stamp_s", "sweep", *(axis.name for axis in axes), *(f"<b>&$_{n}" for n in range(1, 9))]
    )
    lines = [header]
    for number in range(6):
        for place in x:
            stamp_s += 0.05
            state = [place, 0.002 * number, 0.08 * number - 0.2]
            values = [state[("x", "y", "yaw").index(axis.name)] for axis in axes]
            strain = np.exp(-(((place - 0.025) / 0.004) ** 2)) * np.arange(8) + rng.normal(0, 0.02, 8)
            lines.append(",".join(f"{value:.6f}" for value in (stamp_s, number, *values, *strain)))
        stamp_s += 5.0
    Path("all.csv").write_text("\n".join(lines))
    assert run("import csv all.csv --scene scene.yaml -o a_scan") == 0
    assert run(f"replay all.csv --scan a_scan --report out/r.html {options}") < 2
    assert run("scan info a_scan --report out/s.html") == 0
    for page in (Page(Path("out/r.html")), Page(Path("out/s.html"))):
        assert "script" not in page.elements
        assert {"<script>alert(1)</script>", "<b>&$"} <= set(
            re.findall(r"<script>.*?</script>|<b>&\$", page.text)
        )
    assert re.search(r"channels on 1 phalanx\b", page.text)


def test_without_a_truth_the_report_says_that_a_claim_may_be_wrong(folder: Path, tmp_path: Path) -> None:
    sweeps = read_csv(folder / "test.csv", shipped_scene("bump")).sweeps[:2]
    scan, scene = load_scan(folder / "bump_scan")
    localizer = make_localizer(scan, scene, scan_file=folder / "bump_scan")
    recording = Recording("a_bag", tuple(replace(sweep, truth=None) for sweep in sweeps))
    read = lambda: (recording, "recorded")  # noqa: E731
    replayed = replay_recording(read, lambda: localizer, None, ScanRange.of(scan, scene), None)
    made = Configuration(), Calibration(np.zeros(2)), localizer, replayed, 1, [read]
    evaluation = Evaluation("bump_scan", lambda: scan, scene, *made)
    first, again = (replay_report(evaluation, replay_document(evaluation), ["a <note>"]) for _ in range(2))
    when = r"on \d{4}-.* UTC"
    assert re.sub(when, "", first) == re.sub(when, "", again), "the same replay gives the same report"
    (tmp_path / "report.html").write_text(first)
    page = Page(tmp_path / "report.html")
    assert "so a sweep that converged may be wrong" in page.text
    assert "a <note>" in page.text
    assert "error while converged" not in page.text
    assert "error, mm" not in page.text.partition("Error along the sweeps")[2].partition("claimed there.")[0]


def in_chromium(folder: Path, report: Path, *options: str) -> subprocess.CompletedProcess:
    """Open a report in Chromium, without a network."""
    if CHROMIUM is None:
        pytest.skip("there is no Chromium: apt-get install chromium")
    command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}"]
    command += ["--enable-logging=stderr", *options, report.as_uri()]
    home = {**os.environ, "HOME": str(folder)}
    return subprocess.run(command, env=home, capture_output=True, text=True, check=True, timeout=900)


@REPORTS
@pytest.mark.parametrize("width", [390, 1280], ids=["telephone", "desk"])
def test_a_browser_shows_all_of_it_and_does_not_complain(
    folder: Path, report: str, width: int, tmp_path: Path
) -> None:
    picture = tmp_path / "shown.png"
    height = 1000 if width > 1000 else 2500
    options = f"--screenshot={picture}", f"--window-size={width},{height}"
    shown = in_chromium(tmp_path, folder / report, *options)
    assert [line for line in shown.stderr.splitlines() if "CONSOLE" in line] == []
    pixels = matplotlib.image.imread(picture)[..., :3]
    assert pixels.shape[:2] == (height, width)
    inked = (pixels.min(axis=2) < 0.9).any(axis=1)
    assert inked.mean() > 0.5, "most lines have something on them"
    assert np.ptp(pixels, axis=2).max() > 0.4, "pictures have colours"


@REPORTS
def test_nothing_is_cut_off_on_a_telephone(folder: Path, report: str, tmp_path: Path) -> None:
    opened = (folder / report).read_text().replace("<details>", "<details open>").replace('"', "&quot;")
    frame = tmp_path / "frame.html"
    measure = (
        "const page = this.contentDocument; "
        "const cut = [...page.querySelectorAll('*')].filter(part => part.scrollWidth > part.clientWidth + 1 "
        "&& getComputedStyle(part).overflowX != 'visible'); "
        "document.title = page.documentElement.scrollWidth + ' wide, ' + cut.length + ' cut off'"
    )
    frame.write_text(
        f'<meta charset="utf-8"><iframe width="390" height="800" frameborder="0" '
        f'onload="{measure}" srcdoc="{opened}"></iframe>'
    )
    dom = in_chromium(tmp_path, frame, "--dump-dom").stdout
    assert "<title>390 wide, 0 cut off</title>" in dom
