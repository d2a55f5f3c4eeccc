"""A sweep: one experiment over flights and settings, resumable, its results as one table.

Each cell, one setting on one flight, is a step of the engine: it is run once, here or on a cluster,
and reused while what goes into it is the same.
"""

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from trexton.base.cache import code_hashes
from trexton.base.errors import ParameterError
from trexton.base.files import atomic_file, canonical_json, digest, read_toml, write_file
from trexton.base.options import Options, option
from trexton.base.records import Record
from trexton.companion.build import engine
from trexton.companion.build.display import Display
from trexton.companion.build.engine import Step, files_fact
from trexton.companion.build.flight_pairs import FlightPair, check_out, load_pair
from trexton.companion.build.notebooks import Notebook, inputs_of, own_code
from trexton.companion.build.plan import sole_writer
from trexton.companion.build.workers import Call, callers
from trexton.companion.experiments.declaration import Experiment
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.provenance import made_by

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class SweepPlan:
    """What is swept.

    Attributes
    ----------
    experiment : str
    settings : mapping of str to sequence
        The values of each parameter, or their texts; all combinations are run.
    pairs : sequence of FlightPair
        Recorded flights.
    """

    experiment: str
    settings: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    pairs: Sequence[FlightPair] = ()


@dataclass(frozen=True)
class Swept:
    """The finished table, one row for a cell that succeeded, and why others did not."""

    rows: Rows
    failed: dict[str, str]
    counts: dict[str, int]


@dataclass(frozen=True)
class _Words(Options):
    """The words of a plan."""

    experiment: str = option("", "what is run in every cell")
    test_flight: str | None = option(None, "test on this flight instead of the split")


def read_plan(path: Path) -> SweepPlan:
    """The plan in a TOML file: ``experiment``, ``flights``, ``test_flight`` and the table ``set``.

    Raises `TrextonError` where it cannot be read, or something in it has another type.
    """
    said = read_toml(path)
    settings, flights = said.pop("set", {}), said.pop("flights", [])
    if not (isinstance(flights, list) and all(isinstance(one, str) for one in flights)):
        raise ParameterError(f"{path}: flights is {flights!r}: expected a list of texts")
    if not isinstance(settings, dict):
        raise ParameterError(f"{path}: set is {settings!r}: expected a table")
    words = _Words.parse(said, "a plan")
    return SweepPlan(
        words.experiment,
        {name: each if isinstance(each, list) else [each] for name, each in settings.items()},
        [FlightPair(flight, words.test_flight) for flight in flights],
    )


def sweep(
    plan: SweepPlan, out: Path, *, jobs: int | None = None, cluster: str | None = None
) -> Swept:
    """Run what is not there yet; write ``sweep.json`` and ``sweep.csv`` into `out`.

    Times, which no two sweeps share, stand in the records of the cells, ``out/cells``.

    Raises
    ------
    ParameterError
        The experiment or a parameter does not exist or fit; nothing has been touched then.
    """
    if plan.experiment not in EXPERIMENTS or EXPERIMENTS[plan.experiment].every_flight:
        names = ", ".join(name for name, one in EXPERIMENTS.items() if not one.every_flight)
        raise ParameterError(f"no experiment {plan.experiment!r} to sweep: there are {names}")
    if not plan.pairs:
        raise ParameterError("a sweep needs flights: name some in the plan")
    experiment = EXPERIMENTS[plan.experiment]
    chosen = _grid(plan, experiment)
    check_out(out, plan.pairs)
    for pair in plan.pairs:
        if obstacle := pair.obstacle(experiment):
            raise ParameterError(f"{plan.experiment} cannot run: {obstacle}")
    with callers(cluster, jobs) as (count, call, stop), sole_writer(out):
        cells = _cells(plan, experiment, chosen, out, call)
        steps = [cell.step for cell in cells]
        outcomes = engine.build(steps, out / ".engine", count, stop, Display())
    failed = {name: one.reasons[0] for name, one in outcomes.items() if not one.good}
    rows = [_row(plan, cell) for cell in cells if cell.step.name not in failed]
    if rows:  # a table is not replaced by nothing
        _write(plan, made_by(experiment.module) | {"failed": failed}, out, rows)
    statuses = [outcomes[cell.step.name].status for cell in cells]
    counts = {status: statuses.count(status) for status in ("ran", "reused")}
    return Swept(rows, failed, counts | {"failed": len(cells) - len(rows)})


def _grid(plan: SweepPlan, experiment: Experiment) -> list[Options]:
    """All combinations of the settings, as checked parameters."""
    declared = experiment.parameters
    if empty := [name for name, values in plan.settings.items() if not values]:
        raise ParameterError(f"{empty[0]} has no values to sweep: give some, or leave it out")
    return [
        declared.parse(dict(zip(plan.settings, values, strict=True)), plan.experiment)
        for values in itertools.product(*plan.settings.values())
    ]


class _Cell(NamedTuple):
    flight: str
    parameters: Options
    path: Path
    step: Step


def _cells(
    plan: SweepPlan, experiment: Experiment, chosen: Sequence[Options], out: Path, call: Call
) -> list[_Cell]:
    cells, module = [], experiment.module
    own = Notebook(module, "", "", own_code(plan.experiment, EXPERIMENTS)).code
    for pair, parameters in itertools.product(plan.pairs, chosen):
        name = f"{pair.name}/{plan.experiment}-{digest(parameters.as_dict())[:12]}"
        path = out / "cells" / f"{name}.json"
        step = Step(
            name,
            inputs_of(parameters.as_dict(), code_hashes(module) | own, pair.hashes),
            partial(_measure_here, call, module, pair, parameters, path),
            [files_fact(f"{name}: outputs", partial(path.parent.glob, path.name))],
            alone=experiment.alone,
        )
        cells.append(_Cell(pair.name, parameters, path, step))
    return cells


def _measure_here(call: Call, module: str, pair: FlightPair, chosen: Options, path: Path) -> None:
    paths = [p and str(Path(p).resolve()) for p in (pair.flight, pair.test_flight)]
    text = call(_measure, module, *paths, chosen.as_dict())
    write_file(path, text)


def _measure(module: str, flight: str, test_flight: str | None, parameters: dict[str, Any]) -> str:
    """Run one experiment; the record without series and pictures, as JSON text."""
    experiment = import_module(module)
    train, test = load_pair(flight, test_flight)
    result: Record = experiment.run(train, test, experiment.Parameters(**parameters))
    kept = ("experiment", "flight", "parameters", "values", "timings", "provenance")
    return canonical_json({name: getattr(result, name) for name in kept})


def _row(plan: SweepPlan, cell: _Cell) -> dict[str, Any]:
    """What was flown, with all single numbers and words of its results; a setting's name is its
    own.
    """
    parameters = {name: cell.parameters.as_dict()[name] for name in plan.settings}
    values = json.loads(cell.path.read_text(encoding="utf-8"))["values"]
    return {"flight": cell.flight, **parameters, **dict(_numbers("", values)), **parameters}


def _numbers(prefix: str, tree: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Single values of nested dicts, by dotted path."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _numbers(f"{prefix}{key}.", value)
        elif value is None or isinstance(value, (bool, int, float, str)):
            yield f"{prefix}{key}", value


def _write(plan: SweepPlan, made: dict[str, Any], out: Path, rows: Rows) -> None:
    import pandas as pd

    content = {
        "experiment": plan.experiment,
        "settings": {name: list(values) for name, values in plan.settings.items()},
        "flights": {pair.name: pair.hashes for pair in plan.pairs},
        "rows": rows,
        **made,
    }
    write_file(out / "sweep.json", canonical_json(content))
    with atomic_file(out / "sweep.csv") as stream:
        pd.DataFrame(rows).to_csv(stream, index=False)
