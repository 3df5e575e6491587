"""Mutated recordings through import, replay and scan info: each gives a result or one line of error.

    scripts/in_env python benchmarks/robustness.py --files 30000

Files are truncated, bits and bytes of them change, columns and lines are dropped or repeated, texts change
their encoding, and numbers become huge, empty or NaN. What raises an exception, prints more than a line of
error, takes over five seconds of processor time or over 1 GB of memory is a fault: it is printed, and its
file kept.
"""

import argparse
import contextlib
import io
import re
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from rosbags import rosbag2

from tactile_localizer.cli import main
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.scans import learned
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import learned_calibration

_MOST_S, _MOST_BYTES = 5.0, 2**30
"""Longest processor time of a command, s (a busy machine takes longer), and the memory it may take."""
_NUMBERS = ("nan", "inf", "1e308", "-1e308", "1e-320", "9" * 400, "", "0x1F", "1,5", "true", "-0", "é")
_SCENE = """\
name: line
axes: {x: {bounds: [0.0, 0.05]}}
phalanges: {index: {channels: 4}, thumb: {offset: {x: 0.01}, channels: 2}}
"""
_COLUMNS = "stamp_s: t * 0.001\nx: px * 0.001\nindex: g1..4\nthumb: [h1, h2]\n"
_SWEEPS, _SAMPLES = 3, 40


def rows(seed: int) -> np.ndarray:
    """Stamps (s), sweeps, positions (m) and six strains of a hand that slides over a bump."""
    rng, n = np.random.default_rng(seed), _SWEEPS * _SAMPLES
    stamp, sweep = 0.02 * np.arange(n), np.repeat(np.arange(_SWEEPS), _SAMPLES)
    x = np.tile(np.linspace(0.0, 0.05, _SAMPLES), _SWEEPS)
    bump = np.exp(-0.5 * ((x - 0.025) / 0.004) ** 2)[:, None] * np.arange(1, 7)
    return np.column_stack([stamp + 1, sweep, x, bump + 0.02 * rng.standard_normal((n, 6))])


def write_originals(folder: Path) -> dict[str, list[str]]:
    """Write a file of each kind; returns the command lines that read it, by name."""
    folder.mkdir(parents=True)
    (folder / "scene.yaml").write_text(_SCENE)
    (folder / "columns.yaml").write_text(_COLUMNS)
    names = [*channel_names("index", 4), *channel_names("thumb", 2)]
    train, test = rows(1), rows(2)
    own = train[:, [0, 2, *range(3, 9)]] * np.array([1e3, 1e3, *[1.0] * 6])
    for name, table, header, separator in (
        ("train", train, ["stamp_s", "sweep", "x", *names], ","),
        ("test", test, ["stamp_s", "sweep", "x", *names], ","),
        ("own", own, ["t", "px", "g1", "g2", "g3", "g4", "h1", "h2"], ";"),
        ("strain", train[:, [0, *range(3, 9)]], ["stamp_s", *names], ","),
        ("poses", train[:, [0, 2]], ["stamp_s", "x"], ","),
    ):
        first = separator.join(header)
        np.savetxt(folder / f"{name}.csv", table, "%.6g", separator, header=first, comments="")
    write_bags(folder, train)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        if main(f"import csv {folder}/train.csv --scene {folder}/scene.yaml -o {folder}/scan".split()):
            raise SystemExit("the original cannot be imported")
    scene = f"--scene {folder}/scene.yaml"
    replay = f"replay {{file}} --scan {folder}/scan --config fast"
    csv, bag = (["import " + kind + " {file} " + scene + " -o {out}", replay] for kind in ("csv", "bag"))
    naming = f"--columns {folder}/columns.yaml --detect-sweeps both_ways"
    of_scan = ["scan info {scan}", f"replay {folder}/test.csv --scan {{scan}} --config fast"]
    return {
        "train.csv": [*csv, "import csv {file} -o {out}"],
        "own.csv": [f"import csv {{file}} {scene} {naming} -o {{out}}"],
        "strain.csv": [f"import csv {{file}} {scene} --poses {folder}/poses.csv -o {{out}}"],
        "poses.csv": [f"import csv {folder}/strain.csv {scene} --poses {{file}} -o {{out}}"],
        "bag.mcap": bag,
        "bag.db3": bag,
        "bag.mcap.zstd": bag,
        "scene.yaml": [f"import csv {folder}/train.csv --scene {{file}} -o {{out}}"],
        "columns.yaml": [f"import csv {folder}/own.csv {scene} --columns {{file}} -o {{out}}"],
        "scan/scene.yaml": ["scan info {scan}"],
        "scan/sweep_0001.npy": of_scan,
        "scan/calibration.json": ["scan info {scan}"],
        "scan/history.jsonl": ["scan info {scan}"],
    }


def write_bags(folder: Path, table: np.ndarray) -> None:
    """Write the rows as bags of each storage."""
    store = typestore()
    kinds = store.types
    types = {"/strain": "tactile_localizer/msg/StrainVectors", "/palm_pose": "geometry_msgs/msg/PoseStamped"}
    for name, plugin in (("bag.mcap", "MCAP"), ("bag.db3", "SQLITE3"), ("bag.mcap.zstd", "MCAP")):
        writer = rosbag2.Writer(folder / "made", version=9, storage_plugin=rosbag2.StoragePlugin[plugin])
        if name.endswith(".zstd"):
            writer.set_compression(rosbag2.CompressionMode.FILE, rosbag2.CompressionFormat.ZSTD)
        with writer:
            topics = {
                topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in types.items()
            }
            for stamp, _, x, *strain in table.tolist():
                at = round(stamp * 1e9) + 1_700_000_000_000_000_000
                time_of = kinds["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
                header = kinds["std_msgs/msg/Header"](stamp=time_of, frame_id="material")
                place = kinds["geometry_msgs/msg/Point"](x=x, y=0.0, z=0.0)
                turn = kinds["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
                pose = kinds["geometry_msgs/msg/Pose"](position=place, orientation=turn)
                messages = {
                    "/palm_pose": kinds["geometry_msgs/msg/PoseStamped"](header=header, pose=pose),
                    "/strain": kinds["tactile_localizer/msg/StrainVectors"](
                        header=header,
                        phalanges=["index", "thumb"],
                        strain=np.array(strain),
                        status=np.zeros(2, dtype=np.uint8),
                        sequence=np.full(2, round(stamp * 50), dtype=np.uint32),
                        channels=np.array([4, 2], dtype=np.uint16),
                    ),
                }
                for topic, message in messages.items():
                    writer.write(topics[topic], at, store.serialize_cdr(message, types[topic]))
        (made,) = (path for path in (folder / "made").iterdir() if path.name != "metadata.yaml")
        made.rename(folder / name)
        shutil.rmtree(folder / "made")


def mutated(content: bytes, is_text: bool, rng: np.random.Generator) -> bytes:
    """The content after one to three changes."""
    for _ in range(rng.integers(1, 4)):
        change = rng.choice(_CHANGES[: len(_CHANGES) if is_text else 4])
        content = change(content, rng) if content else content
    return content


def _cut_short(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: rng.integers(len(content) + 1)]


def _flip_bits(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for at in rng.integers(len(content), size=rng.integers(1, 9)):
        changed[at] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _replace_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    at, length = rng.integers(len(content)), rng.integers(0, 17)
    value = rng.choice([bytes(length), b"\xff" * int(length), rng.bytes(length), b""])
    return content[:at] + bytes(value) + content[at + rng.integers(0, 17) :]


def _repeat_a_part(content: bytes, rng: np.random.Generator) -> bytes:
    begin, end = sorted(rng.integers(len(content) + 1, size=2).tolist())
    return content[:end] + content[begin:]


def _change_a_number(content: bytes, rng: np.random.Generator) -> bytes:
    found = list(re.finditer(rb"-?[0-9]+(?:\.[0-9]*)?(?:e[-+]?[0-9]+)?", content))
    for match in reversed(found):
        if rng.random() * len(found) < 3.0:
            content = content[: match.start()] + str(rng.choice(_NUMBERS)).encode() + content[match.end() :]
    return content


def _change_a_column(content: bytes, rng: np.random.Generator) -> bytes:
    lines = [line.split(b",") for line in content.split(b"\n")]
    at, value = rng.integers(12), rng.choice([*_NUMBERS, "drop"])
    for line in lines[rng.integers(2) :]:
        if at < len(line):
            line[at : at + 1] = [] if value == "drop" else [str(value).encode()]
    return b"\n".join(b",".join(line) for line in lines)


def _change_lines(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    order = rng.choice([0, 1, 2])
    if order == 0:
        lines = lines[:: int(rng.choice([-1, 2, 3]))]
    elif order == 1:
        lines.insert(rng.integers(len(lines) + 1), lines[rng.integers(len(lines))])
    else:
        del lines[rng.integers(len(lines))]
    return b"\n".join(lines)


def _encode(content: bytes, rng: np.random.Generator) -> bytes:
    name = str(rng.choice(["utf-16", "utf-8-sig", "utf-32", "utf-16-be", "cp500"]))
    return content.decode("latin-1").encode(name, errors="replace")


def _separate(content: bytes, rng: np.random.Generator) -> bytes:
    one, other = rng.choice([b",", b";", b"\t", b" ", b".", b'"', b"\r\n", b"#", b":"], size=2)
    return content.replace(bytes(one), bytes(other))


_CHANGES = [
    _cut_short,
    _flip_bits,
    _replace_bytes,
    _repeat_a_part,
    _change_a_number,
    _change_a_column,
    _change_lines,
    _encode,
    _separate,
]
"""Changes, the first four also of files that are no text."""


class _TooLongError(BaseException):
    """A command takes longer than it may."""


def _alarm(*_: object) -> None:
    raise _TooLongError


def _limit() -> None:
    """Raise an exception in a command that takes too long or too much memory."""
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, _alarm)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + _MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


def outcome(arguments: list[str]) -> str:
    """What a command did: its status, or what is wrong with it."""
    printed, refused = io.StringIO(), io.StringIO()
    signal.setitimer(signal.ITIMER_PROF, _MOST_S)
    signal.alarm(int(40 * _MOST_S))  # one that waits for something
    try:
        with (
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(refused),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("error", RuntimeWarning)
            status = main(arguments)
    except _TooLongError:
        return f"FAULT: over {_MOST_S:g} s\n" + traceback.format_exc()
    except SystemExit as end:
        return f"FAULT: exit {end.code}: {refused.getvalue()}"
    except Exception:
        return "FAULT: " + traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.alarm(0)
    if status == 2 and not (refused.getvalue().startswith("error: ") and refused.getvalue().count("\n") == 1):
        return f"FAULT: not one line: {refused.getvalue()}"
    return f"status {status}"


def run(files: int, limit_s: float, out: Path, seed: int) -> int:
    """Try mutated files, print how often each outcome came, and return the number of faults."""
    originals = out / "originals"
    shutil.rmtree(out, ignore_errors=True)
    commands = write_originals(originals)
    folder = ScanFolder(originals / "scan")
    known = learned_calibration(folder.path, folder.load(), folder.scene)
    learned.learn_model = lambda *_: (known, None)  # which takes a second, and reads no file
    _limit()
    rng, begun_s = np.random.default_rng(seed), time.monotonic()
    counts, faults = Counter[str](), Counter[str]()
    tried, slowest = 0, (0.0, "")
    while tried < files and time.monotonic() - begun_s < limit_s:
        name = str(rng.choice(list(commands)))
        content = (originals / name).read_bytes()
        damaged = mutated(content, not name.endswith((".npy", ".mcap", ".db3", ".zstd")), rng)
        shutil.rmtree(out / "tried", ignore_errors=True)
        shutil.copytree(originals / "scan", out / "tried/scan")
        file = out / "tried" / name
        file.write_bytes(damaged)
        paths = {"file": file, "out": out / "tried/made", "scan": out / "tried/scan"}
        arguments = str(rng.choice(commands[name])).format(**paths).split()
        began_s = time.monotonic()
        found = outcome(arguments)
        slowest = max(slowest, (time.monotonic() - began_s, " ".join(arguments)))
        tried += 1
        counts[f"{arguments[0]} {name}: {found.splitlines()[0]}"] += 1
        if found.startswith("FAULT"):
            kind = found.strip().splitlines()[-1]
            faults[kind] += 1
            if faults[kind] == 1:
                kept = out / f"fault_{len(faults)}_{name.replace('/', '_')}"
                kept.write_bytes(damaged)
                print(f"{kept}: {' '.join(arguments)}\n{found}", flush=True)
        if tried % 500 == 0:
            done = f"{tried} files, {sum(faults.values())} faults, {time.monotonic() - begun_s:.0f} s"
            print(done, file=sys.stderr, flush=True)
    print(*(f"{count:6} {what}" for what, count in sorted(counts.items())), sep="\n")
    print(f"{tried} files, {sum(faults.values())} faults, slowest {slowest[0]:.1f} s: {slowest[1]}")
    return sum(faults.values())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=30_000, help="number of files (default 30,000)")
    parser.add_argument("--limit-s", type=float, default=1200.0, help="longest time, s (default 1200)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--out", type=Path, default=Path("out/robustness"))
    given = parser.parse_args()
    sys.exit(run(given.files, given.limit_s, given.out, given.seed) > 0)
