"""Load cells with other numbers of channels than 8, and not all the same."""

import numpy as np
import pytest

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.status import MISSING

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: hand robot\n'
NAMES = SignalNames(tuple(f"ch_{n}" for n in range(1, 20)))
PERIOD_S = 0.01


def message(number, name, channels, first=1):
    lines = [f"\nBO_ {number} {name}: {64 if 2 * channels + 1 > 8 else 8} hand\n"]
    lines += [f' SG_ ch_{first + k} : {16 * k}|16@1- (0.001,0) [0|0] "V" robot\n' for k in range(channels)]
    return "".join([*lines, f' SG_ counter : {16 * channels}|8@1+ (1,0) [0|0] "" robot\n'])


def protocol(tmp_path, *messages):
    (tmp_path / "own.dbc").write_text(HEAD + "".join(messages))
    return LoadCellProtocol.from_dbc(tmp_path / "own.dbc", ["index", "thumb"], names=NAMES)


@pytest.fixture
def mixed(tmp_path):
    return protocol(tmp_path, message(16, "index", 19), message(17, "thumb", 3))


def test_the_dbc_determines_channel_counts(mixed):
    assert mixed.channels.counts == (19, 3)


def test_missing_phalanges_are_nan_in_their_channels(mixed):
    assembler = CycleAssembler(mixed, 0.004)
    strain = 0.001 * np.arange(22.0)
    made = []
    for n in range(200):
        frames = [
            frame
            for p, own in enumerate(mixed.channels.slices)
            if not (n == 150 and p == 1)
            for frame in mixed.encode(p, strain[own], n, stamp_s=1000.0 + n * PERIOD_S + 1e-4 * p)
        ]
        made += assembler.feed(frames)
    made += assembler.flush(round(2000e9))
    np.testing.assert_allclose(made[-1].strain, strain, atol=1e-12)
    (silent,) = [cycle for cycle in made if list(cycle.status) == [0, MISSING] and cycle.sequence[0] == 150]
    np.testing.assert_allclose(silent.strain[:19], strain[:19], atol=1e-12)
    assert np.isnan(silent.strain[19:]).all()


def test_channels_must_be_consecutive(tmp_path):
    with pytest.raises(CanError, match="expected the signal 'ch_4' once in thumb, found 0"):
        protocol(
            tmp_path,
            message(16, "index", 19),
            message(17, "thumb", 3) + ' SG_ ch_5 : 56|8@1+ (1,0) [0|0] "V" robot\n',
        )
