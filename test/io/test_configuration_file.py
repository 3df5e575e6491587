"""Configurations are read from presets and YAML files; overrides take precedence."""

import pytest

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.configuration_file import load_configuration


def test_overrides_precede_the_file(tmp_path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text("filter: particle\nparticles: 75\nupdate_distance: 1e-3\n")
    configuration = load_configuration(path, particles=80, model=None)
    assert configuration == Configuration(filter="particle", particles=80, update_distance=0.001)
    path.write_text("# nothing\n")
    assert load_configuration(path) == Configuration()


@pytest.mark.parametrize(
    ("text", "message"),
    [("cell: -1", "cell: expected 0.01 to 10"), ("[1, 2]", "configuration: expected a mapping")],
)
def test_invalid_configurations_name_the_file(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=f"own.yaml: {message}"):
        load_configuration(path)
