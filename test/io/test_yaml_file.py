"""YAML files are read safely; anything but plain data is refused in one line."""

import os
import time

import pytest

from tactile_localizer.errors import SceneError
from tactile_localizer.io.yaml_file import MAX_FILE_BYTES, load_yaml, parse_yaml


def load(path):
    return load_yaml(path, "a scene file", SceneError, lambda content: content)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3e-3", 0.003), ("3E3", 3000.0), (".5", 0.5), ("75", 75), ("'3e-3'", "3e-3"), ("-pi", "-pi"),
        ("a:", {"a": None}),
    ],
)  # fmt: skip
def test_values_have_the_type_they_look_like(text, value):
    found = parse_yaml(text)
    assert found == value
    assert type(found) is type(value)


HOSTILE = {
    "circle": ("a: &a [*a]", "no alias (line 1)"),
    "bomb": ("a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]", "no alias"),
    "deep list": ("[" * 20_000, "found too many lists in lists"),
    "python": ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
    "twice": ("x: 1\ny: 2\nx: 3", "each key once (line 1)"),
    "two documents": ("a: 1\n---\nb: 2", "but found another document"),
    "wrong tag": ("!!int abc", "invalid literal"),
    "list as key": ("[1, 2]: a", "found unhashable key"),
    "unclosed": ("a: [1, 2", "(line 1)"),
    "large": ("# " + "x" * MAX_FILE_BYTES, "at most 64 kB"),
    "control character": ("a: \x00", "special characters are not allowed"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_unsafe_documents_are_refused_quickly(tmp_path, name):
    text, message = HOSTILE[name]
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    begin = time.process_time()
    with pytest.raises(SceneError) as refusal:
        load(path)
    assert message in str(refusal.value)
    assert str(refusal.value).startswith(f"{path}: expected ")
    assert "\n" not in str(refusal.value)
    assert time.process_time() - begin < 20.0


def test_other_paths_than_files_are_refused(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "text").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path, tmp_path / "fifo", "x" * 5000, "/dev/zero", tmp_path / "none", tmp_path / "text"):
        with pytest.raises(SceneError, match="expected a scene file, "):
            load(path)
