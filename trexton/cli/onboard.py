"""``trexton onboard MAP``: localize live frames. Positions go to the sinks that were asked for."""

import _thread
import argparse
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from trexton.base.arguments import add_assignments, add_options, chosen_options
from trexton.base.options import Options

# Before NumPy is loaded: the products of a frame are so small that its threads wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = parser.get_default("words")
    parser.add_argument("map", metavar="MAP", help="texton map made by trexton train")
    output = parser.add_argument("--output", action="append", default=[], metavar="SINK")
    meaning = "another part, or an option of one that trexton methods lists, repeatable"
    add_assignments(parser, "ROLE[.OPTION]=VALUE", meaning)
    meaning = "check camera, map and autopilot for some seconds, a line each, and command nothing"
    parser.add_argument("--preflight", action="store_true", help=meaning)
    kinds = _classes(words, installed=False)
    flags = {*parser._option_string_actions, *(k.flag(o.name) for k in kinds for o in k.declared())}
    typed = {word.partition("=")[0] for word in words if word.startswith("-")}
    # What packages are installed takes long to read: for a word that may be of theirs, or for help.
    if not words or not typed <= flags - {"-h", "--help"}:
        from trexton.base.plugins import addresses
        from trexton.onboard.sinks import SINKS
        from trexton.onboard.sources import SOURCES

        kinds = _classes(words, installed=True)
        named = ", ".join(addresses("sinks", SINKS))
        meaning = f"KIND, KIND:ADDRESS or module:Class:ADDRESS, repeatable; kinds: {named}"
        output.help = f"{meaning} (default json)"
        cameras = ", ".join(addresses("sources", SOURCES))
        parser.epilog = f"Kinds of camera, as in KIND:ADDRESS: {cameras}."
    for kind in kinds:
        add_options(parser, kind)
    parser.set_defaults(kinds=kinds)


def run(arguments: argparse.Namespace) -> int:
    import json

    from trexton.base.errors import TrextonError
    from trexton.base.records import plain
    from trexton.onboard.build import build
    from trexton.onboard.settings import Flying, Settings
    from trexton.onboard.tally import flush, say

    settings = Settings(
        arguments.map,
        tuple(arguments.output or ["json"]),
        tuple(arguments.settings),
        {kind: chosen_options(arguments, kind) for kind in arguments.kinds},
    )
    if arguments.preflight:
        from trexton.cli.preflight import preflight

        checks = preflight(settings)
        print("\n".join(map(str, checks)))
        return int(not all(check.holds for check in checks))
    with stopped_by_signals() as stop:
        summary = build(settings).run(stop)
    say("trexton onboard: " + json.dumps(plain(summary)))
    flush()
    files = [each.partition(":")[2] for each in settings.outputs] + [settings.of(Flying).log]
    lacking = {name: n for name, n in summary["left_out"].items() if name in files}
    if lacking:
        found = ", ".join(f"{name}: {count} lines were left out" for name, count in lacking.items())
        raise TrextonError(f"{found} (a full disk?): make room")
    if summary["frames"] and not summary["observed"]:
        faults = ", ".join(f"{name} {count}" for name, count in summary["faults"].items())
        said = f"not one of {summary['frames']} frames could be localized ({faults})"
        raise TrextonError(f"{said}: check --camera, and that the map is of such frames")
    return 0


def _classes(words: Sequence[str], installed: bool) -> list[type[Options]]:
    """All that has options, of `installed` packages too or with those that `words` name alone."""
    from trexton.onboard.edges import classes_of_options, edge_classes
    from trexton.onboard.settings import Flying, Landing, MapPlacement
    from trexton.onboard.sinks import SINKS
    from trexton.onboard.sources import SOURCES

    def typed(flag: str) -> list[str]:
        after = [word for before, word in zip(words, words[1:], strict=False) if before == flag]
        return after + [word.partition("=")[2] for word in words if word.startswith(flag + "=")]

    sources = edge_classes("sources", SOURCES, typed("--camera"), installed=installed)
    sinks = edge_classes("sinks", SINKS, typed("--output"), installed=installed)
    return [Flying, MapPlacement, Landing, *classes_of_options([*sources, *sinks])]


def set_elsewhere(event: threading.Event) -> None:
    """Set an event from a signal handler. The thread that it interrupts may hold the event's lock:
    one of its own waits for that, begun without any."""
    _thread.start_new_thread(event.set, ())


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that the first SIGINT or SIGTERM sets; a second one ends the flight at once. SIGHUP
    ends nothing: a terminal that was closed, or a link that broke, is only for eyes.
    """
    stop = threading.Event()
    endings = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in (*endings, signal.SIGHUP)}

    def restore() -> None:
        for number in endings:
            signal.signal(number, before[number])

    def handle(number: int, frame: FrameType | None) -> None:
        set_elsewhere(stop)
        restore()

    for number in endings:
        signal.signal(number, handle)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield stop
    finally:
        restore()
        signal.signal(signal.SIGHUP, before[signal.SIGHUP])
