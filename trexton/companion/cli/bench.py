"""``trexton bench``: speed of every stage against yardsticks of the same run."""

from __future__ import annotations

import argparse

from trexton.base.files import atomic_file, canonical_json
from trexton.base.records import machine
from trexton.companion.checks.bench import STAGES, measure, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--stage", nargs="+", metavar="NAME", help=f"only these: {', '.join(STAGES)}"
    )
    parser.add_argument("--quick", action="store_true", help="fewer repeats, smaller sizes")
    parser.add_argument("--json", metavar="FILE", help="write the rows as a JSON list")
    parser.add_argument(
        "--seed", type=int, default=1, help="of the frames worked on (default %(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    rows = list(measure(arguments.stage, quick=arguments.quick, seed=arguments.seed))
    if arguments.json:
        with atomic_file(arguments.json) as stream:
            stream.write(canonical_json([row.as_dict() for row in rows]))
    here = machine()
    busy = "" if here["load"] is None else f", load {here['load']:.1f}"
    print(f"{here['processor']}, {here['processors']} processors{busy}")
    print(table(rows))
    return 0
