"""``trexton suitability IMAGE... --width M``: will it work over this floor? A picture is enough."""

import argparse
import re
from collections.abc import Iterable
from functools import partial
from operator import call
from pathlib import Path
from typing import Any

from trexton.base.arguments import add_options, chosen_options
from trexton.base.errors import ParameterError
from trexton.base.files import canonical_json, check_not_read, check_writable, write_file
from trexton.base.progress import say
from trexton.base.records import plain
from trexton.companion.executor import spreading, working_on
from trexton.companion.experiments import virtual_flights
from trexton.companion.experiments.floors import named_floor
from trexton.simulator.floor import Floor
from trexton.vision.threads import usable_cores


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "plan, mosaic or photograph of a floor, or a painted one such as moved:3"
    parser.add_argument("images", nargs="+", metavar="IMAGE", help=words)
    parser.add_argument("--width", type=float, metavar="M", help="width of the floor in metres")
    add_options(parser, virtual_flights.VirtualFlights)
    parser.add_argument("--out", metavar="DIR", help="write the heat maps and all numbers there")


def run(arguments: argparse.Namespace) -> int:
    flights = chosen_options(arguments, virtual_flights.VirtualFlights)
    floors = {name: _floor(name, arguments) for name in arguments.images}
    files = _files(Path(arguments.out), floors) if arguments.out else {}
    both = virtual_flights.first_prediction, virtual_flights.judge_floor
    steps = [partial(step, floor, flights=flights) for step in both for floor in floors.values()]
    # A single floor is judged here, on all cores: processes would share less of the work.
    with working_on(processes=min(len(floors), usable_cores())):
        if len(floors) == 1:
            answers = virtual_flights.predictions(*floors.values(), flights=flights)
        else:
            answers = spreading(call, steps, "floors")
        for name in floors:
            if (error_cm := next(answers)) is not None:
                say(f"{name}: about {error_cm:.0f} cm by first, coarse flights")
        if files:  # heat maps need the extra, and a while to load it; the verdict does not
            from trexton.companion.experiments.figure_files import to_png
            from trexton.companion.experiments.suitability import predicted_errors
        judged = dict(zip(floors, answers, strict=True))
    ranked = sorted(judged, key=lambda name: judged[name]["predicted_cm"])
    for place, name in enumerate(ranked, start=1):
        entry = judged[name]
        print(
            f"{place}. {name}: expect method {virtual_flights.METHOD} to be off by "
            f"{entry['predicted_cm']:.0f} cm on average [{entry['low']:.0f}, {entry['high']:.0f}], "
            f"as on virtual flights, always guessing the middle by {entry['centre_cm']:.0f} cm"
        )
        if entry["predicted_cm"] >= entry["centre_cm"]:
            print("   it will not do: the middle of the floor is as good a guess")
        elif entry["high"] >= entry["centre_cm"]:
            print("   it may not do: that is not clearly better than guessing the middle")
        x, y = entry["worst_m"]
        print(
            f"   hardest place: x = {x:.1f} m, y = {y:.1f} m; the paper's loss: {entry['loss']:.3f}"
        )
    for name, file in files.items():
        write_file(f"{file}.json", canonical_json(plain(judged[name])))
        write_file(f"{file}.png", to_png(predicted_errors(floors[name], judged[name])))
        say(f"{file}.png, {file.name}.json")
    return 0


def _floor(name: str, arguments: argparse.Namespace) -> Any:
    if not Path(name).exists() and (":" in name or "@" in name):
        return named_floor(name)
    if arguments.width is None:
        raise ParameterError(f"{name}: give the floor's width in metres, as in --width 5")
    floor = Floor.from_file(name, arguments.width)
    if (pixels := floor.picture.image.shape[1] / arguments.width) < 50:  # a camera sees more
        say(f"{name}: {pixels:.0f} pixels a metre: this floor is blurred, give a finer picture")
    return floor


def _files(folder: Path, floors: Iterable[str]) -> dict[str, Path]:
    """Where the files of each floor go, without their endings. What cannot be written is refused
    before any flight, and to write over a picture or one floor's files over another's.
    """
    import matplotlib  # noqa: F401 - draws the heat maps: an extra, missed before any flight

    pictures = [name for name in floors if Path(name).is_file()]
    files: dict[str, Path] = {}
    for name in floors:
        place = folder / re.sub(r"\W+", "-", Path(name).stem if Path(name).exists() else name)
        if place in files.values():
            raise ParameterError(
                f"{name} and another would both be written to {place}.png: "
                "give one of them another name, or judge them one by one"
            )
        files[name] = place
        for suffix in ("json", "png"):
            check_not_read(f"{place}.{suffix}", *pictures)
            check_writable(f"{place}.{suffix}")
    return files
