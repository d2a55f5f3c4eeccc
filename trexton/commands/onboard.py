"""``trexton onboard MAP``: an option for each field of `trexton.onboard.Settings`, with its default."""

from __future__ import annotations

import argparse
from dataclasses import fields

from trexton.progress import say

__all__ = ["add_arguments", "run"]

# field: (option, metavar or None, help)
_GENERAL = {
    "camera": (
        "--camera",
        "SOURCE",
        "/dev/videoN, flight[#PART], image folder, video file or URL, simulator",
    ),
    "log": ("--log", "FILE", "write every position, fault and answer as JSON lines"),
    "rate": ("--rate", "HZ", "frames a second (default: the map's own)"),
    "samples": ("--samples", "N", "patches drawn a frame, 0 for all"),
    "method": ("--method", "NAME", "another method than the map was trained for"),
    "particles": ("--particles", "N", "particles of the filter (default 50)"),
    "seed": ("--seed", "N", "of everything that is drawn"),
    "pace": (
        "--pace",
        None,
        "a recording as fast as possible, or at its own stamps (default: fast)",
    ),
    "laps": ("--laps", "N", "play a recording N times"),
    "frames": ("--frames", "N", "stop after N frames"),
}
_AUTOPILOT = {
    "autopilot": ("--autopilot", None, "how positions are told to it over MAVLink"),
    "heading_deg": ("--heading", "DEG", "compass heading of the map's +y axis"),
    "height": ("--height", "M", "flying height, which is not estimated"),
    "origin": ("--origin", "LAT,LON,ALT", "set the autopilot's global origin"),
}
_LANDING = {
    "land": ("--land", "X,Y", "centre of the landing zone on the map, in metres"),
    "radius": ("--radius", "R", "its radius in metres"),
    "spread": ("--spread", "S", "largest spread of the particles in metres, one number or X,Y"),
    "consecutive": ("--consecutive", "N", "estimates in a row that must agree"),
}
_CHOICES = {
    "pace": ("fast", "stamps"),
    "autopilot": ("px4", "ardupilot"),
}


def _numbers(count: int):
    def parse(text: str) -> tuple[float, ...]:
        values = tuple(float(part) for part in text.split(","))
        if len(values) != count:
            raise ValueError
        return values

    parse.__name__ = f"{count} numbers with commas"
    return parse


def _one_or_two(text: str) -> tuple[float, float]:
    return _numbers(2)(text if "," in text else f"{text},{text}")


_TYPES = {
    "rate": float, "samples": int, "particles": int, "seed": int, "laps": int, "frames": int, "heading_deg": float,
    "height": float, "origin": _numbers(3), "land": _numbers(2), "radius": float, "spread": _one_or_two, "consecutive": int,
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.onboard import Settings
    from trexton.onboard.sinks import SINKS

    defaults = {field.name: field.default for field in fields(Settings)}
    parser.add_argument("map", metavar="MAP", help="texton map made by trexton train")
    parser.add_argument(
        "--set", dest="choices", action="append", default=[], metavar="ROLE[.OPTION]=VALUE",
        help="another part, or an option of one, repeatable: recovery=augmented",
    )  # fmt: skip
    kinds = f"KIND or KIND:ADDRESS, repeatable; kinds: {', '.join(SINKS)} (default json)"
    parser.add_argument(
        "--output", dest="outputs", action="append", default=[], metavar="SINK", help=kinds
    )
    autopilot, landing = (
        parser.add_argument_group("autopilot"),
        parser.add_argument_group("landing"),
    )
    for group, options in ((parser, _GENERAL), (autopilot, _AUTOPILOT), (landing, _LANDING)):
        for name, (option, metavar, words) in options.items():
            default = defaults[name]
            shown = (
                f" (default {default[0] if name == 'spread' else default})"
                if default is not None
                else ""
            )
            kind = (
                {"choices": _CHOICES[name]}
                if name in _CHOICES
                else {"metavar": metavar, "type": _TYPES.get(name, str)}
            )
            group.add_argument(option, dest=name, default=default, help=words + shown, **kind)
    landing.add_argument(
        "--arm-landing",
        action="store_true",
        help="command the landing; without it, it is only said",
    )


def run(arguments: argparse.Namespace) -> int:
    import json

    from trexton.onboard import Settings, build
    from trexton.onboard.signals import stopped_by_signals
    from trexton.records import plain

    chosen = {field.name: getattr(arguments, field.name) for field in fields(Settings)}
    lists = {
        "outputs": tuple(arguments.outputs or ["json"]),
        "choices": tuple(arguments.choices),
    }
    settings = Settings(**chosen | lists)
    with stopped_by_signals() as stop:
        summary = build(settings).run(stop)
    say("trexton onboard: " + json.dumps(plain(summary)))
    return 0
