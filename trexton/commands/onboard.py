"""``trexton onboard MAP``"""

from __future__ import annotations

import argparse

from trexton.progress import say

__all__ = ["add_arguments", "run"]


def _numbers(count: int, least: int | None = None):
    def parse(text: str) -> tuple[float, ...]:
        values = tuple(float(part) for part in text.split(","))
        if not (least or count) <= len(values) <= count:
            raise ValueError
        return values

    parse.__name__ = f"{count} numbers with commas"
    return parse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.onboard.sinks import SINKS

    add = parser.add_argument
    add("map", metavar="MAP", help="texton map made by trexton train")
    add("--camera", default="/dev/video0", metavar="SOURCE", help="/dev/videoN, flight folder (#PART for a split), image folder, video file or URL, simulator (default %(default)s)")
    add("--output", action="append", default=[], metavar="SINK", help=f"KIND or KIND:ADDRESS, repeatable; kinds: {', '.join(SINKS)} (default json)")
    add("--log", metavar="FILE", help="write every position, fault and answer as JSON lines")
    add("--rate", type=float, metavar="HZ", help="frames a second (default: the map's own)")
    add("--samples", type=int, default=400, help="patches drawn a frame, 0 for all (default %(default)s)")
    add("--particles", type=int, default=50, help="(default %(default)s)")
    add("--recovery", default="augmented", choices=("augmented", "none"), help="random particles when the frames stop fitting; none is the paper's filter (default %(default)s)")
    add("--seed", type=int, default=1, help="(default %(default)s)")
    add("--pace", choices=("fast", "stamps"), help="play a recording as fast as possible, or at its own stamps (default: recordings fast, simulator at its stamps)")
    add("--laps", type=int, default=1, metavar="N", help="play a recording N times")
    add("--frames", type=int, metavar="N", help="stop after N frames")
    group = parser.add_argument_group("autopilot")
    add = group.add_argument
    add("--autopilot", choices=("px4", "ardupilot"), default="px4", help="(default %(default)s)")
    add("--heading", type=float, default=0.0, metavar="DEG", help="compass heading of the map's +y axis (default %(default)g)")
    add("--height", type=float, default=1.0, metavar="M", help="flying height, which is not estimated (default %(default)g)")
    add("--origin", type=_numbers(3), metavar="LAT,LON,ALT", help="set the autopilot's global origin")
    group = parser.add_argument_group("landing")
    add = group.add_argument
    add("--land", type=_numbers(2), metavar="X,Y", help="centre of the landing zone on the map, in metres")
    add("--radius", type=float, default=0.6, metavar="R", help="its radius in metres (default %(default)g)")
    add("--spread", type=_numbers(2, 1), default=(0.6,), metavar="S", help="largest spread of the particles in metres, one number or X,Y (default 0.6)")
    add("--consecutive", type=int, default=3, metavar="N", help="estimates in a row that must agree (default %(default)s)")
    add("--arm-landing", action="store_true", help="command the landing; without it, it is only said")


def run(arguments: argparse.Namespace) -> int:
    import json

    from trexton.onboard import Settings, build
    from trexton.onboard.signals import stopped_by_signals
    from trexton.records import plain

    settings = Settings(
        map=arguments.map, camera=arguments.camera, outputs=tuple(arguments.output or ["json"]), samples=arguments.samples,
        particles=arguments.particles, recovery=arguments.recovery, seed=arguments.seed, rate=arguments.rate, pace=arguments.pace,
        laps=arguments.laps, frames=arguments.frames, log=arguments.log, autopilot=arguments.autopilot,
        heading_deg=arguments.heading, height=arguments.height, origin=arguments.origin, land=arguments.land,
        radius=arguments.radius, spread=(arguments.spread * 2)[:2], consecutive=arguments.consecutive,
        arm_landing=arguments.arm_landing,
    )  # fmt: skip
    with stopped_by_signals() as stop:
        summary = build(settings).run(stop)
    say("trexton onboard: " + json.dumps(plain(summary)))
    return 0
