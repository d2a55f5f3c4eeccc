"""Run the experiment notebooks of one or more flights: in parallel, and only where something changed."""

from __future__ import annotations

import fcntl
import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from trexton.cache import repository_root
from trexton.errors import ParameterError, TrextonError
from trexton.experiments import EXPERIMENTS, Experiment
from trexton.runner.display import Display
from trexton.runner.notebooks import GIVEN, Notebook
from trexton.runner.pairs import FlightPair
from trexton.runner.processes import Crew
from trexton.runner.stamps import Stamp, gather_inputs

__all__ = ["Outcome", "default_jobs", "run_experiments"]

_MEMORY_PER_JOB = 2 * 2**30


@dataclass(frozen=True)
class Outcome:
    """What became of an experiment on a flight: ``ran``, ``reused``, ``skipped`` or ``failed``, and why."""

    flight: str
    experiment: str
    status: str
    reasons: tuple[str, ...] = ()
    seconds: float = 0.0

    def __str__(self) -> str:
        where = f"{self.flight}/{self.experiment}" if self.flight else self.experiment
        took = f" ({self.seconds:.1f} s)" if self.status in ("ran", "failed") else ""
        return f"{self.status:<8}{where}{took}"


@dataclass
class _Task:
    notebook: Notebook
    experiment: Experiment
    pair: FlightPair | None  # None: over every flight
    parameters: dict
    stamp: Stamp
    waits_for: set[tuple[str, str]] = field(default_factory=set)
    inputs: dict = field(default_factory=dict)
    reasons: tuple[str, ...] = ()

    @property
    def key(self) -> tuple[str, str]:
        return (self.pair.name if self.pair else "", self.notebook.name)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_jobs() -> int:
    """As many notebooks at once as there are processors and memory for."""
    return max(1, min(_cores(), _available_memory() // _MEMORY_PER_JOB))


def _available_memory() -> int:
    """Bytes that programs can still take, what the system only caches included."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(
            int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable")
        )
    except (OSError, StopIteration):
        return _cores() * _MEMORY_PER_JOB  # not Linux: go by the processors


def run_experiments(
    pairs: Sequence[FlightPair],
    out: str | os.PathLike,
    *,
    only: Sequence[str] | None = None,
    settings: Mapping[str, object] | None = None,
    jobs: int | None = None,
    notebooks: str | os.PathLike | None = None,
    experiments: Mapping[str, Experiment] = EXPERIMENTS,
) -> list[Outcome]:
    """Run every experiment that has a notebook on every pair of flights, and reuse what is still true.

    Parameters
    ----------
    out : path
        Results: ``<out>/<flight>/<experiment>.json``, ``.ipynb`` and figures.
    only : names of experiments, optional
    settings : mapping, optional
        ``name`` or ``experiment.name`` to a value, or to its text as typed.
    jobs : int, optional
        Notebooks at once; see `default_jobs`.
    notebooks : path, optional
        The folder of notebooks, the repository's by default.

    Raises
    ------
    ParameterError
        An experiment or a parameter is unknown, or a value has the wrong type.
    """
    out, folder = Path(out), _notebook_folder(notebooks)
    chosen = _choose(folder, experiments, only)
    tasks = _plan(
        pairs, out, chosen, experiments, _settings_of(chosen, experiments, settings or {})
    )
    jobs = max(1, jobs or default_jobs())
    display = Display(len(tasks))
    with _sole_writer(out), Crew(jobs) as crew, ThreadPoolExecutor(jobs) as pool, display:
        try:
            return _Run(tasks, out, crew, pool, display, jobs).outcomes()
        except BaseException:
            crew.stop()
            raise


@contextmanager
def _sole_writer(out: Path) -> Iterator[None]:
    """Hold the folder of results; the system lets go of it even if this process is killed."""
    (out / ".stamps").mkdir(parents=True, exist_ok=True)
    with open(out / ".stamps" / "lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise TrextonError(
                f"another run is writing to {out}: wait for it, or choose another folder"
            ) from None
        yield


def _notebook_folder(notebooks: str | os.PathLike | None) -> Path:
    root = repository_root()
    if notebooks is None and root is None:
        raise TrextonError(
            "the notebooks belong to the repository and this is an installed package: run it from a clone"
        )
    return Path(notebooks) if notebooks is not None else root / "notebooks"


def _choose(
    folder: Path, experiments: Mapping[str, Experiment], only: Sequence[str] | None
) -> list[Notebook]:
    present = {
        name: Notebook(folder / f"{name}.md")
        for name in experiments
        if (folder / f"{name}.md").is_file()
    }
    if unknown := [name for name in only or () if name not in present]:
        raise ParameterError(
            f"no experiment is named {unknown[0]!r}: the names are {', '.join(present)}"
        )
    return [notebook for name, notebook in present.items() if not only or name in only]


def _settings_of(
    notebooks: list[Notebook],
    experiments: Mapping[str, Experiment],
    settings: Mapping[str, object],
) -> dict[str, dict]:
    """The parameters of each experiment; a setting that none of them declares is an error."""
    classes = {n.name: experiments[n.name].parameters(n.name) for n in notebooks}
    known = {name: {each.name for each in cls.declared()} for name, cls in classes.items()}
    mine: dict[str, dict] = {name: {} for name in classes}
    for key, value in settings.items():
        experiment, _, name = key.rpartition(".")
        if name in GIVEN:
            raise ParameterError(
                f"parameter {name!r} is given by the runner: use the options of trexton run"
            )
        takers = [n for n in classes if (n == experiment if experiment else name in known[n])]
        if not takers:
            names = ", ".join(sorted(set().union(*known.values()))) or "none"
            raise ParameterError(
                f"no experiment chosen here has a parameter {key!r}: there are {names}"
            )
        for taker in takers:
            mine[taker][name] = value
    return {name: cls.parse(mine[name], name).as_dict() for name, cls in classes.items()}


def _plan(pairs, out: Path, notebooks: list[Notebook], experiments, parameters) -> list[_Task]:
    if len({pair.name for pair in pairs}) < len(pairs):
        raise ParameterError(
            f"two flights are named {pairs[0].name!r}: give each its own name in flight.toml"
        )
    tasks = []
    for notebook in notebooks:
        experiment = experiments[notebook.name]
        for pair in [None] if experiment.every_flight else pairs:
            folder = out if pair is None else out / pair.name
            tasks.append(
                _Task(
                    notebook,
                    experiment,
                    pair,
                    parameters[notebook.name],
                    Stamp(out, folder, notebook.name),
                )
            )
    keys = {task.key for task in tasks}
    for task in tasks:
        if task.pair is None:
            task.waits_for = {key for key in keys if key[0]}
        else:
            task.waits_for = {(task.pair.name, name) for name in task.experiment.after} & keys
    return tasks


class _Run:
    """One pass over all tasks: start what is ready, what most waits for first, until nothing is left."""

    def __init__(
        self,
        tasks: list[_Task],
        out: Path,
        crew: Crew,
        pool: ThreadPoolExecutor,
        display: Display,
        jobs: int,
    ):
        self.waiting = sorted(tasks, key=lambda task: (task.experiment.alone, -_chain(task, tasks)))
        self.out, self.crew, self.pool, self.display, self.jobs = out, crew, pool, display, jobs
        self.done: dict[tuple[str, str], Outcome] = {}
        self.running: dict[Future, _Task] = {}
        self.order = [task.key for task in tasks]
        self.names = {task.pair.name for task in tasks if task.pair}

    def outcomes(self) -> list[Outcome]:
        while self.waiting or self.running:
            while task := self._next():
                self.waiting.remove(task)
                if outcome := self._settled(task):
                    self._finish(task, outcome)
                else:
                    self.running[self.pool.submit(self._execute, task)] = task
            for future in (
                wait(self.running, return_when=FIRST_COMPLETED).done if self.running else ()
            ):
                self._finish(self.running.pop(future), future.result())
        return [self.done[key] for key in self.order]

    def _next(self) -> _Task | None:
        """The first task whose turn it is: whatever measures time has the machine to itself."""
        if len(self.running) >= self.jobs or any(
            task.experiment.alone for task in self.running.values()
        ):
            return None
        ready = [task for task in self.waiting if task.waits_for <= self.done.keys()]
        return next((task for task in ready if not (task.experiment.alone and self.running)), None)

    def _settled(self, task: _Task) -> Outcome | None:
        """The outcome of a task that need not run."""
        flight, name = task.key
        if task.pair and (obstacle := task.pair.obstacle(task.experiment)):
            task.stamp.clear()
            return Outcome(flight, name, "skipped", (obstacle,))
        broken = [self.done[key] for key in task.waits_for if self.done[key].status == "failed"]
        if task.pair and broken:
            task.stamp.clear()
            return Outcome(
                flight, name, "skipped", (f"{broken[0].experiment}, which it builds on, failed",)
            )
        data = task.pair.hashes if task.pair else {}
        task.inputs = gather_inputs(
            task.notebook, task.parameters, data, self._records_for(task), timings=task.pair is None
        )
        reasons = task.stamp.reasons(task.inputs)
        if not reasons:
            return Outcome(
                flight, name, "reused", (f"nothing changed in {_described(task.inputs)}",)
            )
        task.reasons = tuple(reasons)
        return None

    def _records_for(self, task: _Task) -> list[Path]:
        """Records that the task reads and that are there."""
        if task.pair is None:
            return sorted(path for name in self.names for path in (self.out / name).glob("*.json"))
        folder = self.out / task.pair.name
        return [
            path for name in task.experiment.after if (path := folder / f"{name}.json").is_file()
        ]

    def _execute(self, task: _Task) -> Outcome:
        task.stamp.clear()
        threads = None if task.experiment.alone else max(1, _cores() // self.jobs)
        given = task.pair.parameters(self.out) if task.pair else {"out": str(self.out)}
        job = {
            "notebook": str(task.notebook.path),
            "output": str(task.stamp.folder / f"{task.notebook.name}.ipynb"),
            "failed": str(task.stamp.failed_notebook),
            "parameters": given | task.parameters,
        }
        slot = threading.get_ident()
        label = "/".join(filter(None, task.key))
        result = self.crew.run(
            job, threads, lambda done, total: self.display.moved(slot, f"{label} {done}/{total}")
        )
        self.display.moved(slot, None)
        if result["error"]:
            kept = f"; partial output: {job['failed']}" if Path(job["failed"]).exists() else ""
            return Outcome(*task.key, "failed", (result["error"] + kept,), result["seconds"])
        task.stamp.write(task.inputs, result["seconds"])
        return Outcome(*task.key, "ran", task.reasons, result["seconds"])

    def _finish(self, task: _Task, outcome: Outcome) -> None:
        self.done[task.key] = outcome
        self.display.finished(outcome)


def _chain(task: _Task, tasks: list[_Task]) -> float:
    """Seconds from the start of `task` to the end of whatever waits for it, on the same flight."""
    heirs = [_chain(other, tasks) for other in tasks if other.pair and task.key in other.waits_for]
    return task.experiment.cost_s + max(heirs, default=0.0)


def _described(inputs: dict) -> str:
    parts = [
        f"{len(inputs['code'])} modules",
        f"{len(inputs['parameters'])} parameters",
        "the data",
        "the versions",
    ]
    return ", ".join(parts + ([f"{len(inputs['records'])} records"] if inputs["records"] else []))
