"""The ``tactile-localizer`` command: one module a subcommand, imported only when it is asked for.

A subcommand's module has ``NAME``, ``HELP``, ``add_arguments(parser)`` and ``run(args) -> int``; its name is
``NAME`` as an identifier (``import`` is in ``import_.py``), and :data:`COMMANDS` lists it. ``args`` holds the
whole command line too, as ``command_line``. ``RESUMES = True``: an interrupted run goes on when run again.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

from tactile_localizer import __version__
from tactile_localizer.errors import TactileLocalizerError

COMMANDS: tuple[str, ...] = (
    "import_",
    "scan",
    "simulate",
    "replay",
    "identify",
    "view",
    "evaluate",
    "tradeoff",
    "tune",
    "can",
    "demo",
)
"""Modules of the subcommands, in the order of the help text."""

_EPILOG = """\
Five values matter on a new hand and material; the rest has defaults or is chosen from the scan:
  bounds of each axis (scene)         the ends of where the palm will be, and 2 to 5 mm more
  distance of the scanned lines       half the smallest detail that is felt
  motion_std of each axis (scene)     slip in the fingers after a slide, over the root of its metres
  convergence_radius (filter)         the largest position error that the task tolerates
  offset of each phalanx (scene)      from the palm to the fingertip, by the hand's drawing
docs/essentials.md says how to measure each and what happens when it is wrong."""

_COMPLETING = "_ARGCOMPLETE"
"""Set by a shell that asks what may come next on a command line."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    A :class:`TactileLocalizerError` becomes one line on standard error and status 2, an interrupt status
    130; a reader of standard output that has gone away ends the command quietly.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    # Matrices are small: threads of BLAS would only wait for each other, ten times longer on a busy machine.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if _COMPLETING in os.environ:
        _complete()
    args = argparse.Namespace(command_line=arguments, resumes=False)
    try:
        args = _parser(arguments).parse_args(arguments, args)
        status: int = args.run(args)
        sys.stdout.flush()
        return status
    except TactileLocalizerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        kept = ": what is done is kept, run again to go on" if args.resumes else ""
        print(f"interrupted{kept}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The interpreter flushes once more at exit: into nothing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


def _complete() -> None:
    """Print what may come next on the shell's command line, and exit."""
    import argcomplete

    words = os.environ.get("COMP_LINE", "").split()[1:]
    argcomplete.autocomplete(_parser(words))


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """A parser of the subcommand that ``arguments`` begin with, or of all where they begin with none."""
    parser = argparse.ArgumentParser(
        prog="tactile-localizer",
        description="Where a robot hand is on a piece of flexible material, by touch alone.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    asked = [module for module in COMMANDS if arguments and _name(module) == arguments[0]]
    for module in asked or COMMANDS:
        command = importlib.import_module(f"{__name__}.{module}")
        subparser = subparsers.add_parser(command.NAME, help=command.HELP, description=command.HELP)
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run, resumes=getattr(command, "RESUMES", False))
    return parser


def _name(module: str) -> str:
    return module.rstrip("_").replace("_", "-")
