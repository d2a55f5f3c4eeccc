"""``trexton sweep PLAN``: an experiment over flights and settings. One command that can resume."""

import argparse
import sys
from pathlib import Path

from trexton.companion.build.sweep import read_plan, sweep


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "plan", metavar="PLAN",
        help="a TOML file: experiment, flights, test_flight, and a table [set] with the values of "
        "parameters, of which all combinations are run",
    )  # fmt: skip
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--jobs", type=int, metavar="N", help="cells at once")
    parser.add_argument(
        "--cluster", metavar="ADDRESS",
        help="run on a Dask cluster, such as tls://HOST:8786, whose workers see the same folders",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    plan, out = read_plan(Path(arguments.plan)), Path(arguments.out)
    swept = sweep(plan, out, jobs=arguments.jobs, cluster=arguments.cluster)
    for name, reason in swept.failed.items():
        print(f"failed  {name}: {reason}", file=sys.stderr)
    print(", ".join(f"{count} {status}" for status, count in swept.counts.items() if count))
    if swept.rows:
        print(f"{out / 'sweep.csv'} and {out / 'sweep.json'}: {len(swept.rows)} rows")
    return int(bool(swept.failed))
