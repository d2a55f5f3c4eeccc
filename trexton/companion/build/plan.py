"""Run experiments on flights. What was asked for is checked, and becomes steps of the engine."""

import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest, write_file
from trexton.companion.build import engine, execution
from trexton.companion.build.display import Display, Outcome
from trexton.companion.build.engine import Fact, Step, files_fact
from trexton.companion.build.flight_pairs import FlightPair, check_out
from trexton.companion.build.notebooks import (
    GIVEN,
    Notebook,
    find_notebooks,
    outputs_of,
    read_content,
)
from trexton.companion.build.workers import jobs_here, threads_of
from trexton.companion.experiments.declaration import Experiment
from trexton.companion.experiments.registry import EXPERIMENTS

_LONG_S = 30.0  # experiments that take longer start before others


def run_experiments(
    pairs: Sequence[FlightPair],
    out: str | os.PathLike[str],
    *,
    only: Sequence[str] | None = None,
    settings: Mapping[str, object] | None = None,
    jobs: int | None = None,
    notebooks: str | os.PathLike[str] | None = None,
    experiments: Mapping[str, Experiment] = EXPERIMENTS,
) -> list[Outcome]:
    """Run every experiment on every pair of flights, and reuse what is still true.

    Results stay until their successors are whole: a run that fails leaves the last good ones.

    Parameters
    ----------
    out : path
        Results: ``<out>/<flight>/<experiment>.json``, ``.ipynb`` and figures.
    only : names of experiments, optional
    settings : mapping, optional
        ``name`` or ``experiment.name`` to a value, or to its text as typed.
    jobs : int, optional
        Notebooks at once, by default as many as fit.
    notebooks : path, optional
        The folder of notebooks, this package's own by default.

    Raises
    ------
    ParameterError
        An experiment or a parameter is unknown, a value has the wrong type or is out of its range,
        results would lie in a flight; nothing has been touched then.
    """
    out = Path(out)
    chosen = _choose(notebooks, experiments, only)
    parameters = _settings_of(chosen, experiments, settings or {})
    check_out(out, pairs)
    everywhere = [n for n in chosen if experiments[n.name].every_flight]
    on_flights = [
        _Page(notebook, experiments[notebook.name], pair, parameters[notebook.name])
        for notebook in chosen
        if notebook not in everywhere
        for pair in pairs
    ]
    # What looks at every flight comes after all of them, also where one has failed.
    last = [_Page(notebook, experiments[notebook.name], None, {}) for notebook in everywhere]
    costs = {page.name: page.experiment.cost_s for page in on_flights + last}
    count = jobs_here(jobs, len(costs))
    with sole_writer(out):
        run = _Run(out, pairs, count)
        display = Display(costs, count)
        run.build(on_flights, display)
        run.build(last, display)
    return [run.outcomes[page.name] for page in on_flights + last]


@contextmanager
def sole_writer(out: Path) -> Iterator[None]:
    """Hold the folder of results; the system lets go of it even if this process is killed."""
    (out / ".engine").mkdir(parents=True, exist_ok=True)
    with open(out / ".engine" / "writer", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise TrextonError(
                f"another run is writing to {out}: wait for it, or choose another folder"
            ) from None
        yield


def _choose(
    notebooks: str | os.PathLike[str] | None,
    experiments: Mapping[str, Experiment],
    only: Sequence[str] | None,
) -> list[Notebook]:
    present = find_notebooks(notebooks, experiments)
    if unknown := [name for name in only or () if name not in present]:
        raise ParameterError(
            f"no experiment is named {unknown[0]!r}: the names are {', '.join(present)}"
        )
    return [notebook for name, notebook in present.items() if not only or name in only]


def _settings_of(
    notebooks: Sequence[Notebook],
    experiments: Mapping[str, Experiment],
    settings: Mapping[str, object],
) -> dict[str, dict[str, Any]]:
    """The parameters of each experiment; a setting that none of them declares is an error."""
    classes = {n.name: experiments[n.name].parameters for n in notebooks}
    declared = {name: {each.name for each in cls.declared()} for name, cls in classes.items()}
    mine: dict[str, dict[str, object]] = {name: {} for name in classes}
    for key, value in settings.items():
        experiment, _, name = key.rpartition(".")
        if name in GIVEN:
            raise ParameterError(
                f"parameter {name!r} is given by the workflow: use the options of trexton run"
            )
        takers = [n for n in classes if (n == experiment if experiment else name in declared[n])]
        if not takers:
            names = ", ".join(sorted(set().union(*declared.values()))) or "none"
            raise ParameterError(
                f"no experiment chosen here has a parameter {key!r}: there are {names}"
            )
        for taker in takers:
            mine[taker][name] = value
    return {name: cls.parse(mine[name], name).as_dict() for name, cls in classes.items()}


@dataclass(frozen=True)
class _Page:
    """One experiment on one pair of flights, or (`pair` None) over the records of all."""

    notebook: Notebook
    experiment: Experiment
    pair: FlightPair | None
    parameters: Mapping[str, Any]

    @property
    def flight(self) -> str:
        return self.pair.name if self.pair else ""

    @property
    def name(self) -> str:
        """The name of its step."""
        return f"{self.flight}/{self.notebook.name}".strip("/")


class _Run:
    """One run into one folder of results: pages as steps, and what became of them."""

    def __init__(self, out: Path, pairs: Sequence[FlightPair], jobs: int):
        self.out, self.pairs, self.jobs = out, pairs, jobs
        self.root = out / ".engine"
        self.outcomes: dict[str, Outcome] = {}
        for leftover in self.root.glob(".work.*"):  # of a run that was killed
            shutil.rmtree(leftover, ignore_errors=True)

    def build(self, pages: Sequence[_Page], display: Display) -> None:
        """Bring all pages up to date; fills `outcomes`."""
        ready = []
        for page in pages:
            obstacle = page.pair.obstacle(page.experiment) if page.pair else None
            if obstacle:
                skipped = Outcome(page.flight, page.notebook.name, "skipped", (obstacle,))
                self.outcomes[page.name] = skipped
                display.finished(skipped)
            else:
                ready.append(page)
        steps = [self._step(page, ready) for page in ready]
        if steps:
            self.outcomes |= engine.build(steps, self.root, self.jobs, execution.stop_all, display)

    def _step(self, page: _Page, planned: Sequence[_Page]) -> Step:
        folder, name = self.out / page.flight, page.notebook.name
        records = self._records(page, planned)
        data = page.pair.hashes if page.pair else {}
        whole = page.pair is None  # whatever looks at every flight shows timings too
        return Step(
            page.name,
            # A record that is gone changes a result too.
            page.notebook.inputs(page.parameters, data) | {_label(p): "read" for p in records},
            partial(self._perform, page, records),
            leaves=[
                files_fact(f"{page.name}: outputs", partial(outputs_of, folder, name)),
                _record_fact(folder / f"{name}.json"),
            ],
            reads=[_record_fact(path, timings=whole) for path in records],
            alone=page.experiment.alone,
            urgent=page.experiment.cost_s > _LONG_S
            or any(name in other.experiment.after for other in planned),
        )

    def _records(self, page: _Page, planned: Sequence[_Page]) -> list[Path]:
        """Records of other experiments that the page reads and that are, or will be, true."""
        if page.pair is None:
            flights = (self.out / pair.name for pair in self.pairs)
            records = sorted(path for folder in flights for path in folder.glob("*.json"))
        else:
            names, folder = {other.name for other in planned}, self.out / page.flight
            records = [
                path
                for name in page.experiment.after
                if (path := folder / f"{name}.json").is_file() or f"{page.flight}/{name}" in names
            ]
        stale = {name for name, one in self.outcomes.items() if not one.good}
        return [path for path in records if f"{path.parent.name}/{path.stem}" not in stale]

    def _perform(self, page: _Page, records: Sequence[Path]) -> None:
        """Run the notebook in a folder of its own; its results replace the last ones when they are
        whole.
        """
        folder, notebook = self.out / page.flight, page.notebook
        failed = folder / f"{notebook.name}.failed.ipynb"
        pair = page.pair
        flights = {"flight": pair.flight, "test_flight": pair.test_flight} if pair else {}
        given = {**flights, "out": str(self.out), **page.parameters}
        with tempfile.TemporaryDirectory(prefix=".work.", dir=self.root) as name:
            work = Path(name).resolve() / "out"
            (work / page.flight).mkdir(parents=True)
            for path in (path for each in records for path in outputs_of(each.parent, each.stem)):
                if path.suffix in (".json", ".png"):
                    place = work / path.relative_to(self.out)
                    place.parent.mkdir(exist_ok=True)
                    shutil.copyfile(path, place)
            threads = threads_of(1 if page.experiment.alone else self.jobs)
            text, error = execution.execute(notebook, given, work, threads)
            left = outputs_of(work / page.flight, notebook.name)
            files = {path.name: path.read_bytes() for path in left}
        if not error and f"{notebook.name}.json" not in files:
            error = f"{notebook.source}: it left no {notebook.name}.json in its folder of results"
        if error:
            if text:
                write_file(failed, text)
            raise TrextonError(error + (f"; partial output: {failed}" if text else ""))
        files[f"{notebook.name}.ipynb"] = (text or "").encode()
        old = {path.name for path in outputs_of(folder, notebook.name)}
        for file, content in files.items():
            write_file(folder / file, content)
        for file in (old - files.keys()) | {failed.name}:
            (folder / file).unlink(missing_ok=True)


def _label(record: Path) -> str:
    return f"record {record.parent.name}/{record.stem}"


def _record_fact(path: Path, timings: bool = False) -> Fact:
    """The record at `path`; its timings count only if `timings`."""
    label = _label(path)

    def read() -> dict[str, str] | None:
        content = read_content(path)
        if content is None:
            return None
        return {label: digest({k: v for k, v in content.items() if timings or k != "timings"})}

    return Fact(f"{label} with its timings" if timings else label, read)
