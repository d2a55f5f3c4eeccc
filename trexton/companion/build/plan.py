"""Run experiments on flights: check what was asked for, make the steps, hand them to the engine."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from trexton.base.errors import ParameterError, TrextonError
from trexton.companion.build.display import Display, Outcome
from trexton.companion.build.flight_pairs import FlightPair, check_names, check_out
from trexton.companion.build.notebooks import GIVEN, Notebook, find_notebooks
from trexton.companion.build.steps import Run, Step
from trexton.companion.build.workers import default_jobs, workers
from trexton.companion.experiments.declaration import Experiment
from trexton.companion.experiments.registry import EXPERIMENTS

__all__ = ["Outcome", "default_jobs", "run_experiments", "sole_writer"]


def run_experiments(
    pairs: Sequence[FlightPair],
    out: str | os.PathLike[str],
    *,
    only: Sequence[str] | None = None,
    settings: Mapping[str, object] | None = None,
    jobs: int | None = None,
    notebooks: str | os.PathLike[str] | None = None,
    experiments: Mapping[str, Experiment] = EXPERIMENTS,
    cluster: str | None = None,
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
        Notebooks at once; see `default_jobs`. On a cluster: as many as it has workers.
    notebooks : path, optional
        The folder of notebooks, this package's own by default.
    cluster : str, optional
        Address of a Dask scheduler whose workers run the notebooks, and what these spread.

    Raises
    ------
    ParameterError
        An experiment or a parameter is unknown, a value has the wrong type or is out of its range,
        results would lie in a flight; nothing has been touched then.
    """
    out = Path(out)
    chosen = _choose(notebooks, experiments, only)
    parameters = _settings_of(chosen, experiments, settings or {})
    check_names(pair.name for pair in pairs)
    check_out(out, pairs)
    everywhere = [n for n in chosen if experiments[n.name].every_flight]
    on_flights = [
        Step(notebook, experiments[notebook.name], pair, parameters[notebook.name])
        for notebook in chosen
        if notebook not in everywhere
        for pair in pairs
    ]
    # What looks at every flight comes after all of them, also where one has failed.
    last = [Step(notebook, experiments[notebook.name], None, {}) for notebook in everywhere]
    total = len(on_flights) + len(last)
    with workers(cluster, jobs) as crew, sole_writer(out), Display(total) as display:
        run = Run(out, pairs, crew)
        run.build(on_flights, display)
        run.build(last, display)
    return [run.outcomes[step.key] for step in on_flights + last]


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
