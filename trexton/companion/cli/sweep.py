"""``trexton sweep``: an experiment over floors, flights and settings, as one resumable command."""

from __future__ import annotations

import argparse
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trexton.base.arguments import add_assignments, add_options, assignments
from trexton.base.errors import ParameterError
from trexton.base.options import Options, option
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.sweep import Floors, SweepPlan, sweep
from trexton.companion.cli.run import add_cluster_arguments, reaching_cluster

__all__ = ["add_arguments", "run"]


@dataclass(frozen=True)
class SweepOptions(Options):
    """What is swept, here or in a plan"""

    experiment: str | None = option(None, "what is run in every cell")
    test_flight: str | None = option(None, "test on this flight instead of the split")
    floors: int = option(0, "simulate so many floors of each layout", low=0)
    every: int = option(1, "keep every N-th simulated frame", low=1)
    frames: int | None = option(None, "frames of a simulated flight", low=1)


_LISTS = ("flights", "layouts", "values")  # of texts, beside the options and the table `set`


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flights", nargs="*", metavar="FLIGHT", help="flights with a [split]")
    parser.add_argument("--layouts", nargs="+", metavar="NAME", help="layouts of the floors (hall)")
    parser.add_argument("--values", nargs="+", metavar="PATH", help="columns (all single numbers)")
    add_assignments(parser, "KEY=A,B,C", "values of a parameter; all combinations are run")
    add_options(parser, SweepOptions)
    parser.add_argument(
        "--plan", metavar="TOML", help="a file with any of these; what is typed takes its place"
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--jobs", type=int, metavar="N", help="cells at once")
    add_cluster_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    out = Path(arguments.out)
    with reaching_cluster(arguments):
        swept = sweep(_plan(arguments), out, jobs=arguments.jobs, cluster=arguments.cluster)
    for name, reason in swept.failed.items():
        print(f"failed  {name}: {reason}", file=sys.stderr)
    print(", ".join(f"{count} {status}" for status, count in swept.counts.items() if count))
    if swept.rows:
        print(f"{out / 'sweep.csv'} and {out / 'sweep.json'}: {len(swept.rows)} rows")
    return int(bool(swept.failed))


def _plan(arguments: argparse.Namespace) -> SweepPlan:
    """What the file says, with the words of the command line in its place."""
    said: dict[str, Any] = _read(Path(arguments.plan)) if arguments.plan else {}
    place = f"{SweepOptions.__name__}."
    typed = {
        name.removeprefix(place): value
        for name, value in vars(arguments).items()
        if name in _LISTS or name.startswith(place)
    }
    said |= {name: value for name, value in typed.items() if value}
    listed = {name: said.pop(name, []) for name in _LISTS}
    settings = said.pop("set", {}) | {
        key: text.split(",") for key, text in assignments(arguments.settings, "key=a,b,c").items()
    }
    asked = SweepOptions.parse(said, "a plan")
    if asked.experiment is None:
        raise ParameterError("which experiment? Name one with --experiment, or in the plan")
    layouts = tuple(listed["layouts"] or ["hall"])
    return SweepPlan(
        experiment=asked.experiment,
        settings={k: v if isinstance(v, list) else [v] for k, v in settings.items()},
        pairs=[FlightPair(flight, asked.test_flight) for flight in listed["flights"]],
        floors=Floors(asked.floors, layouts, asked.every, asked.frames) if asked.floors else None,
        values=listed["values"],
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        said = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: no readable plan ({error})") from None
    for name in said.keys() & _LISTS:
        if not (isinstance(said[name], list) and all(isinstance(one, str) for one in said[name])):
            raise ParameterError(f"{path}: {name} is {said[name]!r}: expected a list of texts")
    if not isinstance(said.get("set", {}), dict):
        raise ParameterError(f"{path}: set is {said['set']!r}: expected a table")
    return said
