"""Command-line options for CAN logs, and the strain in them."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_localizer.cli.outputs import InputPath
from tactile_localizer.cli.progress import progress_line
from tactile_localizer.errors import CanError
from tactile_localizer.io.csv.table import Table
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.scene import Scene

if TYPE_CHECKING:
    from tactile_localizer.io.can.protocol import LoadCellProtocol


def add_can_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options for CAN logs: layout, channel."""
    add = parser.add_argument_group("CAN logs").add_argument
    add(
        "--dbc",
        type=InputPath,
        required=True,
        metavar="FILE",
        help="CAN database (DBC): a file, or the name of a shipped one",
    )
    text = "parameters of the driver node, if messages or signals do not have the default names"
    add("--params-file", type=InputPath, metavar="YAML", help=text)
    add("--channel", default="", metavar="NAME", help="channel in a log of several, such as can0")


def log_reader(args: argparse.Namespace, scene: Scene) -> Callable[[Path], Table]:
    """A function that reads the strain of the scene's phalanges in a log.

    Raises
    ------
    CanError, SceneError
        The DBC lacks a phalanx of the scene, or has another number of channels for it.
    """
    # Imported here because cantools takes 0.3 s, which other recordings do not need.
    from tactile_localizer.io.can.protocol import protocol_of

    parameters = load_yaml(args.params_file, "a parameter file", CanError, _flat) if args.params_file else {}
    protocol = protocol_of(scene.phalanx_names, {**parameters, "dbc": args.dbc})
    scene.channels(protocol.phalanges, protocol.channels.counts)  # as many as the scene has
    return partial(_table, protocol, args.channel)


def _flat(content: Any, prefix: str = "") -> dict[str, Any]:
    """Parameters in a file of ROS by their names, with dots between group and member."""
    found: dict[str, Any] = {}
    for name, value in mapping(content, "parameters").items():
        if isinstance(value, dict):
            found |= _flat(value, "" if "ros__parameters" in (name, *value) else f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def _table(protocol: LoadCellProtocol, channel: str, path: Path) -> Table:
    from tactile_localizer.io.can.log import read_log

    with progress_line() as progress:
        stamp_ns, strain, notes = read_log(path, protocol, channel, progress)
    return Table(stamp_ns, np.empty((len(strain), 0)), strain, {}, 0, notes)
