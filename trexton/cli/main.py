"""The command line: parse, call, print. Each subcommand is a module of `trexton.companion.cli`,
imported only when asked for.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from importlib import import_module
from pathlib import Path

from trexton import __version__
from trexton.base.errors import TrextonError

# name: (module of trexton.companion.cli, one line of help)
COMMANDS = {
    "check": ("trexton.cli.check", "read a flight folder and report every fault"),
    "data": ("trexton.cli.data", "list or fetch public flights"),
    "import": ("trexton.cli.import_flight", "make a flight of a recording in another format"),
    "export": ("trexton.cli.export", "write a track as TUM, CSV or GeoJSON"),
    "simulate": ("trexton.cli.simulate", "fly in the virtual room and record a flight"),
    "train": ("trexton.cli.train", "make a texton map from a flight"),
    "claims": (
        "trexton.companion.cli.claims",
        "judge every claim of the paper by the results at hand",
    ),
    "run": ("trexton.companion.cli.run", "run the experiment notebooks on a flight"),
    "sweep": ("trexton.companion.cli.sweep", "run an experiment over floors, flights and settings"),
    "report": (
        "trexton.companion.cli.report",
        "will it work here? A printable page and a small book",
    ),
    "book": ("trexton.companion.cli.book", "run every experiment and build the book"),
    "onboard": ("trexton.cli.onboard", "localize live frames and report positions"),
    "replay": (
        "trexton.cli.replay",
        "show what a flight of the script sent, and what the autopilot said",
    ),
    "bench": ("trexton.companion.cli.bench", "measure the speed of every stage"),
    "suitability": (
        "trexton.companion.cli.suitability",
        "will it work over this floor? A picture is enough",
    ),
    "play": ("trexton.companion.cli.play", "look at a flight frame by frame in a browser"),
    "verify": (
        "trexton.companion.cli.verify",
        "run records' experiments again and say what changed",
    ),
    "tune": (
        "trexton.companion.cli.tune",
        "choose samples and particles for a rate on this machine",
    ),
}


def build_parser(chosen: str | None = None) -> argparse.ArgumentParser:
    """The parser; only the `chosen` subcommand's module is imported, so that help stays quick."""
    parser = argparse.ArgumentParser(
        prog="trexton", description="Texton-based global localization for micro aerial vehicles."
    )
    parser.add_argument("--version", action="version", version=f"trexton {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (module, help_line) in COMMANDS.items():
        command = commands.add_parser(
            name, help=help_line, description=help_line[0].upper() + help_line[1:] + "."
        )
        command.add_argument("-q", "--quiet", action="store_true", help="no progress on stderr")
        if name == chosen:
            import_module(module).add_arguments(command)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run one subcommand; 0 on success, 1 on a fault (one sentence on stderr), 2 on wrong usage."""
    _open_standard_streams()
    argv = sys.argv[1:] if argv is None else argv
    chosen = next((word for word in argv if not word.startswith("-")), None)
    arguments = build_parser(chosen).parse_args(argv)
    from trexton.base.progress import set_quiet

    set_quiet(arguments.quiet)
    command = import_module(COMMANDS[arguments.command][0])
    try:
        return command.run(arguments) or 0
    except KeyboardInterrupt:
        print(f"trexton {arguments.command}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except Exception as error:  # the one place where foreign errors become sentences
        print(f"trexton {arguments.command}: {sentence(error)}", file=sys.stderr)
        return 1


def _open_standard_streams() -> None:
    """Where one was closed (``2>&-``), its number would go to the next file or socket, and what
    OpenCV has to say on standard error would be written there.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    if sys.stderr is None:  # else `print` would take standard output for it
        sys.stderr = open(os.devnull, "w", encoding="utf-8")


def sentence(error: Exception) -> str:
    """What a person is told of an error; one that nobody thought of comes with how to report it."""
    if isinstance(error, TrextonError):
        return str(error)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}: nothing was changed, mend it and try again"
    if isinstance(error, UnicodeEncodeError):
        name = ascii(error.object[max(0, error.start - 20) : error.end + 20])
        return f"a name is not UTF-8 (at {name}): rename the file or folder"
    if isinstance(error, MemoryError):
        return "the memory does not suffice: use fewer frames, smaller images or another machine"
    if isinstance(error, RecursionError):
        return "an input is nested too deeply: check the files that were given"
    if type(error).__module__.partition(".")[0] == "cv2":
        return f"OpenCV refused an image or a picture ({_first_line(error)}): check the files given"
    if os.environ.get("TREXTON_DEBUG"):
        raise error
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return (
        f"unexpected {type(error).__name__}: {_first_line(error)}{where}; this is a fault of "
        "trexton: please report it with the output of the same "
        "command under TREXTON_DEBUG=1"
    )


def _first_line(error: Exception) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), "no message")


if __name__ == "__main__":
    sys.exit(main())
