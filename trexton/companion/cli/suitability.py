"""``trexton suitability IMAGE... --width M``: will it work over this floor? A picture is enough."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from trexton.base.arguments import add_options, chosen_options
from trexton.base.errors import ParameterError
from trexton.base.files import check_not_read, check_writable
from trexton.base.progress import say

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.companion.experiments.floors import VirtualFlights

    parser.add_argument(
        "images", nargs="+", metavar="IMAGE",
        help="plan, mosaic or photograph of a floor, or a painted one such as moved:3",
    )  # fmt: skip
    parser.add_argument("--width", type=float, metavar="M", help="width of the floor in metres")
    parser.add_argument(
        "--corners", nargs=4, metavar="X,Y",
        help="pixels of the floor's corners in a photograph, clockwise from the upper left",
    )  # fmt: skip
    parser.add_argument(
        "--length", type=float, metavar="M", help="its other side in metres, with --corners"
    )
    add_options(parser, VirtualFlights)
    parser.add_argument("--changes", action="store_true", help="try what would help most")
    parser.add_argument("--out", metavar="DIR", help="write the heat maps and all numbers there")


def run(arguments: argparse.Namespace) -> int:
    from trexton.companion.experiments.floors import (
        METHOD,
        VirtualFlights,
        helpful_changes,
        judge_floor,
    )

    flights = chosen_options(arguments, VirtualFlights)
    if arguments.length is not None and not arguments.corners:
        raise ParameterError("--length needs --corners too: without them a picture keeps its shape")
    floors = {name: _floor(name, arguments) for name in arguments.images}
    if arguments.out:
        _check_out(Path(arguments.out), floors)
    judged = {name: judge_floor(floor, flights=flights) for name, floor in floors.items()}
    ranked = sorted(judged, key=lambda name: judged[name]["predicted_cm"])
    for place, name in enumerate(ranked, start=1):
        entry = judged[name]
        measured = next(iter(entry["measured"].values()))
        print(
            f"{place}. {name}: expect method {METHOD} to be off by {entry['predicted_cm']:.0f} cm "
            f"on average; on a virtual flight it was by {measured['mean_cm']:.0f} cm "
            f"[{measured['low']:.0f}, {measured['high']:.0f}], "
            f"always guessing the middle by {entry['centre_cm']:.0f} cm"
        )
        if measured["mean_cm"] >= entry["centre_cm"]:
            print("   it will not do: the middle of the floor is as good a guess")
        x, y = entry["worst_m"]
        print(
            f"   hardest place: x = {x:.1f} m, y = {y:.1f} m; the paper's loss: {entry['loss']:.3f}"
        )
        if arguments.changes:
            entry["changes"] = helpful_changes(floors[name], entry, flights=flights)
            for change in entry["changes"]:
                print(f"   {change['gain_cm']:+.0f} cm: {change['change']}")
    if arguments.out:
        _write(Path(arguments.out), floors, judged)
    return 0


def _floor(name: str, arguments: argparse.Namespace) -> Any:
    from trexton.companion.experiments.floors import named_floor
    from trexton.simulator import Floor

    if not Path(name).exists() and (":" in name or "@" in name):
        return named_floor(name)
    if arguments.width is None:
        raise ParameterError(f"{name}: give the floor's width in metres, as in --width 5")
    if arguments.corners:
        if arguments.length is None:
            raise ParameterError("--corners needs --length too, the floor's other side in metres")
        try:
            pairs = [word.split(",") for word in arguments.corners]
            corners = [[float(x), float(y)] for x, y in pairs]
        except ValueError:
            raise ParameterError(
                f"--corners {' '.join(arguments.corners)}: expected four pixels X,Y"
            ) from None
        return Floor.from_photograph(name, corners, arguments.width, arguments.length)
    return Floor.from_file(name, arguments.width)


def _stem(name: str) -> str:
    """What the files of a floor are called."""
    return re.sub(r"\W+", "-", Path(name).stem if Path(name).exists() else name)


def _check_out(folder: Path, floors: Iterable[str]) -> None:
    """Refuse what cannot be written, and to write over a picture or one floor's files over
    another's, before any flight.
    """
    pictures = [name for name in floors if Path(name).is_file()]
    written: dict[str, str] = {}
    for name in floors:
        stem = _stem(name)
        if stem in written:
            raise ParameterError(
                f"{name} and {written[stem]} would both be written to {folder / stem}.png: "
                "give one of them another name, or judge them one by one"
            )
        written[stem] = name
        for suffix in ("json", "png"):
            check_not_read(folder / f"{stem}.{suffix}", *pictures)
            check_writable(folder / f"{stem}.{suffix}")


def _write(folder: Path, floors: dict[str, Any], judged: dict[str, dict[str, Any]]) -> None:
    from trexton.base.files import atomic_file, canonical_json
    from trexton.base.records import plain
    from trexton.companion.experiments.suitability import predicted_errors

    for name, floor in floors.items():
        stem = _stem(name)
        with atomic_file(folder / f"{stem}.json") as stream:
            stream.write(canonical_json(plain(judged[name])))
        with atomic_file(folder / f"{stem}.png", "wb") as stream:
            predicted_errors(floor, judged[name]).savefig(stream, format="png", dpi=150)
        say(f"{folder / stem}.png, {stem}.json")
