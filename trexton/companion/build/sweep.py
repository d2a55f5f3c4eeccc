"""A sweep: one experiment over floors, flights and settings, resumable, its results as one table.

Each flight over a floor and each cell, one setting on one flight, is a step of the engine: it is
run once, here or on a cluster, and reused while what goes into it is the same.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from trexton.base.cache import code_hashes
from trexton.base.errors import ParameterError
from trexton.base.files import atomic_file, canonical_json, digest
from trexton.base.options import Options
from trexton.base.progress import say
from trexton.base.records import Record
from trexton.companion.build import engine
from trexton.companion.build import prepare_flights as flown
from trexton.companion.build.display import Display
from trexton.companion.build.engine import Fact, Report, Step, files_fact
from trexton.companion.build.flight_pairs import FlightPair, check_names, check_out, load_pair
from trexton.companion.build.notebooks import inputs_of
from trexton.companion.build.plan import sole_writer
from trexton.companion.build.workers import Call, workers
from trexton.companion.experiments.declaration import Experiment, SeedParameters
from trexton.companion.experiments.printed import look_up
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.provenance import made_by
from trexton.simulator.layouts import LAYOUTS

__all__ = ["Floors", "SweepPlan", "Swept", "sweep"]

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Floors:
    """Floors to fly over: `count` of each layout, painted from the seeds 0, 1, ...

    `every` keeps every so-manieth frame of a survey (training) and of a flight by waypoints (test).
    """

    count: int
    layouts: tuple[str, ...] = ("hall",)
    every: int = 1
    frames: int | None = None

    def __post_init__(self) -> None:
        counts = (self.count, self.every, len(self.layouts), self.frames)
        if any(each is not None and each < 1 for each in counts):
            raise ParameterError(
                f"{self.count} floors of layouts {list(self.layouts)}, every {self.every}, "
                f"{self.frames} frames: expected 1 or more of each"
            )
        if unknown := [name for name in self.layouts if name not in LAYOUTS]:
            known = ", ".join(LAYOUTS)
            raise ParameterError(f"layout {unknown[0]!r} is unknown: choose one of {known}")


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
    floors : Floors, optional
        Flights to simulate, besides.
    values : sequence of str
        Paths into the record's values for the table; empty: all single numbers.
    """

    experiment: str
    settings: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    pairs: Sequence[FlightPair] = ()
    floors: Floors | None = None
    values: Sequence[str] = ()


@dataclass(frozen=True)
class Swept:
    """The finished tables, one row for a cell that succeeded, and why others did not.

    Columns of times, which no two sweeps share, are kept apart.
    """

    rows: Rows
    times: Rows
    failed: dict[str, str]
    counts: dict[str, int]


def sweep(
    plan: SweepPlan,
    out: Path,
    *,
    jobs: int | None = None,
    cluster: str | None = None,
    experiments: Mapping[str, Experiment] = EXPERIMENTS,
) -> Swept:
    """Run what is not there yet; write ``sweep.json``, ``sweep.csv`` and ``times.csv`` into `out`.

    Raises
    ------
    ParameterError
        The experiment or a parameter does not exist or fit; nothing has been touched then. Or no
        record has one of the values: cells are kept then, and the table is not touched.
    """
    if plan.experiment not in experiments or experiments[plan.experiment].every_flight:
        names = ", ".join(name for name, one in experiments.items() if not one.every_flight)
        raise ParameterError(f"no experiment {plan.experiment!r} to sweep: there are {names}")
    if not plan.pairs and plan.floors is None:
        raise ParameterError("a sweep needs flights or floors: name some, or give --floors N")
    experiment = experiments[plan.experiment]
    chosen = _possible(_grid(plan, experiment))
    check_names([pair.name for pair in plan.pairs] + [name for name, _ in _floors(plan.floors)])
    check_out(out, plan.pairs)
    for pair in plan.pairs:
        if obstacle := pair.obstacle(experiment):
            raise ParameterError(f"{plan.experiment} cannot run: {obstacle}")
    with workers(cluster, jobs) as crew, sole_writer(out), crew.calls() as call:
        flying, cells = _steps(plan, experiment, chosen, out, call)
        steps = flying + [cell.step for cell in cells]
        with Display(len(steps), "cells") as display:
            outcomes = engine.build(steps, out / ".engine", crew.jobs, crew.stop, display)
    failed = {name: one.reasons[0] for name, one in outcomes.items() if not one.good}
    results = {cell: _results(cell) for cell in cells if cell.step.name not in failed}
    _check_values(plan.values, list(results.values()))
    rows, times = ([_row(plan, *one, timed) for one in results.items()] for timed in (False, True))
    if rows:  # a table is not replaced by nothing
        _write(plan, made_by(experiment.module), out, rows, times)
    statuses = [outcomes[cell.step.name].status for cell in cells]
    counts = {status: statuses.count(status) for status in ("ran", "reused")}
    return Swept(rows, times, failed, counts | {"failed": len(cells) - len(results)})


def _grid(plan: SweepPlan, experiment: Experiment) -> list[Options]:
    """All combinations of the settings, as checked parameters."""
    declared = experiment.parameters
    if empty := [name for name, values in plan.settings.items() if not values]:
        raise ParameterError(f"{empty[0]} has no values to sweep: give some, or leave it out")
    return [
        declared.parse(dict(zip(plan.settings, values, strict=True)), plan.experiment)
        for values in itertools.product(*plan.settings.values())
    ]


def _possible(chosen: list[Options]) -> list[Options]:
    """Those that have no ``obstacle`` to being run; the others with a word.

    Raises
    ------
    ParameterError
        None is left.
    """
    reasons = [one.obstacle() if isinstance(one, SeedParameters) else None for one in chosen]
    for reason in filter(None, reasons):
        say(f"skipped: {reason}")
    left = [one for one, reason in zip(chosen, reasons, strict=True) if reason is None]
    if not left:
        raise ParameterError(f"nothing is left to sweep: {reasons[0]}")
    return left


@dataclass(frozen=True, eq=False)
class _Cell:
    flight: str
    parameters: Options
    path: Path
    step: Step


def _steps(
    plan: SweepPlan, experiment: Experiment, chosen: Sequence[Options], out: Path, call: Call
) -> tuple[list[Step], list[_Cell]]:
    """Flights to be flown, and cells."""
    flying: list[Step] = []
    flights = [(pair.name, pair, pair.hashes, list[Fact]()) for pair in plan.pairs]
    for name, options in _floors(plan.floors):
        paths = [out / "flights" / f"{name}-{pattern}" for pattern in flown.PATTERNS]
        both = [
            flown.flight_step(
                path, flown.simulation_inputs(pattern=pattern, **options),
                partial(call, flown.simulate, str(path.resolve()), pattern, *options.values()),
            )
            for path, pattern in zip(paths, flown.PATTERNS, strict=True)
        ]  # fmt: skip
        flying += both
        facts = [fact for step in both for fact in step.leaves]
        flights.append((name, FlightPair(*map(str, paths)), {}, facts))
    cells, module = [], experiment.module
    for name, pair, data, facts in flights:
        for parameters in chosen:
            key = f"{plan.experiment}-{digest(parameters.as_dict())[:12]}"
            path = out / "cells" / name / f"{key}.json"
            step = Step(
                f"{name}/{key}",
                inputs_of(parameters.as_dict(), code_hashes(module), data),
                partial(_measure_here, call, module, pair, parameters, path),
                [files_fact(f"{name}/{key}: outputs", partial(_present, path))],
                reads=facts,
                alone=experiment.alone,
            )
            cells.append(_Cell(name, parameters, path, step))
    return flying, cells


def _floors(floors: Floors | None) -> Iterator[tuple[str, dict[str, Any]]]:
    """Names, and the options of `simulate` in their order."""
    if floors is not None:
        given = {"every": floors.every, "frames": floors.frames}
        for layout, seed in itertools.product(floors.layouts, range(floors.count)):
            yield f"{layout}-{seed}", {"layout": layout, "seed": seed, **given}


def _present(path: Path) -> list[Path]:
    return [path] if path.is_file() else []


def _measure_here(
    call: Call, module: str, pair: FlightPair, parameters: Options, path: Path, report: Report
) -> None:
    paths = [p and str(Path(p).resolve()) for p in (pair.flight, pair.test_flight)]
    text = call(_measure, module, *paths, parameters.as_dict())
    with atomic_file(path) as stream:
        stream.write(text)


def _measure(module: str, flight: str, test_flight: str | None, parameters: dict[str, Any]) -> str:
    """Run one experiment; the record without series and pictures, as JSON text."""
    experiment = import_module(module)
    train, test = load_pair(flight, test_flight)
    result: Record = experiment.run(train, test, experiment.Parameters(**parameters))
    kept = ("experiment", "flight", "parameters", "values", "timings", "provenance")
    return canonical_json({name: getattr(result, name) for name in kept})


def _results(cell: _Cell) -> dict[str, Any]:
    """What a cell measured: its values, and its timings as an entry of them."""
    record = json.loads(cell.path.read_text(encoding="utf-8"))
    return {**record["values"], "timings": record["timings"]}


def _check_values(paths: Sequence[str], trees: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a path that leads nowhere in any record: its column would be empty, as if measured."""
    recorded = sorted({name for tree in trees for name, _ in _numbers("", tree)})
    for path in paths:
        if trees and all(look_up(tree, path) is None for tree in trees) and path not in recorded:
            near = get_close_matches(path, recorded, n=3, cutoff=0) or ["nothing"]
            raise ParameterError(
                f"no record has a value {path!r}: it has {', '.join(near)} and the like, "
                "every one without --values"
            )


def _row(plan: SweepPlan, cell: _Cell, results: Mapping[str, Any], timed: bool) -> dict[str, Any]:
    """What was flown, with its results, or with the times they took."""
    parameters = {name: cell.parameters.as_dict()[name] for name in plan.settings}
    values = {path: look_up(results, path) for path in plan.values} or dict(_numbers("", results))
    chosen = {path: each for path, each in values.items() if path.startswith("timings.") == timed}
    return {"flight": cell.flight, **parameters, **chosen}


def _numbers(prefix: str, tree: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Single values of nested dicts, by dotted path."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _numbers(f"{prefix}{key}.", value)
        elif value is None or isinstance(value, (bool, int, float, str)):
            yield f"{prefix}{key}", value


def _write(plan: SweepPlan, made: dict[str, Any], out: Path, rows: Rows, times: Rows) -> None:
    import pandas as pd

    content = {
        "experiment": plan.experiment,
        "settings": {name: list(values) for name, values in plan.settings.items()},
        "floors": plan.floors and asdict(plan.floors),
        "flights": {pair.name: pair.hashes for pair in plan.pairs},
        "rows": rows,
        **made,
    }
    with atomic_file(out / "sweep.json") as stream:
        stream.write(canonical_json(content))
    for name, table in (("sweep.csv", rows), ("times.csv", times)):
        with atomic_file(out / name) as stream:
            pd.DataFrame(table).to_csv(stream, index=False)
