"""``trexton train FLIGHT -o MAP``: make a texton map from a flight."""

from __future__ import annotations

import argparse
from typing import Any

from trexton.base.arguments import add_assignments
from trexton.base.defaults import NEIGHBORS, PATCH, TEXTONS, USUAL_CELLS
from trexton.base.progress import say
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its train split is used where it has one")
    parser.add_argument(
        "-o", "--output", required=True, metavar="MAP", help="the texton map to write (.npz)"
    )
    parser.add_argument(
        "--textons",
        type=int,
        default=TEXTONS,
        help="textons in the dictionary (default %(default)s)",
    )
    parser.add_argument(
        "--patch", type=int, default=PATCH, help="side of a patch in pixels (default %(default)s)"
    )
    usual = ", ".join(f"{cells} of method {method}" for method, cells in USUAL_CELLS.items())
    parser.add_argument(
        "--cells",
        type=int,
        help=f"parts of the image a side, each with a histogram (default 1; {usual})",
    )
    parser.add_argument(
        "--method", default="paper", help="the set of parts to train (default %(default)s)"
    )
    parser.add_argument(
        "--neighbors", type=int, help=f"short for --set measurement.neighbors (default {NEIGHBORS})"
    )
    words = "another part, or an option of one, repeatable: distance=hellinger, motion.sigma=0.2"
    add_assignments(parser, "ROLE[.OPTION]=VALUE", words)
    parser.add_argument(
        "--seed", type=int, default=1, help="of the random patches (default %(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import check_not_read, check_writable
    from trexton.base.streams import stream
    from trexton.flights import read_flight
    from trexton.localization.methods import parse_choices

    check_not_read(arguments.output, arguments.flight)
    check_writable(arguments.output)
    flight = read_flight(arguments.flight).part_or_all("train")
    choices: dict[str, Any] = {**parse_choices(arguments.settings)}
    texton_map = train_map(
        flight,
        method=arguments.method,
        n_textons=arguments.textons,
        patch=arguments.patch,
        cells=arguments.cells,
        neighbors=arguments.neighbors,
        # The stream that experiments train with, so that equal seeds give equal maps.
        rng=stream(arguments.seed, "training"),
        **choices,
    )
    path = save_map(texton_map, arguments.output)
    say(f"{len(texton_map.positions)} frames of {flight.name} became {path}")
    return 0
