"""One scheduler for all that is made: flights, executed notebooks, cells of a sweep.

A `Step` says what goes into it, what it leaves and how it is made; `build` hands steps to pytask,
which decides by content what must run, in which order, and remembers. It says why each was run.
"""

from __future__ import annotations

import hashlib
import json
import threading
import time
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytask
from pytask_parallel import ParallelBackend, WorkerType, execute, registry

from trexton.base.errors import TrextonError
from trexton.base.files import digest
from trexton.companion.build.display import Display, Outcome

# Counts up whenever results of an older version of this package must not be taken over.
_VERSION = "2"
_POLL_S = 0.05  # pytask would look for what has ended every second only, and then wait again
_SHOWN = 12  # characters of a value or a hash in a reason
Entries = dict[str, str]


@dataclass
class Fact:
    """A node of the engine: named entries whose values are compared, among them hashes of files.

    Attributes
    ----------
    name : str
        Unique in a run: one step leaves what another of the same name reads.
    read : callable
        The entries now; None where there is nothing yet.
    """

    name: str
    read: Callable[[], Entries | None]
    attributes: dict[Any, Any] = field(default_factory=dict)

    @property
    def signature(self) -> str:
        return hashlib.sha256(self.name.encode()).hexdigest()

    def state(self) -> str | None:
        """The entries as one text, which the engine keeps and compares."""
        entries = self.read()
        return None if entries is None else json.dumps(entries, sort_keys=True)

    def load(self, is_product: bool = False) -> None:
        """Nothing is handed to the task: it reads the files itself."""

    def save(self, value: object) -> None:
        """Nothing is kept: the task writes the files itself."""


def files_fact(name: str, files: Callable[[], Iterable[Path]]) -> Fact:
    """The files that a step left, by content; nothing yet where there are none."""
    return Fact(name, lambda: {path.name: digest(path) for path in files()} or None)


def labelled(label: str, entries: Mapping[str, object]) -> Entries:
    """Inputs of a `Step`, as ``{"parameter seed": "1"}``; what is no text is compared by `repr`."""
    return {f"{label} {k}": v if isinstance(v, str) else repr(v) for k, v in entries.items()}


@dataclass
class Step:
    """Something to make."""

    name: str  # ``flight/experiment``, or another with or without a folder
    inputs: Entries  # what is fixed beforehand; the keys are words, in which changes are said
    work: Callable[[], object]
    leaves: Sequence[Fact]  # what it leaves, first its own files
    reads: Sequence[Fact] = ()  # what of other steps it reads
    alone: bool = False  # it measures time: nothing runs beside it
    urgent: bool = False  # it starts before others: it takes long, or others wait for it

    @property
    def facts(self) -> list[Fact]:
        """All that goes in."""
        return [Fact(f"{self.name}: inputs", lambda: self.inputs), *self.reads]

    def task(self, perform: Callable[[Step], None]) -> pytask.TaskWithoutPath:
        """As pytask has it."""
        turn = "try_last" if self.alone else "try_first" if self.urgent else ""
        return _Task(
            name=self.name,
            function=lambda **_: perform(self),
            depends_on={"reads": self.facts},
            produces={"leaves": list(self.leaves)},
            markers=[pytask.Mark(turn, (), {})] if turn else [],
        )


class _Task(pytask.TaskWithoutPath):
    """A task whose code is among its nodes."""

    def state(self) -> str:
        return _VERSION


def build(
    steps: Sequence[Step], root: Path, jobs: int, stop: Callable[[], None], display: Display
) -> dict[str, Outcome]:
    """Run what must be run, so many steps at once; returns what became of each, by name.

    The folder `root` holds the engine's memory, ``pytask.lock``. Where the run is interrupted
    `stop` ends what is running, what was finished is remembered, and `KeyboardInterrupt` is raised;
    `TrextonError` where the engine could not start.
    """
    root.mkdir(parents=True, exist_ok=True)
    before, outcomes, stopping = _remembered(root), dict[str, Outcome](), threading.Event()
    room, entrance = threading.Semaphore(jobs), threading.Lock()

    def settle(step: Step, status: str, reasons: Sequence[str], seconds: float = 0.0) -> None:
        flight, _, name = step.name.rpartition("/")
        outcomes[step.name] = Outcome(flight, name, status, tuple(reasons), seconds)
        display.finished(outcomes[step.name])

    def perform(step: Step) -> None:
        why = _reasons(step, before.get(step.name))
        with _entered(room, entrance, jobs if step.alone else 1):
            started = time.monotonic()
            try:
                step.work()
            except Exception as error:
                if not stopping.is_set():
                    sentence = _sentence(step.name, error)
                    settle(step, "failed", [sentence], time.monotonic() - started)
                raise
            settle(step, "ran", why, time.monotonic() - started)

    def halt() -> None:
        stopping.set()
        stop()

    by_name = {step.name: step for step in steps}
    for report in _session([step.task(perform) for step in steps], root, jobs, halt):
        step = by_name[report.task.name]
        if report.outcome == pytask.TaskOutcome.SKIP_UNCHANGED:
            settle(step, "reused", [f"nothing changed in its {len(step.inputs)} inputs"])
        elif report.outcome == pytask.TaskOutcome.SKIP_PREVIOUS_FAILED:
            broken = _broken(step, by_name, outcomes)
            settle(step, "skipped", [f"{Path(broken).name}, which it builds on, failed"])
        elif step.name not in outcomes:
            settle(step, "failed", [_sentence(step.name, report.exc_info[1])])
    if outcomes.keys() < by_name.keys():
        raise KeyboardInterrupt
    return outcomes


def _broken(step: Step, by_name: dict[str, Step], outcomes: dict[str, Outcome]) -> str:
    """The first step that failed, or was skipped, and leaves what `step` reads."""
    read = {fact.name for fact in step.reads}
    broken = (by_name[name] for name, one in outcomes.items() if not one.good)
    return next(each.name for each in broken if read & {fact.name for fact in each.leaves})


@contextmanager
def _entered(room: threading.Semaphore, entrance: threading.Lock, places: int) -> Iterator[None]:
    """Hold so many places within the block; who waits for all of them lets nobody in before."""
    with entrance:
        for _ in range(places):
            room.acquire()
    try:
        yield
    finally:
        room.release(places)


def _session(
    tasks: Sequence[pytask.TaskWithoutPath], root: Path, jobs: int, stop: Callable[[], None]
) -> list[Any]:
    """pytask's reports, in the order in which it came to them."""
    config = root / "pyproject.toml"
    config.write_text("[tool.pytask.ini_options]\n", encoding="utf-8")

    class Threads(ThreadPoolExecutor):
        """Threads that wait for kernels; left early (Ctrl-C), the kernels end first."""

        def __exit__(self, *_: object) -> None:
            stop()
            self.shutdown(wait=True, cancel_futures=True)

    registry.register_parallel_backend(
        ParallelBackend.CUSTOM,
        lambda n_workers: Threads(n_workers),
        worker_type=WorkerType.THREADS,
        remote=False,
    )
    scheduler: Any = execute
    scheduler._Sleeper = partial(scheduler._Sleeper, timings=[_POLL_S])
    quiet, pytask.console.quiet = pytask.console.quiet, True
    how: dict[str, Any] = {"capture": "no", "verbose": 0, "disable_warnings": True}
    try:
        session = pytask.build(
            tasks=tasks, config=config, paths=root, parallel_backend="custom", n_workers=jobs, **how
        )
    finally:
        pytask.console.quiet = quiet
    if session.exit_code in (pytask.ExitCode.CONFIGURATION_FAILED, pytask.ExitCode.DAG_FAILED):
        raise TrextonError(f"the workflow engine could not start ({session.exit_code.name})")
    return list(session.execution_reports)


def _sentence(name: str, error: BaseException) -> str:
    if isinstance(error, OSError) and error.filename:
        reason = f"{error.filename}: {error.strerror}: mend it, what was there before is kept"
        return f"{name}: {reason}"
    return str(error) if isinstance(error, TrextonError) else f"{name}: {error!r}"


def _remembered(root: Path) -> dict[str, dict[str, str]]:
    """What the engine's lock file, and the journal of a run cut short, hold, by task and fact.

    A lock file that cannot be read is put away.
    """
    lock, journal = root / "pytask.lock", root / "pytask.lock.journal"
    try:
        entries = tomllib.loads(lock.read_text("utf-8"))["task"] if lock.is_file() else []
    except (ValueError, KeyError):
        lock.replace(lock.with_suffix(".damaged"))
        entries = []
    if journal.is_file():
        for line in journal.read_text("utf-8", errors="replace").splitlines():
            try:
                entries.append(json.loads(line))
            except ValueError:
                break  # the line that was being written when the run was killed
    return {one["id"]: one.get("depends_on", {}) | one.get("produces", {}) for one in entries}


def _reasons(step: Step, before: Mapping[str, str] | None) -> list[str]:
    """Why the last run cannot be reused: each entry that is not as it was."""
    if before is None:
        return ["no finished run"]
    lines = []
    for fact in (*step.facts, step.leaves[0]):
        old, new = json.loads(before.get(fact.name, "{}")), fact.read() or {}
        for key in sorted(old.keys() | new.keys()):
            was, now = (each.get(key, "absent")[:_SHOWN] for each in (old, new))
            if old.get(key) != new.get(key):
                lines.append(f"{key} {was} -> {now}")
    return list(dict.fromkeys(lines))
