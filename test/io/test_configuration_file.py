"""Configurations come from presets and YAML files, and what is given beside them goes first."""

from __future__ import annotations

import pytest

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.configuration_file import PRESETS, load_configuration


def test_nothing_given_is_the_default() -> None:
    assert load_configuration() == Configuration()


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_is_shipped_and_can_be_used(preset: str) -> None:
    assert load_configuration(preset) != Configuration()


def test_a_file_names_what_differs_and_the_command_line_goes_first(tmp_path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text("filter: particle\nparticles: 75\nupdate_distance: 1e-3\n")
    configuration = load_configuration(path, particles=80, model=None)
    assert configuration == Configuration(filter="particle", particles=80, update_distance=0.001)


def test_an_empty_file_is_the_default(tmp_path) -> None:
    path = tmp_path / "empty.yaml"
    path.write_text("# nothing\n")
    assert load_configuration(path) == Configuration()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("modle: gaussian", "own.yaml: parameter 'modle': expected a known name; did you mean model?"),
        ("particles: many", "own.yaml: particles: expected int, got 'many'"),
        ("cell: -1", "own.yaml: cell: expected 0.01 to 10, got -1.0"),
        ("[1, 2]", "own.yaml: expected a mapping of names to values, got [1, 2]"),
        ("a: [", "own.yaml: expected YAML, "),
    ],
)
def test_what_cannot_be_used_is_refused_and_names_the_file(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError) as refusal:
        load_configuration(path)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_an_unknown_preset_is_refused_with_those_that_exist() -> None:
    with pytest.raises(
        ParameterError, match="fastest: expected a configuration file or one of fast, balanced"
    ):
        load_configuration("fastest")
