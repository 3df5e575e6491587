"""The ``tactile-localizer`` command.

:data:`COMMANDS` lists the subcommands with their one-line help. A subcommand's module has the same name
(``import`` is in ``import_.py``) and is imported only when that subcommand is called. It defines
``add_arguments(parser)`` and ``run(args) -> int``.
"""

import argparse
import importlib.util
import keyword
import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import Any, NoReturn

from tactile_localizer import __version__
from tactile_localizer.errors import TactileLocalizerError, did_you_mean, in_one_line
from tactile_localizer.io.scans import FORMAT

COMMANDS: dict[str, str] = {
    "demo": "scan a simulated feature and localize on it with all ROS 2 nodes running",
    "import": "make a scan from recordings (CSV, rosbag2, CAN logs)",
    "scan": "describe and plot a scan",
    "tradeoff": "measure accuracy against computing time of configurations, and choose one",
    "replay": "localize the palm in a recording, as the filter node would have",
    "simulate": "write recordings of the simulated hand (train.csv, test.csv)",
}
"""Help of the subcommands by name, in the order of the help text, most used first."""

_EPILOG = """\
Try it without ROS:
  tactile-localizer simulate bump -o recording
  tactile-localizer import csv recording/train.csv --scene bump.yaml -o bump_scan
  tactile-localizer replay recording/test.csv --scan bump_scan

`tactile-localizer COMMAND --help` lists the options of a command. docs/essentials.md describes the five
values to set for a new hand and material; everything else has a default or is learned from the scan."""

_EXTRAS = ("argcomplete", "jinja2", "joblib", "matplotlib", "mcap", "rosbags", "zstandard")
"""Libraries of ``[offline]``, each of which only some commands need."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    A :class:`TactileLocalizerError` becomes one line on standard error and status 2, and so does a library
    that cannot be imported. An interrupt gives status 130, a closed standard output status 141.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    # With BLAS threads, updates of small matrices take ten times longer on a busy machine.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for stream in (sys.stdout, sys.stderr):  # a terminal may lack a character, such as that of µs
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        if "_ARGCOMPLETE" in os.environ:
            _complete()
        args = command_parser(arguments).parse_args(arguments)
        status: int = args.run(args)
        sys.stdout.flush()
        return status
    except TactileLocalizerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        library = str(error.name).partition(".")[0]
        found = in_one_line(error)
        print(
            f"error: {library}: expected it installed, found: {found}; {_installed_by(library)}",
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The interpreter flushes standard output again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


def _installed_by(library: str) -> str:
    """What to do where a library is absent, and all else of its kind that is."""
    if library == "rclpy":
        return "source ROS 2; `make demo` makes an environment that has it"
    if library == "distributed":
        return "`pip install '.[cluster]'` installs it"
    if library not in _EXTRAS:
        return "`pip install .` installs what is needed"
    others = [one for one in _EXTRAS if one != library and importlib.util.find_spec(one) is None]
    also = f" and what else is missing: {', '.join(others)}" if others else ""
    return f"`pip install '.[offline]'` installs it{also}"


def command_parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Parser of all subcommands, with the options of the one that ``arguments`` begin with."""
    parser = _Parser(
        prog="tactile-localizer",
        description="Localize a robot hand on flexible material by touch.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"%(prog)s {__version__}, scan format {FORMAT}"
    parser.add_argument("--version", action="version", version=version)
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, text in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=text, description=f"{text[:1].upper()}{text[1:]}.")
        if name in arguments[:1]:
            suffix = "_" if keyword.iskeyword(name) else ""
            command = importlib.import_module(f"{__name__}.{name}{suffix}")
            command.add_arguments(subparser)
            subparser.set_defaults(run=command.run)
    return parser


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the option or the choice that a misspelled one resembles."""

    _words: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        self._words = args or ()
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:  # of a command; the parser of all commands has other options
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        options = self._option_string_actions
        typed = (word.partition("=")[0] for word in self._words if word.startswith("--"))
        unknown = (word for word in typed if not any(option.startswith(word) for option in options))
        hint = next(filter(None, (did_you_mean(word, options) for word in unknown)), "")
        self.exit(2, f"error: {message}{hint}; `{self.prog} --help` shows what can be given\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            suggestion = did_you_mean(str(value).lower(), map(str, action.choices or ()))
            raise argparse.ArgumentError(action, f"{error.message}{suggestion}") from None


def _complete() -> None:
    """Answer the shell that asks how a command line goes on, and exit."""
    import argcomplete

    typed = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])].split()
    argcomplete.autocomplete(command_parser(typed[1:]))
