"""``trexton sweep``: an experiment over floors, flights and settings, as one resumable command."""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

from trexton.base.arguments import add_assignments, assignments
from trexton.base.errors import ParameterError
from trexton.base.files import atomic_file, check_not_read, check_writable
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.sweep import Floors, SweepPlan, sweep

_TEXT, _TEXTS, _WHOLE = "text in quotes", "a list of texts", "a whole number"
# What a plan may have, and what each of it is.
_KEYS = {
    "experiment": _TEXT, "set": "a table", "flights": _TEXTS, "test_flight": _TEXT,
    "floors": _WHOLE, "layouts": _TEXTS, "every": _WHOLE, "frames": _WHOLE, "values": _TEXTS,
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flights", nargs="*", metavar="FLIGHT", help="flights with a [split]")
    parser.add_argument("--test-flight", metavar="FLIGHT", help="test on this one instead")
    parser.add_argument("--plan", metavar="TOML", help=f"a file with any of {', '.join(_KEYS)}")
    parser.add_argument("--experiment", metavar="NAME", help="what is run in every cell")
    add_assignments(parser, "KEY=A,B,C", "values of a parameter; all combinations are run")
    parser.add_argument("--floors", type=int, metavar="N", help="simulate so many floors")
    parser.add_argument("--layouts", nargs="+", metavar="NAME", help="layouts of the floors (hall)")
    parser.add_argument("--every", type=int, metavar="N", help="keep every N-th simulated frame")
    parser.add_argument("--frames", type=int, metavar="N", help="frames of a simulated flight")
    parser.add_argument("--values", nargs="+", metavar="PATH", help="columns (all single numbers)")
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--keep", metavar="FILE", help="copy the table (JSON) to this file too")
    parser.add_argument("--jobs", type=int, metavar="N", help="cells at once")
    parser.add_argument("--cluster", metavar="ADDRESS", help="run on a Dask cluster")


def run(arguments: argparse.Namespace) -> int:
    out, plan = Path(arguments.out), _plan(arguments)
    if arguments.keep:
        flights = [path for pair in plan.pairs for path in (pair.flight, pair.test_flight)]
        check_not_read(arguments.keep, *filter(None, [arguments.plan, *flights]))
        check_writable(arguments.keep)
    swept = sweep(plan, out, jobs=arguments.jobs, cluster=arguments.cluster)
    if arguments.keep and not swept.failed:
        with atomic_file(Path(arguments.keep), "wb") as stream:
            stream.write((out / "sweep.json").read_bytes())
    for name, reason in swept.failed.items():
        print(f"failed  {name}: {reason}", file=sys.stderr)
    print(", ".join(f"{count} {status}" for status, count in swept.counts.items() if count))
    if swept.rows:
        print(f"{out / 'sweep.csv'} and {out / 'sweep.json'}: {len(swept.rows)} rows")
    return int(bool(swept.failed))


def _plan(arguments: argparse.Namespace) -> SweepPlan:
    """What the file says, with the words of the command line in its place."""
    said: dict[str, Any] = _read(Path(arguments.plan)) if arguments.plan else {}
    for name in ("experiment", "test_flight", "floors", "layouts", "every", "frames", "values"):
        if (word := getattr(arguments, name)) is not None:
            said[name] = word
    typed = assignments(arguments.settings, "key=a,b,c")
    settings = said.get("set", {}) | {key: text.split(",") for key, text in typed.items()}
    if "experiment" not in said:
        raise ParameterError("which experiment? Name one with --experiment, or in the plan")
    floors = None
    if said.get("floors"):
        chosen = {name: said[name] for name in ("every", "frames") if name in said}
        floors = Floors(said["floors"], tuple(said.get("layouts", ("hall",))), **chosen)
    return SweepPlan(
        experiment=said["experiment"],
        settings={k: v if isinstance(v, list) else [v] for k, v in settings.items()},
        pairs=[
            FlightPair(flight, said.get("test_flight"))
            for flight in arguments.flights or said.get("flights", [])
        ],
        floors=floors,
        values=said.get("values", ()),
    )


def _read(path: Path) -> dict[str, Any]:
    try:
        said = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: no readable plan ({error})") from None
    if unknown := sorted(said.keys() - _KEYS):
        raise ParameterError(f"{path}: {unknown[0]!r} is unknown: a plan has {', '.join(_KEYS)}")
    for name, value in said.items():
        if not _is(_KEYS[name], value):
            raise ParameterError(f"{path}: {name} is {value!r}: expected {_KEYS[name]}")
    return said


def _is(kind: str, value: object) -> bool:
    """Whether a value of a plan is what it should be; a bool is no number."""
    if kind == _TEXTS:
        return isinstance(value, list) and all(isinstance(each, str) for each in value)
    return type(value) is {_TEXT: str, _WHOLE: int}.get(kind, dict)
