"""The command line: parse, call, print. Each verb is a module with ``add_arguments(parser)`` and
``run(arguments) -> int``, imported only when asked for; the first sentence of its docstring is its
help.
"""

import argparse
import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import Any

from trexton import __version__
from trexton.base.errors import TrextonError
from trexton.base.plugins import addresses, import_plugins, resolve
from trexton.base.progress import Shown, set_quiet, shown

# The library's own; others are entry points of the group ``trexton.commands``.
COMMANDS = {
    "check": "trexton.cli.check",
    "data": "trexton.cli.data",
    "import": "trexton.cli.import_flight",
    "export": "trexton.cli.export",
    "simulate": "trexton.cli.simulate",
    "methods": "trexton.cli.methods",
    "train": "trexton.cli.train",
    "onboard": "trexton.cli.onboard",
    "replay": "trexton.cli.replay",
}


def help_line(module: str) -> str:
    """The first paragraph of a module's docstring after ``trexton VERB``, read without an import:
    so that help stays quick."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return f"of {module}, which is not here"
    text = Path(spec.origin).read_text(encoding="utf-8").partition('"""')[2]
    paragraph = " ".join(text.partition('"""')[0].partition("\n\n")[0].split())
    return paragraph.partition("``: ")[2] or paragraph


class _Parser(argparse.ArgumentParser):
    """Refuses an option that comes twice: one of its values would be passed over in silence."""

    def __init__(self, **how: Any):
        super().__init__(**how)
        self.register("action", None, _Once)


class _Once(argparse.Action):
    def __call__(self, parser: object, named: Any, values: object, option: Any = None) -> None:
        given = named.__dict__.setdefault("given", set())
        if option is not None and self.dest in given:
            words = f"given twice, {getattr(named, self.dest)!r} and {values!r}: give it once"
            raise argparse.ArgumentError(self, words)
        given.add(self.dest)
        setattr(named, self.dest, values)


def build_parser(chosen: str | None = None, words: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The parser for the `words` typed; only the module of the `chosen` verb is imported."""
    parser = _Parser(prog="trexton", description="Texton-based localization of micro air vehicles.")
    parser.add_argument("--version", action="version", version=f"trexton {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    own = {chosen: COMMANDS[chosen]} if chosen in COMMANDS else {}
    for name, module in (own or addresses("commands", COMMANDS)).items():
        said = help_line(module).replace("%", "%%")
        help_of, whole = said.partition(". ")[0].rstrip("."), said[:1].upper() + said[1:]
        command = commands.add_parser(name, help=help_of, description=whole)
        command.add_argument("-q", "--quiet", action="store_true", help="no progress on stderr")
        _add_plugin(command)
        command.set_defaults(words=list(words))
        if name == chosen:
            resolve("commands", name, COMMANDS).add_arguments(command)
    return parser


def _add_plugin(parser: argparse.ArgumentParser) -> None:
    words = "import a module of your own first: parts, sinks and sources; repeatable"
    parser.add_argument("--plugin", action="append", default=[], metavar="MODULE", help=words)


def main(argv: list[str] | None = None) -> int:
    """Run one verb; 0 on success, 1 on a fault, 2 on wrong usage.

    A fault is one sentence on standard error; a bug, ours or of a plugin, keeps its traceback.
    """
    argv = sys.argv[1:] if argv is None else argv
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if sys.stdout is None:
        print("trexton: standard output is closed: send it to /dev/null instead", file=sys.stderr)
        return 1
    chosen = next((word for word in argv if not word.startswith("-")), None)
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    _add_plugin(first)  # what a plugin offers is among the choices of the parser
    try:
        import_plugins(",".join(first.parse_known_args(argv)[0].plugin))
        with contextlib.redirect_stderr(Shown(sys.stderr)):
            arguments = build_parser(chosen, argv).parse_args(argv)
        set_quiet(arguments.quiet)
        verb = resolve("commands", arguments.command, COMMANDS)
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, _interrupt)
        with contextlib.redirect_stdout(Shown(sys.stdout)):
            return verb.run(arguments) or 0
    except KeyboardInterrupt as stop:
        print(f"trexton {chosen}: interrupted", file=sys.stderr)
        return 128 + (signal.SIGTERM if stop.args else signal.SIGINT)
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except Exception as error:  # the one place where foreign errors become sentences
        words = sentence(error)
        if words is None:
            traceback.print_exc()
            words = "this is a bug, of trexton unless the last lines above are of your own module"
        print(shown(f"trexton {chosen}: {words}"), file=sys.stderr)
        return 1


def _interrupt(number: int, frame: FrameType | None) -> None:
    """End a verb as Ctrl+C does, so that it cleans up; a second signal ends it at once."""
    signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt(number)


def sentence(error: Exception) -> str | None:
    """What a person reads of an error; None where it is a bug."""
    if isinstance(error, TrextonError):
        return str(error)
    # Of a shared library that finds no room, only the loader's words tell.
    if isinstance(error, MemoryError) or "failed to map" in f"{error}{error.__context__}":
        return "the memory does not suffice: use fewer frames, or smaller images"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}: nothing was changed, mend it and try again"
    if isinstance(error, UnicodeEncodeError):
        name = ascii(error.object[max(0, error.start - 20) : error.end + 20])
        return f"a name is not UTF-8 (at {name}): rename the file or folder"
    if isinstance(error, RuntimeError) and "home directory" in str(error):
        return "no home folder is known: set HOME to a folder that may be written to"
    if isinstance(error, RecursionError):
        return "an input is nested too deeply: check the files that were given"
    if type(error).__module__.partition(".")[0] == "cv2":
        line = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
        return f"OpenCV refused an image or a picture ({line}): check the files given"
    if isinstance(error, ModuleNotFoundError) and not (error.name or "").startswith("trexton"):
        return _missing_extra(error)
    return None


def _missing_extra(error: ModuleNotFoundError) -> str | None:
    """Which extra brings a package that the library asks for; a plugin's needs are its own."""
    asking = Path(traceback.extract_tb(error.__traceback__)[-1].filename)
    package = Path(__file__).parents[1]
    if package not in asking.parents:
        return None
    extra = "book" if package / "companion" in asking.parents else "flights"
    if package / "onboard" in asking.parents:
        extra = "crazyflie" if asking.stem == "crazyflie" else "mavlink"
    return f"needs the package {error.name!r}, which is not here: pip install 'trexton[{extra}]'"
