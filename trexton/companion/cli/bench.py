"""``trexton bench``: the speed of every stage. Yardsticks of the same run make ratios of it."""

import argparse
from dataclasses import dataclass
from typing import Any

from trexton.base.arguments import add_options, chosen_options
from trexton.base.files import canonical_json, check_writable, write_file
from trexton.base.options import Options, option
from trexton.companion.checks.bench import LONG, STAGES, measure, measure_board
from trexton.companion.checks.timing import table
from trexton.companion.provenance import machine


@dataclass(frozen=True)
class BenchOptions(Options):
    """What is measured"""

    quick: bool = option(False, "fewer repeats, fewer frames")
    seed: int = option(1, "of the flight and the maps worked on", low=0)
    board: bool = option(
        False, "only how fast this computer flies, as JSON for the book's table of boards"
    )
    json: str | None = option(None, "write the rows to this file as a JSON list")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = f"only these: {', '.join(STAGES)}; {' and '.join(LONG)} are measured only where named"
    parser.add_argument("--stage", nargs="+", metavar="NAME", help=words)
    add_options(parser, BenchOptions)


def run(arguments: argparse.Namespace) -> int:
    asked = chosen_options(arguments, BenchOptions)
    if asked.json:
        check_writable(asked.json)
    rows: Any = (
        measure_board(200 if asked.quick else 600, seed=asked.seed)
        if asked.board
        else list(measure(arguments.stage, quick=asked.quick, seed=asked.seed))
    )
    if asked.json:
        write_file(asked.json, canonical_json(rows))
    if asked.board:
        print(canonical_json(rows))
        return 0
    here = machine()
    busy = "" if here["load"] is None else f", load {here['load']:.1f}"
    print(f"{here['processor']}, {here['processors']} processors{busy}")
    print(table(rows))
    return 0
