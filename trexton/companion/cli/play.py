"""``trexton play FLIGHT --map MAP --out PAGE``: a page that plays a flight frame by frame."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from trexton.base.arguments import add_options, chosen_options
from trexton.base.defaults import SAMPLES
from trexton.base.options import Options, option

__all__ = ["add_arguments", "run"]


@dataclass(frozen=True)
class PlayOptions(Options):
    """How the flight is replayed"""

    samples: int = option(SAMPLES, "patches of a frame, 0 for all", low=0)
    frames: int = option(180, "to show", low=1)
    seed: int = option(1, "of the samples and the particles", low=0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its test split is played where it has one")
    parser.add_argument("--map", required=True, metavar="MAP", help="the texton map (.npz)")
    parser.add_argument("--out", required=True, metavar="PAGE", help="the page to write (.html)")
    parser.add_argument(
        "--method", action="append", metavar="NAME",
        help="a method that the map was trained for, repeatable; the first is shown in detail "
        "(default: the map's own)",
    )  # fmt: skip
    add_options(parser, PlayOptions)


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import atomic_file, check_not_read, check_writable
    from trexton.base.progress import say
    from trexton.base.streams import stream
    from trexton.companion.player.playback import player_html, record_replay
    from trexton.flights import read_flight
    from trexton.localization.localizer import Localizer
    from trexton.localization.map_files import load_map

    asked = chosen_options(arguments, PlayOptions)
    check_not_read(arguments.out, arguments.map, arguments.flight)
    check_writable(arguments.out)
    texton_map = load_map(arguments.map)
    flight = read_flight(arguments.flight).part_or_all("test")
    localizers = {
        name or texton_map.method: Localizer(
            texton_map,
            method=name,
            samples=asked.samples or None,
            rng=stream(asked.seed, "flight", 0),
        )
        for name in arguments.method or [None]
    }
    say(f"replaying {len(flight)} frames of {flight.name}")
    page = player_html(record_replay(localizers, flight, most_frames=asked.frames))
    with atomic_file(arguments.out) as out:
        out.write(page)
    say(f"the player is {arguments.out}: open it in a browser")
    return 0
