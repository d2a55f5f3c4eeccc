"""``trexton simulate``: fly in the virtual room and record a flight."""

from __future__ import annotations

import argparse
from typing import Any

from trexton.base.arguments import add_assignments, assignments
from trexton.base.errors import ParameterError
from trexton.base.progress import say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.simulator import LAYOUTS, PATTERNS, Effects

    defaults = Effects()
    effects = ", ".join(f"{name}={getattr(defaults, name):g}" for name in Effects.names())
    parser.add_argument("--out", required=True, metavar="FLIGHT", help="folder to write")
    parser.add_argument(
        "--replace", action="store_true", help="replace the folder that is there, whatever it is"
    )
    parser.add_argument(
        "--pattern",
        choices=list(PATTERNS),
        default="survey",
        help="survey in lanes (training) or random waypoints an hour later (test)",
    )
    parser.add_argument("--frames", type=int, help="number of frames (survey 800, waypoints 415)")
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="keep every N-th frame only"
    )
    parser.add_argument("--seed", type=int, help="seed of the flight (survey 1, waypoints 2)")
    parser.add_argument(
        "--floor",
        metavar="IMAGE",
        help="picture of the floor instead of the painted hall; alpha 0 is not mapped",
    )
    parser.add_argument(
        "--floor-width", type=float, metavar="M", help="width of the floor picture in metres (5)"
    )
    parser.add_argument(
        "--floor-seed", type=int, default=0, metavar="S", help="seed of the painted hall (0)"
    )
    parser.add_argument(
        "--layout", choices=list(LAYOUTS), default="hall", help="how the hall's mats lie (hall)"
    )
    parser.add_argument(
        "--height", type=float, default=1.0, metavar="M", help="flying height in metres (1)"
    )
    words = f"strength of an effect; the defaults are {effects}"
    add_assignments(parser, "EFFECT=VALUE", words)
    parser.add_argument(
        "--off",
        action="append",
        default=[],
        metavar="EFFECT",
        help="switch an effect off, or 'all'",
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import check_not_read
    from trexton.simulator import Floor, record_flight

    if arguments.floor_width is not None and arguments.floor is None:
        raise ParameterError(
            "--floor-width is given without --floor: it is the width of a floor picture"
        )
    if arguments.floor is not None:
        check_not_read(arguments.out, arguments.floor)
        floor = Floor.from_file(
            arguments.floor, 5.0 if arguments.floor_width is None else arguments.floor_width
        )
    else:
        floor = Floor.painted(arguments.layout, arguments.floor_seed)
    flight = record_flight(
        arguments.out,
        pattern=arguments.pattern,
        frames=arguments.frames,
        seed=arguments.seed,
        floor=floor,
        effects=_effects(arguments.settings, arguments.off),
        height=arguments.height,
        every=arguments.every,
        replace=arguments.replace,
    )
    say(f"{arguments.out}: {len(flight)} frames, {flight.time[-1] - flight.time[0]:.1f} s")
    return 0


def _effects(settings: list[str], off: list[str]) -> Any:
    from dataclasses import replace

    from trexton.simulator import Effects

    effects = Effects.none() if "all" in off else Effects().without(*off)
    for name, value in assignments(settings, "effect=value").items():
        if name not in Effects.names():
            raise ParameterError(
                f"unknown effect {name!r}: the effects are {', '.join(Effects.names())}"
            )
        try:
            effects = replace(effects, **{name: float(value)})
        except ValueError as error:
            message = (
                str(error)
                if isinstance(error, ParameterError)
                else f"effect {name} is {value!r}: expected a number"
            )
            raise ParameterError(message) from None
    return effects
