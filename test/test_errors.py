"""Messages of errors are one printable line."""

import pytest

from tactile_localizer.errors import ScanError, TactileLocalizerError


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("bump_scan: expected a scan, found 7 µm", "bump_scan: expected a scan, found 7 µm"),
        ("a\nb_scan: \x1b[31mred", r"a\nb_scan: \x1b[31mred"),
        ("name \udc80", r"name \udc80"),
    ],
)
def test_a_message_is_one_printable_line(text, line):
    error = ScanError(text)
    assert isinstance(error, TactileLocalizerError)
    assert str(error) == line
    str(error).encode()


def test_the_middle_of_a_long_message_is_left_out():
    text = str(ScanError(f"{'x' * 10_000}_scan: expected a scan folder"))
    assert len(text) < 1000
    assert text.startswith("xxx")
    assert text.endswith("_scan: expected a scan folder")
