"""Damaged scenes, namings, CSV files and bags give a result or one line, never another exception."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.bags import SCENE, file_of, slide, write_bag

from tactile_localizer.errors import TactileLocalizerError
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.csv.columns import channel_names, load_naming
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scene_file import load_scene, save_scene

DAMAGE = st.lists(
    st.tuples(st.floats(0, 1), st.binary(max_size=8), st.integers(0, 8)), min_size=1, max_size=4
)

BAGS = {"bag.mcap": ("mcap",), "bag.db3": ("sqlite3",), "bag.mcap.zstd": ("mcap", "file")}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("intact")
    save_scene(SCENE, folder / "scene.yaml")
    (folder / "naming.yaml").write_text("stamp_s: t * 0.001\nx: [px]\nindex: g1..8\nspeed: {y: 0.01}\n")
    names = ["stamp_s", "x", "y", *channel_names("index", 8), *channel_names("middle", 8)]
    rows = np.column_stack([np.arange(5) / 100, np.zeros((5, 18))])
    np.savetxt(folder / "test.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.3f")
    for name, kind in BAGS.items():
        file_of(write_bag(folder / "-".join(kind), slide(0, 100), *kind)).rename(folder / name)
    return folder


READERS = {
    "scene.yaml": load_scene,
    "naming.yaml": load_naming,
    "test.csv": lambda path: read_csv(path, SCENE),
    **dict.fromkeys(BAGS, lambda path: read_bag(path, SCENE)),
}


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=40)
@given(damage=DAMAGE)
def test_a_damaged_file_gives_a_result_or_one_line(files, name, damage):
    content = (files / name).read_bytes()
    for place, inserted, removed in damage:
        begin = round(place * len(content))
        content = content[:begin] + inserted + content[begin + removed :]
    path = files / f"damaged_{name}"
    path.write_bytes(content)
    with suppress(TactileLocalizerError):
        READERS[name](path)
