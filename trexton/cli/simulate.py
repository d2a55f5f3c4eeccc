"""``trexton simulate``: fly in the virtual room. The flight is recorded as a folder."""

import argparse
from dataclasses import dataclass

from trexton.base.arguments import add_assignments, add_options, assignments, chosen_options
from trexton.base.errors import ParameterError
from trexton.base.files import check_not_read
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.simulator.floor import LAYOUTS, Floor
from trexton.simulator.recording import PATTERNS, record_flight
from trexton.simulator.sensor import Effects


@dataclass(frozen=True)
class SimulateOptions(Options):
    """What is flown"""

    pattern: str = option("survey", "lanes, or for a test waypoints later", choices=tuple(PATTERNS))
    frames: int | None = option(None, "number of frames (survey 800, waypoints 415)")
    every: int = option(1, "keep every N-th frame only")
    seed: int | None = option(None, "seed of the flight (survey 1, waypoints 2)")
    floor: str | None = option(None, "picture instead of the painted hall; alpha 0 is not mapped")
    floor_width: float | None = option(None, "width of the floor picture in metres (5)")
    floor_seed: int = option(0, "seed of the painted hall")
    layout: str = option("hall", "how the hall's mats lie", choices=tuple(LAYOUTS))
    height: float = option(1.0, "flying height in metres")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", required=True, metavar="FLIGHT", help="folder to write")
    parser.add_argument("--replace", action="store_true", help="replace the folder that is there")
    add_options(parser, SimulateOptions)
    effects = ", ".join(f"{each.name}={each.default:g}" for each in Effects.declared())
    words = f"strength of an effect, 0 switches it off; the defaults are {effects}"
    add_assignments(parser, "EFFECT=VALUE", words)


def run(arguments: argparse.Namespace) -> int:
    options = chosen_options(arguments, SimulateOptions)
    effects = Effects.parse(assignments(arguments.settings, "effect=value"), "a camera")
    if options.floor is None:
        if options.floor_width is not None:
            raise ParameterError("--floor-width is given without --floor: add the picture")
        floor = Floor.painted(options.layout, options.floor_seed)
    else:
        if (options.layout, options.floor_seed) != (SimulateOptions.layout, 0):
            raise ParameterError("--layout and --floor-seed are of a painted hall: no --floor then")
        check_not_read(arguments.out, options.floor)
        width = 5.0 if options.floor_width is None else options.floor_width
        floor = Floor.from_file(options.floor, width)
    names = ("pattern", "frames", "every", "seed", "height")
    flown = {name: getattr(options, name) for name in names}
    flight = record_flight(
        arguments.out, floor=floor, effects=effects, replace=arguments.replace, **flown
    )
    say(f"{arguments.out}: {len(flight)} frames, {flight.time[-1] - flight.time[0]:.1f} s")
    return 0
