"""A sweep: one experiment over floors, flights and settings, resumable, its results as one table.

Each cell, one setting on one flight, is a task of the engine: it is run once, on this machine or on
a cluster, and reused while flight, parameters, code and versions are the same.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from difflib import get_close_matches
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytask

from trexton.base.cache import code_hashes
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import atomic_file, canonical_json, digest
from trexton.base.options import Options
from trexton.base.progress import say
from trexton.base.records import software_versions
from trexton.companion.build import engine
from trexton.companion.build.cells import measure, record
from trexton.companion.build.flight_pairs import FlightPair, check_names, check_out
from trexton.companion.build.nodes import HashedNode, fixed
from trexton.companion.build.plan import sole_writer
from trexton.companion.build.workers import Workers, workers
from trexton.companion.executor import end_with_parent, limited
from trexton.companion.experiments.declaration import Experiment, SeedParameters
from trexton.companion.experiments.printed import look_up
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights import read_flight
from trexton.simulator.layouts import LAYOUTS

__all__ = ["Floors", "SweepPlan", "Swept", "sweep"]

Call = Callable[..., Any]


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
        if self.count < 1 or self.every < 1 or not self.layouts:
            raise ParameterError(
                f"{self.count} floors of layouts {list(self.layouts)}, every {self.every}: "
                "expected 1 or more of each"
            )
        if self.frames is not None and self.frames < 1:
            raise ParameterError(f"{self.frames} frames: expected 1 or more")
        if unknown := [name for name in self.layouts if name not in LAYOUTS]:
            raise ParameterError(
                f"layout {unknown[0]!r} is unknown: choose one of {', '.join(LAYOUTS)}"
            )


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
    """The finished table: rows of the cells that succeeded, and why others did not."""

    rows: list[dict[str, Any]]
    failed: dict[str, str]
    counts: dict[str, int]


@dataclass(frozen=True)
class _Cell:
    name: str
    flight: str
    parameters: Options
    path: Path


def sweep(
    plan: SweepPlan,
    out: Path,
    *,
    jobs: int | None = None,
    cluster: str | None = None,
    experiments: Mapping[str, Experiment] = EXPERIMENTS,
) -> Swept:
    """Run what is not there yet; write ``sweep.json`` and ``sweep.csv`` into `out`.

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
    floors = [f"{layout}-{seed}" for layout, seed in _floors(plan.floors)]
    check_names([pair.name for pair in plan.pairs] + floors)
    check_out(out, plan.pairs)
    for pair in plan.pairs:
        if obstacle := pair.obstacle(experiment):
            raise ParameterError(f"{plan.experiment} cannot run: {obstacle}")
    with workers(cluster, jobs) as crew, sole_writer(out), _calls(crew, cluster) as call:
        tasks, cells = _tasks(plan, experiment, chosen, out, call)
        reports = engine.build(tasks, out / ".engine", crew.jobs, crew.stop)
    failed = {
        name: str(report.exc_info[1]) if report.exc_info else report.outcome.name
        for name, report in reports.items()
        if report.outcome not in (pytask.TaskOutcome.SUCCESS, pytask.TaskOutcome.SKIP_UNCHANGED)
    }
    results = {cell: _results(cell) for cell in cells if cell.name not in failed}
    _check_values(plan.values, list(results.values()))
    rows = [_row(plan, cell, each) for cell, each in results.items()]
    if rows:  # a table is not replaced by nothing
        _write(plan, out, rows)
    outcomes = [reports[cell.name].outcome for cell in cells]
    counts = {
        "ran": outcomes.count(pytask.TaskOutcome.SUCCESS),
        "reused": outcomes.count(pytask.TaskOutcome.SKIP_UNCHANGED),
        "failed": sum(cell.name in failed for cell in cells),
    }
    return Swept(rows, failed, counts)


def _grid(plan: SweepPlan, experiment: Experiment) -> list[Options]:
    """All combinations of the settings, as checked parameters."""
    declared = experiment.parameters
    names = list(plan.settings)
    if empty := [name for name, values in plan.settings.items() if not values]:
        raise ParameterError(f"{empty[0]} has no values to sweep: give some, or leave it out")
    return [
        declared.parse(dict(zip(names, values, strict=True)), plan.experiment)
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


@contextmanager
def _calls(crew: Workers, cluster: str | None) -> Iterator[Call]:
    """Calls a function of plain arguments: in a process of this machine, or on the cluster."""
    if cluster is not None:
        yield crew.call
        return
    with limited(crew.threads(alone=False)):
        pool = ProcessPoolExecutor(crew.jobs, get_context("spawn"), initializer=end_with_parent)
        try:
            yield lambda function, *words: pool.submit(function, *words).result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _tasks(
    plan: SweepPlan, experiment: Experiment, chosen: Sequence[Options], out: Path, call: Call
) -> tuple[list[Any], list[_Cell]]:
    tasks, cells, sources = [], [], []
    for pair in plan.pairs:
        sources.append((pair.name, pair, fixed("data", pair.name, pair.hashes)))
    for layout, seed in _floors(plan.floors):
        name = f"{layout}-{seed}"
        pair = FlightPair(*(str(out / "flights" / f"{name}-{kind}") for kind in _PATTERNS))
        flown = HashedNode(f"flight {name}", "", partial(_flown, pair))
        sources.append((name, pair, flown))
        tasks.append(_flying(plan.floors, layout, seed, pair, flown, call))
    module = experiment.module
    for name, pair, data in sources:
        for parameters in chosen:
            key = digest(parameters.as_dict())[:12]
            path = out / "cells" / name / f"{plan.experiment}-{key}.json"
            cell = _Cell(f"{name}/{plan.experiment}-{key}", name, parameters, path)
            reads = [
                data,
                fixed("parameters", cell.name, parameters.as_dict()),
                fixed("code", cell.name, code_hashes(module)),
                fixed("versions", cell.name, software_versions()),
            ]
            leaves = [HashedNode("outputs", cell.name, partial(_file, path))]
            perform = partial(_measured, call, module, pair, cell)
            turn = "try_last" if experiment.alone else None
            tasks.append(engine.task(cell.name, perform, reads, leaves, turn))
            cells.append(cell)
    return tasks, cells


_PATTERNS = ("survey", "waypoints")


def _floors(floors: Floors | None) -> Iterator[tuple[str, int]]:
    if floors is not None:
        yield from itertools.product(floors.layouts, range(floors.count))


def _flying(
    floors: Floors | None, layout: str, seed: int, pair: FlightPair, flown: HashedNode, call: Call
) -> Any:
    assert floors is not None
    name = f"flights/{layout}-{seed}"
    options = {"layout": layout, "seed": seed, "every": floors.every, "frames": floors.frames}
    reads = [
        fixed("parameters", name, options),
        fixed("code", name, code_hashes("trexton.simulator")),
    ]
    perform = partial(_fly, call, pair, layout, seed, floors.every, floors.frames)
    return engine.task(name, perform, reads, [flown], "try_first")


def _fly(
    call: Call, pair: FlightPair, layout: str, seed: int, every: int, frames: int | None
) -> None:
    for pattern, path in zip(_PATTERNS, (pair.flight, str(pair.test_flight)), strict=True):
        say(f"flying {path}")
        call(record, str(Path(path).resolve()), pattern, layout, seed, every, frames)


def _flown(pair: FlightPair) -> dict[str, str] | None:
    try:
        return {path: read_flight(path).data_hash for path in (pair.flight, str(pair.test_flight))}
    except TrextonError:
        return None


def _file(path: Path) -> dict[str, str] | None:
    return {path.name: digest(path)} if path.is_file() else None


def _measured(call: Call, module: str, pair: FlightPair, cell: _Cell) -> None:
    paths = [None if p is None else str(Path(p).resolve()) for p in (pair.flight, pair.test_flight)]
    text = call(measure, module, *paths, cell.parameters.as_dict())
    with atomic_file(cell.path) as stream:
        stream.write(text)
    say(f"ran     {cell.name}")


def _results(cell: _Cell) -> dict[str, Any]:
    """What a cell measured: its values, and its timings as an entry of them."""
    record = json.loads(cell.path.read_text(encoding="utf-8"))
    return {**record["values"], "timings": record["timings"]}


def _check_values(paths: Sequence[str], trees: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a path that leads nowhere in any record: its column would be empty, as if measured."""
    if not trees:
        return
    recorded = sorted({name for tree in trees for name, _ in _numbers("", tree)})
    for path in paths:
        if all(look_up(tree, path) is None for tree in trees) and path not in recorded:
            near = get_close_matches(path, recorded, n=3, cutoff=0) or ["nothing"]
            raise ParameterError(
                f"no record has a value {path!r}: it has {', '.join(near)} and the like, "
                "every one without --values"
            )


def _row(plan: SweepPlan, cell: _Cell, results: Mapping[str, Any]) -> dict[str, Any]:
    parameters = {name: cell.parameters.as_dict()[name] for name in plan.settings}
    if plan.values:
        values = {path: look_up(results, path) for path in plan.values}
    else:
        values = dict(_numbers("", results))
    return {"flight": cell.flight, **parameters, **values}


def _numbers(prefix: str, tree: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Single values of nested dicts, by dotted path."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _numbers(f"{prefix}{key}.", value)
        elif value is None or isinstance(value, (bool, int, float, str)):
            yield f"{prefix}{key}", value


def _write(plan: SweepPlan, out: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    import pandas as pd

    content = {
        "experiment": plan.experiment,
        "settings": {name: list(values) for name, values in plan.settings.items()},
        "floors": plan.floors and asdict(plan.floors),
        "flights": {pair.name: pair.hashes for pair in plan.pairs},
        "versions": software_versions(),
        "rows": list(rows),
    }
    with atomic_file(out / "sweep.json") as stream:
        stream.write(canonical_json(content))
    with atomic_file(out / "sweep.csv") as stream:
        pd.DataFrame(rows).to_csv(stream, index=False)
