"""An experiment on a flight as a task of the engine, and what became of it."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytask

from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file
from trexton.companion.build import engine
from trexton.companion.build.display import Display, Outcome
from trexton.companion.build.execution import Job
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.nodes import (
    HashedNode,
    inputs_of,
    outputs_fact,
    outputs_of,
    reading,
    reasons,
    record_fact,
    remembered,
)
from trexton.companion.build.notebooks import Notebook
from trexton.companion.build.workers import Workers
from trexton.companion.experiments.declaration import Experiment

__all__ = ["Run", "Step"]

Key = tuple[str, str]


@dataclass(frozen=True)
class Step:
    """One experiment on one pair of flights, or (`pair` None) over the records of all."""

    notebook: Notebook
    experiment: Experiment
    pair: FlightPair | None
    parameters: Mapping[str, Any]

    @property
    def key(self) -> Key:
        """Flight (empty: all) and experiment."""
        return (self.pair.name if self.pair else "", self.notebook.name)

    @property
    def name(self) -> str:
        """The name of the engine's task."""
        return "/".join(filter(None, self.key))


class Run:
    """One run into one folder of results: builds steps, keeps outputs, says what became of them."""

    def __init__(self, out: Path, pairs: Sequence[FlightPair], workers: Workers):
        self.out, self.pairs, self.workers = out, pairs, workers
        self.root = out / ".engine"
        self.outcomes: dict[Key, Outcome] = {}
        self._turns, self._stopping = engine.Turns(), threading.Event()
        for leftover in self.root.glob(".work.*"):  # of a run that was killed
            shutil.rmtree(leftover, ignore_errors=True)

    def build(self, steps: Sequence[Step], display: Display) -> None:
        """Bring all steps up to date; fills `outcomes`."""
        ready: dict[str, Step] = {}
        for step in steps:
            obstacle = step.pair.obstacle(step.experiment) if step.pair else None
            if obstacle:
                self._settle(Outcome(*step.key, "skipped", (obstacle,)), display)
            else:
                ready[step.name] = step
        if not ready:
            return
        before = remembered(self.root)
        facts = {name: self._facts(step, ready) for name, step in ready.items()}
        tasks = [
            engine.task(
                name,
                partial(self._perform, step, facts[name], before.get(name), display),
                *facts[name],
                turn=_turn(step, ready.values()),
            )
            for name, step in ready.items()
        ]
        self._stopping.clear()
        reports = engine.build(tasks, self.root, self.workers.jobs, self._stop)
        for name, step in ready.items():
            if step.key not in self.outcomes:
                self._settle(self._outcome(step, reports[name], facts[name]), display)

    def _stop(self) -> None:
        self._stopping.set()
        self.workers.stop()

    def _settle(self, outcome: Outcome, display: Display) -> None:
        self.outcomes[outcome.flight, outcome.experiment] = outcome
        display.finished(outcome)

    def _folder(self, step: Step) -> Path:
        return self.out / step.pair.name if step.pair else self.out

    def _records(self, step: Step, planned: Mapping[str, Step]) -> list[Path]:
        """Records of other experiments that the step reads and that are, or will be, true."""
        if step.pair is None:
            records = sorted(
                p for pair in self.pairs for p in (self.out / pair.name).glob("*.json")
            )
        else:
            folder, planned_names = self._folder(step), {other.key for other in planned.values()}
            records = [
                folder / f"{name}.json"
                for name in step.experiment.after
                if (step.pair.name, name) in planned_names or (folder / f"{name}.json").is_file()
            ]
        stale = {key for key, one in self.outcomes.items() if one.status in ("failed", "skipped")}
        return [path for path in records if (path.parent.name, path.stem) not in stale]

    def _facts(
        self, step: Step, planned: Mapping[str, Step]
    ) -> tuple[list[HashedNode], list[HashedNode]]:
        """What goes in, and what comes out."""
        folder, name, owner = self._folder(step), step.notebook.name, step.name
        data = step.pair.hashes if step.pair else {}
        reads = inputs_of(owner, step.notebook, step.parameters, data)
        records = self._records(step, planned)
        reads.append(reading(owner, records))
        for path in records:
            whole = step.pair is None  # whatever looks at every flight shows timings too
            reads.append(record_fact(path, owner if whole else "", timings=whole))
        leaves = [outputs_fact(owner, folder, name)]
        return reads, [*leaves, record_fact(folder / f"{name}.json")]

    def _perform(
        self,
        step: Step,
        facts: tuple[list[HashedNode], list[HashedNode]],
        before: Mapping[str, str] | None,
        display: Display,
    ) -> None:
        """Run the notebook; its results replace the last ones when they are whole."""
        folder, name = self._folder(step), step.notebook.name
        why = reasons(facts[0] + facts[1][:1], before, folder, name)
        with self._turns.turn(step.experiment.alone):
            slot = threading.get_ident()
            done = self.workers.run(
                self._job(step, facts[0]),
                lambda cell, cells: display.moved(slot, f"{step.name} {cell}/{cells}"),
            )
            display.moved(slot, None)
        failed = folder / f"{name}.failed.ipynb"
        if done.error and self._stopping.is_set():
            raise TrextonError(f"{step.name} was interrupted")
        if done.error:
            kept = ""
            if done.partial:
                _write(failed, done.partial)
                kept = f"; partial output: {failed}"
            self._settle(Outcome(*step.key, "failed", (done.error + kept,), done.seconds), display)
            raise TrextonError(done.error)
        old = {path.name for path in outputs_of(folder, name)}
        for file, content in done.files.items():
            _write(folder / file, content)
        for file in (old - done.files.keys()) | {failed.name}:
            (folder / file).unlink(missing_ok=True)
        self._settle(Outcome(*step.key, "ran", tuple(why), done.seconds), display)

    def _job(self, step: Step, reads: Sequence[HashedNode]) -> Job:
        given = step.pair.parameters(self.out) if step.pair else {"out": str(self.out)}
        labels = {
            entry
            for fact in reads
            if fact.name.startswith("record ")
            for entry in fact.read() or ()
        }
        files = {
            str(path.relative_to(self.out)): path.read_bytes()
            for label in sorted(labels)
            for path in outputs_of(self.out / Path(label).parent, Path(label).name)
            if path.suffix in (".json", ".png")
        }
        return Job(
            name=step.notebook.name,
            text=step.notebook.text,
            source=step.notebook.source,
            parameters={**given, **step.parameters},
            subfolder=step.pair.name if step.pair else "",
            records=files,
            folder=os.getcwd(),
            work=str(self.root.resolve()),
            threads=self.workers.threads(step.experiment.alone),
            cluster="" if step.experiment.alone else self.workers.cluster,
        )

    def _outcome(
        self, step: Step, report: Any, facts: tuple[list[HashedNode], list[HashedNode]]
    ) -> Outcome:
        """What the engine's report means where the step itself did not say."""
        if report.outcome == pytask.TaskOutcome.SKIP_UNCHANGED:
            parts = [
                f"{len(fact.read() or ())} {_COUNTED[fact.name]}"
                for fact in facts[0]
                if fact.name in _COUNTED
            ]
            records = sum(fact.name.startswith("record ") for fact in facts[0])
            parts += ["the data", "the versions"] + ([f"{records} records"] if records else [])
            return Outcome(*step.key, "reused", (f"nothing changed in {', '.join(parts)}",))
        if report.outcome == pytask.TaskOutcome.SKIP_PREVIOUS_FAILED:
            broken = next(
                name for name in step.experiment.after
                if (one := self.outcomes.get((step.key[0], name)))
                and one.status in ("failed", "skipped")
            )  # fmt: skip
            return Outcome(*step.key, "skipped", (f"{broken}, which it builds on, failed",))
        error = report.exc_info[1] if report.exc_info else "no reason given"
        if isinstance(error, OSError) and error.filename:
            error = f"{error.filename}: {error.strerror}: mend it, what was there before is kept"
        return Outcome(*step.key, "failed", (f"{step.name}: {error}",))


_COUNTED = {"code": "modules", "parameters": "parameters"}


def _write(path: Path, content: bytes) -> None:
    with atomic_file(path, "wb") as stream:
        stream.write(content)


def _turn(step: Step, steps: Sequence[Step] | Any) -> str | None:
    """What most waits for starts first; what wants the machine to itself comes last."""
    if step.experiment.alone:
        return "try_last"
    longest = max(_chain(other, steps) for other in steps if not other.experiment.alone)
    return "try_first" if _chain(step, steps) >= longest / 4 else None


def _chain(step: Step, steps: Sequence[Step] | Any) -> float:
    """Seconds from the start of `step` to the end of whatever waits for it, on the same flight."""
    flight, name = step.key
    heirs = [
        _chain(other, steps)
        for other in steps
        if other.key[0] == flight and name in other.experiment.after
    ]
    return step.experiment.cost_s + max(heirs, default=0.0)
