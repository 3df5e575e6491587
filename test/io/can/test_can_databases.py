"""A DBC file describes the load cells, whatever else is in it, or is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.load_cells import CLASSIC, HEAD, data_of, strain_in, write_dbc

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.protocol import LoadCellProtocol


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("unit", ["mV", "uV", "\u00b5V", "\u03bcV"])
def test_other_units_are_converted_to_volts(tmp_path: Path, unit: str, encoding: str) -> None:
    if unit == "\u03bcV" and encoding == "cp1252":
        return  # which has no Greek letters
    scaling = "(0.25,0) [-2048|2047.75]" if unit == "mV" else "(250,0) [-2048000|2047750]"
    text = CLASSIC.replace('(0.00025,0) [-2.048|2.04775] "V"', f'{scaling} "{unit}"')
    data = text.encode(encoding)
    if encoding == "utf-8":
        data += 'CM_ "K\xf6rper";\n'.encode("cp1252")  # as by another editor
    (tmp_path / "own.dbc").write_bytes(data)
    hand = LoadCellProtocol(tmp_path / "own.dbc", ["index"])
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, np.full(8, 1.25), sequence=0)), 1.25)


def test_names_of_signals_and_messages_are_configurable(tmp_path: Path) -> None:
    text = CLASSIC.replace("gauge_", "index_sg").replace("index_a", "LC_LOW").replace("index_b", "LC_HIGH")
    names = SignalNames(tuple(f"{{phalanx}}_sg{i}" for i in range(1, 9)))
    path = write_dbc(tmp_path / "own.dbc", text)
    hand = LoadCellProtocol(path, ["index"], {"index": ["LC_LOW", "LC_HIGH"]}, names)
    assert [message.definition.name for message in hand.messages] == ["LC_LOW", "LC_HIGH"]
    strain = np.linspace(-1, 1, 8).round(3)
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain)


def test_the_documented_example_is_a_dbc(tmp_path: Path) -> None:
    text = Path(__file__).parents[3].joinpath("docs", "can.md").read_text()
    begin = text.index('VERSION ""')
    path = write_dbc(tmp_path / "own.dbc", text[begin : text.index("```", begin)])
    hand = LoadCellProtocol(path, ["index"])
    strain = np.array([-3.0, 2.5])
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain, atol=1e-9)


FLOAT_COUNTER = """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|16@1- (1,0) [0|0] "V" hand
 SG_ counter : 32|32@1- (1,0) [0|0] "" hand

SIG_VALTYPE_ 16 counter : 1;
"""
FLOATS_OF_ANOTHER = """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|32@1- (1,0) [0|0] "mV" hand

SIG_VALTYPE_ 17 gauge_1 : 1;
"""
CHANGES = {
    "a gauge too few": ("gauge_7", "gauge_9", "'gauge_7' once in index_a, index_b, found 0"),
    "a gauge twice": ("gauge_8", "gauge_1", "'gauge_1' once in index_a, index_b, found 2"),
    "newtons": ('"V"', '"N"', "unit of V, mV or uV, found 'N'"),
    "a scale of 0": ("(0.00025,0)", "(0,0)", "'gauge_1' .* scale other than 0"),
    "a counter with a scale of 0": (
        "56|4@1+ (1,0)",
        "56|4@1+ (0,0)",
        "'counter' of index_a: expected a scale other than 0",
    ),
    "one identifier": ("BO_ 259", "BO_ 258", "'index_a'.* found index_a 0x102, index_b 0x102"),
    "the identifier of an unused message": (
        "BO_ 260 ",
        "BO_ 258 ",
        "expected its name and identifier once in the DBC, found index_a 0x102, middle_a 0x102",
    ),
    "a name twice": (
        "middle_a",
        "index_a",
        "'index_a': expected its name and .* found index_a 0x102, index_a 0x104",
    ),
    "a counter twice": ("status :", "counter :", "counter and counter are overlapping in message index_a"),
    "overlapping signals": ("gauge_2 : 14", "gauge_2 : 10", "gauge_2 and gauge_1 are overlapping"),
    "an empty range": ("[-2.048|2.04775]", "[2|-2]", r"below the maximum, found \[2\|-2\]"),
    "a range of other bits": (
        "[-2.048|2.04775]",
        "[3|5]",
        r"signal 'gauge_1' of index_a: expected a range that its bits can have, found \[3\|5\]",
    ),
    "80 bits": (
        "gauge_1 : 0|14@1-",
        "gauge_1 : 0|80@1-",
        "DBC file|'gauge_1' of index_a: expected at most 64 bits, found 80",
    ),
    "a million bits": ("gauge_1 : 0|14", "gauge_1 : 0|1000000", "found 1000000 from bit 0"),
    "a place far away": ("gauge_1 : 0|", "gauge_1 : 10000000000|", "found 14 from bit 10000000000"),
    "a number of 5000 digits": ("gauge_1 : 0|14", "gauge_1 : 0|" + "9" * 5000, "1 to 512 bits"),
    "a frame of many bytes": ("index_a: 8", "index_a: 100000000", "at most 64 bytes, found 100000000"),
}
"""Texts of the example, what stands in their places, and why that is refused."""
BAD_DATABASES = {
    "no such file": (None, "expected a DBC file, No such file"),
    "not a DBC": ("gauges: 8\n", "expected a DBC file"),
    "another hand": (CLASSIC.replace("index_a", "pinky_a").replace("index_b", "pinky_b"), "'index'.*index_a"),
    "a float as counter": (HEAD + FLOAT_COUNTER, "expected an integer 'counter', found a float"),
    "a message cut short": (
        HEAD + "BO_ 272 index_a: 8 ",
        "message 'index_a': expected its length and sender in the DBC, found it cut short",
    ),
    "floats of another message": (
        HEAD + FLOATS_OF_ANOTHER,
        "'gauge_1' of index.*found that of 'gauge_1' of message 17",
    ),
    "a type of an unknown signal": (
        HEAD + FLOATS_OF_ANOTHER.replace("17 gauge_1 : 1", "16 Gauge_1 : 1"),
        "'gauge_1' of index.*found that of 'Gauge_1' of message 16",
    ),
    "floats of 24 bits": (
        HEAD + FLOATS_OF_ANOTHER.replace("0|32", "0|24").replace("_ 17 gauge", "_ 16 gauge"),
        "'gauge_1' of index: expected a float of 16, 32 or 64 bits, found 24",
    ),
    "an empty file": ("", "expected a DBC file, found no messages"),
    "a counter as multiplexer": (
        CLASSIC.replace("gauge_1 :", "gauge_1 m0 :").replace("counter :", "counter M :"),
        "gauges of index_a: expected them in every frame, or behind one multiplexer",
    ),
    **{name: (CLASSIC.replace(old, new), reason) for name, (old, new, reason) in CHANGES.items()},
}


@pytest.mark.parametrize("name", BAD_DATABASES)
def test_unusable_databases_are_refused(tmp_path: Path, name: str) -> None:
    text, reason = BAD_DATABASES[name]
    path = tmp_path / "bad.dbc"
    if text is not None:
        write_dbc(path, text)
    with pytest.raises(CanError, match=reason) as refusal:
        LoadCellProtocol(path, ["index"])
    assert "\n" not in str(refusal.value)


BESIDE_TEMPERATURE = """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|16@1- (0.001,0) [0|0] "V" hand
 SG_ page M : 32|8@1+ (1,0) [0|0] "" hand
 SG_ temperature m1 : 40|16@1- (0.1,0) [0|0] "degC" hand
 SG_ serial_number m2 : 40|24@1+ (1,0) [0|0] "" hand

SG_MUL_VAL_ 16 serial_number page 2-4000000000;
"""
DAMAGE = [
    "9",
    "-",
    "|",
    "@",
    "m0",
    "M",
    '"',
    ";",
    "99999999999",
    "\n",
    "SG_ ",
    "BO_ ",
    "\xff",
    "\0",
    "index",
    "",
]


@given(
    damage=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(DAMAGE)), min_size=1, max_size=4
    )
)
def test_a_damaged_dbc_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, damage: list[tuple[float, int, str]]
) -> None:
    text = HEAD + BESIDE_TEMPERATURE
    for place, length, put in damage:
        begin = int(place * len(text))
        text = text[:begin] + put + text[begin + length :]
    path = write_dbc(tmp_path_factory.mktemp("dbc") / "damaged.dbc", text)
    try:
        hand = LoadCellProtocol(path, ["index"])
    except CanError as refusal:
        assert "\n" not in str(refusal)  # noqa: PT017
    else:
        hand.decode(bytes(hand.size))


FAULTS_OF_OTHERS = {
    "overlapping signals": "BO_ 1 motor: 8 hand\n"
    + "".join(f' SG_ {name} : 0|9@1- (1,0) [0|0] "" hand\n' for name in "ab"),
    "a signal outside of its message": 'BO_ 1 motor: 2 hand\n SG_ a : 12|9@1- (1,0) [0|0] "" hand\n',
    "a signal without bits": 'BO_ 1 motor: 2 hand\n SG_ a : 0|0@1- (1,0) [0|0] "" hand\n',
    "a million bits": 'BO_ 1 motor: 2 hand\n SG_ a : 0|1000000@1- (1,0) [0|0] "" hand\n',
    "many bytes": "BO_ 1 motor: 1000000000 hand\n",
    "an identifier that is too long": "BO_ 419361280 motor: 8 hand\n",
    "a name twice": "BO_ 1 motor: 8 hand\n\nBO_ 2 motor: 8 hand\n",
    "an identifier twice": "BO_ 1 motor: 8 hand\n\nBO_ 1 engine: 8 hand\n",
    "an empty range": 'BO_ 1 motor: 8 hand\n SG_ a : 0|8@1- (1,0) [9|1] "" hand\n',
    "a syntax error": 'BO_ 1 motor: 8 hand\n SG_ a : 0|8@1 (1;0) [] "" hand\n',
    "multiplexed values": "BO_ 1 motor: 8 hand\n\nSG_MUL_VAL_ 1 a b 0-4000000000;\n",
    "a removed message": "SIG_VALTYPE_ 1 gauge_1 : 1;\n",
    "a text": 'BO_ 1 motor: 8 hand\n\nCM_ "until 2020:\nBO_ 258 index_a: 4 hand\n";\n',
    "a comment": "// BO_ 258 index_a: 4 hand\n",
}


@pytest.mark.parametrize("name", FAULTS_OF_OTHERS)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_faults_in_messages_that_are_not_used_do_not_matter(tmp_path: Path, name: str, end: str) -> None:
    (tmp_path / "robot.dbc").write_bytes(
        (CLASSIC + "\n" + FAULTS_OF_OTHERS[name]).replace("\n", end).encode()
    )
    hand = LoadCellProtocol(tmp_path / "robot.dbc", ["index"])
    strain = np.linspace(-1, 1, 8).round(3)
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain)


def test_gauges_of_every_frame_are_read_beside_multiplexed_signals(tmp_path: Path) -> None:
    hand = LoadCellProtocol(write_dbc(tmp_path / "own.dbc", HEAD + BESIDE_TEMPERATURE), ["index"])
    frames = hand.encode(0, np.array([1.5]), sequence=0)
    np.testing.assert_allclose(strain_in(hand, frames), 1.5)


def taxels(count: int, axes: str = "xyz") -> str:
    """A DBC with a message for each taxel, all of them with the same signals."""
    lines = []
    for taxel in range(count):
        lines.append(f"BO_ {16 + taxel} index_{taxel}: 8 hand")
        lines += [f' SG_ {axis} : {16 * i}|16@1- (0.001,0) [0|0] "V" hand' for i, axis in enumerate(axes)]
    return HEAD + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("gauges", "expected"),
    [
        (["x", "y", "z"], "0x 0y 0z 1x 1y 1z"),
        (["z", "x"], "0z 0x 1z 1x"),
        (["{phalanx}_1.x", "{phalanx}_0.x"], "1x 0x"),
    ],
)
def test_signals_of_one_name_in_each_message_are_channels(
    tmp_path: Path, gauges: list[str], expected: str
) -> None:
    hand = LoadCellProtocol(
        write_dbc(tmp_path / "own.dbc", taxels(2)), ["index"], names=SignalNames(tuple(gauges))
    )
    found = {
        column: f"{slot}{gauge.name}"
        for slot, message in enumerate(hand.messages)
        for column, gauge in message.gauges.items()
    }
    assert [found[column] for column in range(hand.channels.size)] == expected.split()
    strain = np.arange(hand.channels.size) * 0.1
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain, atol=1e-9)


def test_messages_of_a_phalanx_are_numbered(tmp_path: Path) -> None:
    head, *messages = taxels(12).split("BO_ ")
    text = "BO_ ".join([head, *sorted(messages, key=lambda one: one.split()[1])])  # 0, 1, 10, 11, 2, ...
    text += 'BO_ 99 index_tip: 8 hand\n SG_ x : 0|16@1- (1,0) [0|0] "V" hand\n'
    hand = LoadCellProtocol(
        write_dbc(tmp_path / "own.dbc", text), ["index"], names=SignalNames(("x", "y", "z"))
    )
    assert hand.channels.size == 36
    assert [message.definition.name for message in hand.messages] == [f"index_{n}" for n in range(12)]


def test_boards_of_one_kind_share_a_message(tmp_path: Path) -> None:
    text = HEAD + 'BO_ 385 STRAIN: 4 hand\n SG_ gauge_1 : 0|16@1- (0.001,0) [0|0] "V" hand\n'
    path = write_dbc(tmp_path / "board.dbc", text)
    messages = {"thumb": ["STRAIN"], "index": ["STRAIN@0x182"], "middle": ["STRAIN@0x12345678"]}
    hand = LoadCellProtocol(path, list(messages), messages)
    assert [message.key for message in hand.messages] == [(0x181, False), (0x182, False), (0x12345678, True)]
    for phalanx in range(3):
        (frame,) = hand.encode(phalanx, np.array([1.5]), sequence=0)
        assert hand.classify(frame)[1] == phalanx
    both = LoadCellProtocol(path, ["index"], {"index": ["STRAIN@0x182", "STRAIN"]})
    for frame, volts in zip(both.encode(0, np.array([1.5, -1.5]), sequence=0), (1.5, -1.5), strict=True):
        assert both.decode(data_of(both, [frame]))[0][int(volts < 0)] == volts
    for reference in ("STRAIN@", "STRAIN@x", "STRAIN@-1", "STRAIN@0x20000000"):
        with pytest.raises(CanError, match=f"'{reference}': expected an identifier such as 0x182"):
            LoadCellProtocol(path, ["index"], {"index": [reference]})
    with pytest.raises(CanError, match=r"0x181 STRAIN: .* found it in thumb and index; .*: STRAIN@0x182"):
        LoadCellProtocol(path, ["thumb", "index"], {"thumb": ["STRAIN"], "index": ["STRAIN"]})
