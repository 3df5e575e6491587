"""The command line: subcommands, exit status, errors."""

import argparse
import os
import subprocess
import sys
import types
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from tactile_localizer import __version__, cli
from tactile_localizer.cli.outputs import require_writable, write_picture
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.scans import FORMAT
from tactile_localizer.io.whole_file import RESULT
from tactile_localizer.offline.json_file import write_json
from tactile_localizer.offline.reports.page import html_page


@pytest.fixture
def run_command(monkeypatch: pytest.MonkeyPatch):
    """A subcommand ``try`` (module ``try_``) whose body the test gives."""

    def install(body) -> None:
        module = types.ModuleType("tactile_localizer.cli.try_")
        module.add_arguments = lambda parser: None
        module.run = body
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(cli, "COMMANDS", {"try": "try something"})

    return install


def test_the_help_imports_no_subcommand() -> None:
    program = (
        "import sys; from tactile_localizer import cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print(sorted({'numpy', 'matplotlib', 'can'} & set(sys.modules)), file=sys.stderr)\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stderr == "[]\n"


def test_an_interrupt_is_status_130(run_command) -> None:
    def interrupted(args: argparse.Namespace) -> int:
        raise KeyboardInterrupt

    run_command(interrupted)
    assert cli.main(["try"]) == 130


def test_a_bug_is_not_hidden(run_command) -> None:
    run_command(lambda args: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        cli.main(["try"])


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"tactile-localizer {__version__}, scan format {FORMAT}\n"


def test_every_subcommand_explains_itself(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(["--help"])
    assert end.value.code == 0
    assert "docs/essentials.md" in capsys.readouterr().out, "where the values to set are"
    for name in cli.COMMANDS:
        with pytest.raises(SystemExit) as end:
            cli.main([name, "--help"])
        assert end.value.code == 0
        assert f"tactile-localizer {name}" in capsys.readouterr().out


def test_a_terminal_may_lack_characters(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tactile_localizer", "scan", "info", str(tmp_path / "µ\u2014a_scan")]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(command, capture_output=True, env=environment, check=False)
    assert ended.returncode == 2
    assert ended.stderr.endswith(
        rb"/\xb5\u2014a_scan: expected a scan folder, found none (with a scene.yaml)" + b"\n"
    )


def test_a_closed_pipe_ends_the_command_quietly() -> None:
    program = (
        "import sys, types; from tactile_localizer import cli\n"
        "m = types.ModuleType('tactile_localizer.cli.flood'); \n"
        "m.add_arguments = lambda parser: None\n"
        "m.run = lambda args: [print('x' * 1000) for _ in range(10000)] and 0\n"
        "sys.modules[m.__name__] = m; cli.COMMANDS = {'flood': ''}; sys.exit(cli.main(['flood']))\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as command:
        assert command.stdout is not None
        assert command.stderr is not None
        command.stdout.readline()
        command.stdout.close()
        assert command.stderr.read() == ""
        assert command.wait(30) == 141


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("replay a.csv --scan none --plot a.xyz", "a.xyz: expected a name that ends in .pdf, .png or .svg"),
        ("replay a.csv --scan none --plot file/a.png", "file/a.png: could not be written, Not a directory"),
        ("replay a.csv --scan none --plot a.png", "a.png: could not be written, Is a directory"),
        ("replay a.csv --scan none --report a.png", "a.png: could not be written, Is a directory"),
        ("scan info none --report file/a", "file/a: could not be written, Not a directory"),
        ("scan info file --report file", "file: expected another file than the inputs, found it in file"),
        ("tradeoff a.csv --scan none -o file", "file/tradeoff.png: could not be written, Not a directory"),
        ("replay a.csv --scan none --plot b.png", "none: expected a scan folder"),
        ("tradeoff a.csv --scan none --target-mm 0", "--target-mm: expected a positive number, got 0"),
    ],
)
def test_mistakes_are_found_before_the_work(
    tmp_path, monkeypatch, capsys: pytest.CaptureFixture, arguments: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "a.png").mkdir()
    assert cli.main(arguments.split()) == 2
    refusal = capsys.readouterr().err
    assert refusal.startswith(f"error: {message}")
    assert refusal.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"file", "a.png"}


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    """Folder with a recording, a result, a scan, and other names of them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bump_scan").mkdir()
    for name in ("a.csv", "b.png", "bump_scan/sweep_0001.npy"):
        (tmp_path / name).write_text(name)
    (tmp_path / "bump_scan/scene.yaml").write_text("axes: {x: {bounds: [0, 1]}}\nphalanges: {index: {}}\n")
    (tmp_path / "c.yaml").write_text(f"# {RESULT}")
    (tmp_path / "soft.png").symlink_to("b.png")
    (tmp_path / "hard.png").hardlink_to("bump_scan/sweep_0001.npy")
    (tmp_path / "other").symlink_to("bump_scan")
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        "replay a.csv --scan bump_scan --json ./bump_scan/../a.csv",
        "replay b.png --scan bump_scan --plot soft.png",
        "replay soft.png --scan bump_scan --plot b.png",
        "replay a.csv --scan bump_scan --plot hard.png",
        "replay a.csv --scan other --json bump_scan/sweep_0001.npy",
        "replay a.csv --scan bump_scan --json other/sweep_0002.npy",
        "replay a.csv bump_scan --scan none --json bump_scan/new.json",
        "replay a.csv --scan bump_scan --scene c.yaml --json c.yaml",
        "replay a.csv --scan bump_scan --config c.yaml --json c.yaml",
        "replay a.csv --scan bump_scan --columns c.yaml --json c.yaml",
        "replay a.csv --scan bump_scan --poses c.yaml --poses b.png --plot b.png",
        "replay a.csv --scan bump_scan --adapter c.yaml --json c.yaml",
        "tradeoff a.csv --scan bump_scan -o bump_scan/new",
        "scan plot bump_scan -o other",
    ],
)
def test_no_output_replaces_an_input(inputs, capsys: pytest.CaptureFixture, arguments: str) -> None:
    before = {path: path.read_bytes() for path in inputs.rglob("*") if path.is_file()}
    assert cli.main(arguments.split()) == 2
    refusal = capsys.readouterr().err
    assert "expected another file than the inputs, found it in " in refusal or "hard.png" in arguments
    assert refusal.startswith("error: ")
    assert refusal.count("\n") == 1
    assert {path: path.read_bytes() for path in inputs.rglob("*") if path.is_file()} == before


OUTPUTS = {
    "demo -o D": "scan/scene.yaml bag/metadata.yaml log/a.log replay.json replay.png",
    "import csv a.csv --scene s/scene.yaml -o D/scan": "scan/scene.yaml scan/a scan",
    "import csv a.csv -o D/scan": "scan.scene.yaml",
    "scan info s --json D/a.json": "a.json",
    "scan info s --report D/a.html": "a.html",
    "scan plot s -o D": "map_index.png",
    "tradeoff a.csv --scan s -o D --target-mm 1": "tradeoff.png tradeoff.json configuration.yaml",
    "replay a.csv --scan s --json D/a.json": "a.json",
    "replay a.csv --scan s --plot D/a.svg --json D/a.json": "a.svg a.json",
    "replay a.csv --scan s --report D/a.html": "a.html",
    "simulate bump -o D --channels 8 6": "train.csv test.csv scene.yaml",
}
"""Files that each command line would write."""


@pytest.mark.parametrize(
    ("arguments", "kept"), [(a, name) for a, names in OUTPUTS.items() for name in names.split()]
)
def test_no_output_replaces_a_file_that_is_no_result(
    tmp_path, monkeypatch, capsys: pytest.CaptureFixture, arguments: str, kept: str
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [f"{0.1 * row},{0.01 * row},{row}" for row in range(5)]
    Path("a.csv").write_text("\n".join(["stamp_s,x,index_1", *rows]))
    Path("s").mkdir()
    Path("s/scene.yaml").write_text("axes: {x: {bounds: [0, 1]}}\nphalanges: {index: {channels: 1}}\n")
    Path("D", kept).parent.mkdir(parents=True)
    Path("D", kept).write_text("of the user")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert cli.main(arguments.split()) == 2
    refusal = capsys.readouterr().err
    assert refusal.startswith(f"error: {Path('D', kept.partition('/')[0])}: expected no")
    assert refusal.count("\n") == 1
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_every_command_is_tried_over_files_of_the_user() -> None:
    assert {arguments.split()[0] for arguments in OUTPUTS} == cli.COMMANDS.keys()


def test_results_are_replaced(tmp_path) -> None:
    figure = Figure()
    for name in ("a.png", "a.svg", "a.pdf"):
        write_picture(tmp_path / name, figure)
    write_json(tmp_path / "a.json", {"long": [0] * 10_000})
    (tmp_path / "a.html").write_text(
        html_page(
            **dict.fromkeys(
                ("kind", "title", "good", "verdict", "explained", "notes", "tiles", "sections"), ""
            )
        )
    )
    for name in ("a.png", "a.svg", "a.pdf", "a.json", "a.html"):
        require_writable(tmp_path / name, argparse.Namespace())


@pytest.mark.parametrize("seed", ["-1", "x", "1.5"])
@pytest.mark.parametrize("command", [["replay", "a.csv", "--scan", "a_scan"], ["simulate", "bump"], ["demo"]])
def test_a_seed_that_is_no_number_is_refused(command, seed, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main([*command, "--seed", seed])
    refusal = capsys.readouterr().err
    assert "argument --seed" in refusal
    assert f"got {seed};" in refusal


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("relay a.csv --scan a_scan", "replay"),
        ("scan inf a_scan", "info"),
        ("import cvs a.csv", "csv"),
        ("replay a.csv --scan a_scan --filter gird", "grid"),
        ("replay a.csv --scan a_scan --rport=a.html", "--report"),
        ("scan info a_scan --jsn a.json", "--json"),
        ("REPLAY a.csv", "replay"),
        ("--vresion", "--version"),
        ("replay a.csv --sacn a_scan", "--scan"),
        ("import csv a.csv --scnee=bump.yaml --mni-samples", "--scene"),
    ],
)
def test_a_misspelled_word_has_a_suggestion(typed: str, meant: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(typed.split())
    assert f" (did you mean {meant}?); `" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("", "tactile-localizer"),
        ("replay", "tactile-localizer replay"),
        ("replay a.csv --scan a_scan --max-gap -1", "tactile-localizer replay"),
        ("replay a.csv --scan", "tactile-localizer replay"),
        ("replay a.csv --scan a_scan --nothing", "tactile-localizer replay"),
        ("scan info", "tactile-localizer scan info"),
        ("import csv a.csv", "tactile-localizer import csv"),
    ],
)
def test_a_wrong_command_line_is_one_line_with_the_help(
    typed: str, expected: str, capsys: pytest.CaptureFixture
) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(typed.split())
    line, end = capsys.readouterr().err.split("\n")
    assert line.startswith("error: ")
    assert line.endswith(f"; `{expected} --help` shows what can be given")
    assert not end


@pytest.mark.parametrize(
    "typed", ["replay a.csv --scan=", "replay a.csv --scan a_scan --json=", "scan info=", "simulate bump -o="]
)
def test_an_empty_path_is_refused(typed: str, capsys: pytest.CaptureFixture) -> None:
    *others, option = typed.split()
    with pytest.raises(SystemExit, match="2"):
        cli.main([*others, *option.partition("=")[::2]])
    assert "expected a path, got an empty text" in capsys.readouterr().err


def test_a_path_may_begin_with_the_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cli.main(["simulate", "none", "--train", "1", "--test", "1", "--output=~/out"]) == 0
    assert (tmp_path / "out/train.csv").exists()
    arguments = ["import", "csv", "~/out/train.csv", "--scene=bump.yaml", "--output=~/out/scan"]
    assert cli.main(arguments) == 0
    assert cli.main(["scan", "info", "~/out/scan", "--json=~/out/scan.json"]) == 0
    assert (tmp_path / "out/scan.json").exists()


def test_a_device_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/null"), tmp_path / "pipe"):
        with pytest.raises(ParameterError, match="expected a file, found a pipe or a device"):
            require_writable(path, argparse.Namespace())


def test_a_word_that_resembles_none_has_no_suggestion(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["xyzzy"])
    assert "did you mean" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("rep", {"replay "}),
        ("scan ", {"info", "plot"}),
        ("replay --filter ", {"grid", "particle"}),
        ("replay --od", {"--odometry "}),
    ],
)
def test_a_shell_completes_commands_and_choices(typed: str, offered: set[str], tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    line = f"tactile-localizer {typed}"
    shell = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "offered"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    program = "from tactile_localizer.cli import main; main()"
    subprocess.run([sys.executable, "-c", program], env={**os.environ, **shell}, check=True)
    words = (tmp_path / "offered").read_text().split("\013")
    assert offered <= set(words)
    assert all(word.startswith(typed.rpartition(" ")[2]) for word in words)
