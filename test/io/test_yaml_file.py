"""YAML files are read within limits; anything but plain data is refused in one line."""

import math
import os
import time
import tracemalloc

import pytest

from tactile_localizer.errors import SceneError
from tactile_localizer.io.yaml_file import MAX_FILE_BYTES, load_yaml, parse_yaml


def load(path):
    return load_yaml(path, "a scene file", SceneError, lambda content: content)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3e-3", 0.003), ("3E3", 3000.0), (".5", 0.5), ("5.", 5.0), ("-1.25", -1.25), ("+7", 7), ("-7", -7),
        ("0", 0), ("75", 75), (".inf", math.inf), ("-.inf", -math.inf), ("true", True), ("no", False),
        ("~", None), ("a:", {"a": None}), ("''", ""), ("-pi", "-pi"), ("2*pi", "2*pi"), ("1:30", "1:30"),
        ("2001-01-01", "2001-01-01"), ("0x1F", "0x1F"), ("1_000", "1_000"), ("y", "y"), ("'3e-3'", "3e-3"),
        ("!!str 5", "5"), ("!!float 5", 5.0), ("[1, [2, a]]", [1, [2, "a"]]),
        ("{a: {b: 1}}", {"a": {"b": 1}}),
        ("a: &x [1, 2]\nb: *x", {"a": [1, 2], "b": [1, 2]}),
    ],
)  # fmt: skip
def test_values_have_the_type_they_look_like(text, value):
    found = parse_yaml(text)
    assert found == value
    assert type(found) is type(value)


def test_leading_zeros_do_not_mean_octal():
    assert parse_yaml("010") == 10.0


def test_merge_keys_are_ordinary_keys():
    assert parse_yaml("a: &a {k: 1}\nb: {<<: [*a, *a]}")["b"] == {"<<": [{"k": 1}, {"k": 1}]}


def bomb(levels=30):
    lines = ["l0: &l0 [x, x, x, x]"]
    lines += [f"l{n}: &l{n} [*l{n - 1}, *l{n - 1}, *l{n - 1}]" for n in range(1, levels)]
    return "\n".join(lines)


HOSTILE = {
    "circle": ("a: &a [*a]", "an alias within its own anchor"),
    "circle of mappings": ("a: &a {b: {c: *a}}", "an alias within its own anchor"),
    "bomb": (bomb(), "at most 20000 values"),
    "deep list": ("[" * 20_000, "at most 16 levels"),
    "deep mapping": ("{a: " * 10_000, "at most 16 levels"),
    "deep block": ("\n".join("  " * n + "a:" for n in range(180)), "at most 16 levels"),
    "binary": ("a: !!binary aGVsbG8=", "found the tag !!binary (line 1)"),
    "python": ("a: !!python/object/apply:os.system [ls]", "found the tag"),
    "set": ("a: !!set {x}", "found the tag !!set"),
    "integer key": ("1: a", "a string as a key, found 1; put it in quotes (line 1)"),
    "key that is true": ("on: 1", "a string as a key, found on; put it in quotes"),
    "key that is a list": ("[1, 2]: a", "a string as a key, found a list"),
    "twice": ("x: 1\ny: 2\nx: 3", "the key 'x' once, found it 2 times"),
    "two documents": ("a: 1\n---\nb: 2", "but found another document"),
    "wrong tag": ("!!int abc", "a value that matches its tag"),
    "unknown alias": ("a: *b", "found undefined alias"),
    "unclosed": ("a: [1, 2", "(line 1)"),
    "tab": ("a:\n\t- b", "(line 2)"),
    "large": ("# " + "x" * MAX_FILE_BYTES, "at most 64 kB"),
    "control character": ("a: \x00", "special characters are not allowed"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_unsafe_documents_are_refused_quickly(tmp_path, name):
    text, message = HOSTILE[name]
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    tracemalloc.start()
    begin = time.perf_counter()
    try:
        with pytest.raises(SceneError) as refusal:
            load(path)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert message in str(refusal.value)
    assert str(refusal.value).startswith(f"{path}: expected ")
    assert "\n" not in str(refusal.value)
    assert time.perf_counter() - begin < 5.0  # under 1 s without the tracing, on an idle machine
    assert most < 50e6


def test_other_paths_than_files_are_refused(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path, tmp_path / "fifo", "x" * 5000, "/dev/zero"):
        with pytest.raises(SceneError, match="expected a scene file, "):
            load(path)
    (tmp_path / "text").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="not UTF-8"):
        load(tmp_path / "text")
    with pytest.raises(SceneError, match="expected a scene file, found none"):
        load(tmp_path / "none")


def test_a_byte_order_mark_is_ignored(tmp_path):
    (tmp_path / "text").write_bytes(b"\xef\xbb\xbfa: 1")
    assert load(tmp_path / "text") == {"a": 1}
