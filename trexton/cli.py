"""The command line: parse, call, print. Each subcommand is a module of `trexton.commands`, imported only when asked for."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module

from trexton import __version__
from trexton.errors import TrextonError

# name: (module of trexton.commands, one line of help)
COMMANDS = {
    "check": ("check", "read a flight folder and report every fault"),
    "data": ("data", "list or fetch public flights"),
    "simulate": ("simulate", "fly in the virtual room and record a flight"),
    "train": ("train", "make a texton map from a flight"),
    "claims": ("claims", "judge every claim of the paper by the results at hand"),
    "run": ("run", "run the experiment notebooks on a flight"),
    "book": ("book", "run every experiment and build the book"),
    "onboard": ("onboard", "localize live frames and report positions"),
    "bench": ("bench", "measure the speed of every stage"),
    "tune": ("tune", "choose samples and particles for a rate on this machine"),
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
            import_module(f"trexton.commands.{module}").add_arguments(command)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run one subcommand; 0 on success, 1 on a fault (one sentence on stderr), 2 on wrong usage."""
    argv = sys.argv[1:] if argv is None else argv
    chosen = next((word for word in argv if not word.startswith("-")), None)
    arguments = build_parser(chosen).parse_args(argv)
    from trexton.progress import set_quiet

    set_quiet(arguments.quiet)
    command = import_module(f"trexton.commands.{COMMANDS[arguments.command][0]}")
    try:
        return command.run(arguments) or 0
    except TrextonError as error:
        print(f"trexton {arguments.command}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"trexton {arguments.command}: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1


if __name__ == "__main__":
    sys.exit(main())
