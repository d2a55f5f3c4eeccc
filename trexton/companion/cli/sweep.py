"""``trexton sweep PLAN``: an experiment over floors, flights and settings, as one resumable
command.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trexton.companion.build.sweep import read_plan, sweep
from trexton.companion.cli.run import add_cluster_arguments, reaching_cluster

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "plan", metavar="PLAN",
        help="a TOML file: experiment; flights, test_flight; floors, layouts, every, frames; and "
        "a table [set] with the values of parameters, of which all combinations are run",
    )  # fmt: skip
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--jobs", type=int, metavar="N", help="cells at once")
    add_cluster_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    plan, out = read_plan(Path(arguments.plan)), Path(arguments.out)
    with reaching_cluster(arguments):
        swept = sweep(plan, out, jobs=arguments.jobs, cluster=arguments.cluster)
    for name, reason in swept.failed.items():
        print(f"failed  {name}: {reason}", file=sys.stderr)
    print(", ".join(f"{count} {status}" for status, count in swept.counts.items() if count))
    if swept.rows:
        print(f"{out / 'sweep.csv'} and {out / 'sweep.json'}: {len(swept.rows)} rows")
    return int(bool(swept.failed))
