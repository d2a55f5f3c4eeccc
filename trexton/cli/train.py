"""``trexton train FLIGHT -o MAP``: make a texton map from a flight."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

from trexton.base.arguments import add_assignments, add_options, chosen_options
from trexton.base.defaults import NEIGHBORS, PATCH, TEXTONS, USUAL_CELLS
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map

__all__ = ["add_arguments", "run"]

_USUAL = ", ".join(f"{cells} of method {method}" for method, cells in USUAL_CELLS.items())


@dataclass(frozen=True)
class TrainOptions(Options):
    """What is trained"""

    textons: int = option(TEXTONS, "textons in the dictionary")
    patch: int = option(PATCH, "side of a patch in pixels")
    cells: int | None = option(
        None, f"parts of the image a side, each with a histogram (default 1; {_USUAL})"
    )
    method: str = option("paper", "the set of parts to train")
    neighbors: int | None = option(
        None, f"short for --set measurement.neighbors (default {NEIGHBORS})"
    )
    seed: int = option(1, "of the random patches")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its train split is used where it has one")
    parser.add_argument(
        "-o", "--output", required=True, metavar="MAP", help="the texton map to write (.npz)"
    )
    words = "another part, or an option of one, repeatable: distance=hellinger, motion.sigma=0.2"
    add_assignments(parser, "ROLE[.OPTION]=VALUE", words)
    add_options(parser, TrainOptions)


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import check_not_read, check_writable
    from trexton.base.streams import stream
    from trexton.flights import read_flight
    from trexton.localization.methods import parse_choices

    options = chosen_options(arguments, TrainOptions)
    check_not_read(arguments.output, arguments.flight)
    check_writable(arguments.output)
    flight = read_flight(arguments.flight).part_or_all("train")
    choices: dict[str, Any] = {**parse_choices(arguments.settings)}
    texton_map = train_map(
        flight,
        method=options.method,
        n_textons=options.textons,
        patch=options.patch,
        cells=options.cells,
        neighbors=options.neighbors,
        # The stream that experiments train with, so that equal seeds give equal maps.
        rng=stream(options.seed, "training"),
        **choices,
    )
    path = save_map(texton_map, arguments.output)
    say(f"{len(texton_map.positions)} frames of {flight.name} became {path}")
    return 0
