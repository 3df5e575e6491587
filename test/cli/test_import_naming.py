"""Commands that import recordings with columns, channels and scenes of one's own."""

import re
from dataclasses import replace

import pytest
from support.imports import LINE, slid, touch_and_poses, write_csv

from tactile_localizer.cli import main
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.scene import Phalanx


def test_a_scene_is_proposed_written_and_used(folder, run):
    arguments = touch_and_poses(folder)
    status, printed, _ = run(f"{arguments} -o own_scan")
    assert status == 0
    for line in (
        "own_scan.scene.yaml: a proposed scene",
        "phalanx finger: 19 channels, taxel1 to taxel19",
        "bounds of x: 0.0 to 49.5 mm (recorded), and 5 mm on each side",
        "motion_std: 0.003",
        "own_scan: 1 sweep, 100 pairs",
    ):
        assert line in printed
    scene = load_scene("own_scan.scene.yaml")
    assert (scene.layout.counts, scene.axes[0].lower, scene.axes[0].upper) == ((19,), -0.005, 0.0545)
    assert "own_scan.scene.yaml: expected no file; pass it by --scene" in run(f"{arguments} -o own_scan")[2]
    assert run(f"{arguments} --scene own_scan.scene.yaml -o again_scan")[0] == 0


def test_a_proposal_has_every_axis(folder, run):
    names = ["time", "palm_1", "y", "yaw", *(f"finger_{n}" for n in range(1, 4))]
    write_csv(folder / "touch.csv", [[0.01 * n, 0.001 * n, 0.0, 0.1, *range(3)] for n in range(60)], names)
    assert run("csv touch.csv --column stamp_s=time --column x=palm_1 -o own_scan")[0] == 0
    scene = load_scene("own_scan.scene.yaml")
    assert (scene.axis_names, scene.phalanx_names) == (("x", "y", "yaw"), ("finger",))
    assert (scene.axes[2].lower, scene.axes[2].upper) == (0.0, 0.2)
    refusal = run(f"csv touch.csv --column stamp_s=time -o {'x' * 300}")[2]
    assert "expected a writable folder, File name too long" in refusal


def test_a_proposal_in_millimetres_is_noticed(folder, run):
    arguments = touch_and_poses(folder, 1e3)
    hint = "poses.csv: x spans 49.67 m (in mm? --column x=px*0.001)"
    assert hint in run(f"{arguments} -o own_scan")[1]
    status, _, refusal = run(f"{arguments} --column y=px -o sheet_scan")
    assert status == 2
    assert refusal.index(hint) < refusal.index("expected at most 1,000,000 cells")


@pytest.mark.parametrize(
    "columns",
    [
        ["L1", "L2", "L3", "R1", "R2", "R3"],
        ["left_fx", "left_fy", "left_fz", "right_fx", "right_fy", "right_fz"],
        ["Left 1, N", "Left 2, N", "Left 3, N", "Right 1, N", "Right 2, N", "Right 3, N"],
        ["/left/strain[0]", "/left/strain[1]", "/left/strain[2]", "/r[0]", "/r[1]", "/r[2]"],
    ],
)
def test_the_phalanges_of_own_column_names_are_proposed(folder, run, columns):
    write_csv(folder / "own.csv", slid(channels=6), ["stamp_s", "x", *columns])
    status, printed, _ = run("csv own.csv -o own_scan")
    assert status == 2
    (folder / "naming.yaml").write_text(printed)
    status, printed, _ = run("csv own.csv --columns naming.yaml -o own_scan")
    assert status == 0
    assert load_scene("own_scan.scene.yaml").layout.counts == (3, 3)


def test_missing_columns_print_a_naming_to_fill_in(folder, run):
    touch_and_poses(folder)
    status, printed, refusal = run("csv touch.csv --scene scene.yaml -o own_scan")
    first, *lines = printed.splitlines()
    assert status == 2
    assert first.startswith("# columns found: time, taxel1, taxel2, ")
    quantities = ["stamp_s", "pose_stamp_s", "x", "y", "index", "middle"]
    assert [line.split(":")[0] for line in lines] == [
        *quantities[:2],
        "sweep",
        *quantities[2:],
        "strain_unit",
    ]
    assert "pass it by --columns FILE" in refusal
    columns = ("time", "t_ms*0.001", "px", "px", "taxel1..8", "taxel9..16")
    for quantity, column in zip(quantities, columns, strict=True):
        printed = re.sub(f"^{quantity}: ", f"{quantity}: {column} ", printed, flags=re.MULTILINE)
    (folder / "filled.yaml").write_text(printed)
    assert run("csv touch.csv --poses poses.csv --columns filled.yaml --scene scene.yaml -o own_scan")[0] == 0


@pytest.mark.parametrize("scene", ["", "--scene two.yaml"])
def test_one_naming_has_the_columns_of_strain_and_poses(folder, run, scene):
    touch_and_poses(folder)
    save_scene(replace(LINE, phalanges=(Phalanx("taxel", (0.0,), 19),)), folder / "two.yaml")
    status, printed, refusal = run(f"csv touch.csv --poses poses.csv {scene} -o own_scan")
    assert status == 2
    assert "# columns found in touch.csv: time, taxel1" in printed
    assert "# columns found in poses.csv: t_ms, px" in printed
    assert refusal.endswith("; or fill in the naming above and pass it by --columns FILE\n")
    filled = {"stamp_s": "time", "pose_stamp_s": "t_ms * 0.001", "x": "px"}
    for quantity, column in (filled | {"taxel": "taxel1..19"} if scene else filled).items():
        printed = re.sub(f"^{quantity}: ", f"{quantity}: {column} ", printed, flags=re.MULTILINE)
    (folder / "filled.yaml").write_text(printed)
    arguments = f"csv touch.csv --poses poses.csv --columns filled.yaml {scene} -o own_scan"
    assert "phalanx taxel: 19 channels" in run(arguments)[1] or scene
    assert ScanFolder("own_scan").recording().sweeps[0].strain_unit == "V"


def test_a_replay_without_the_poses_of_the_import_asks_for_them(folder, run, capsys):
    assert run(f"{touch_and_poses(folder)} -o own_scan")[0] == 0
    assert main(["replay", "touch.csv", "--scan", "own_scan"]) == 2
    printed = capsys.readouterr()
    assert printed.err == (
        "error: touch.csv: expected --poses FILE beside it, as own_scan was imported with poses.csv; "
        "found no column for x\n"
    )
    assert main(["replay", "poses.csv", "--poses", "poses.csv", "--scan", "own_scan"]) == 2
    assert "naming above" not in capsys.readouterr().err
