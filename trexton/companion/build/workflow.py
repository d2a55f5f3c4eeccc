"""Experiment notebooks over flights, reused while nothing that went in has changed.

The engine is pytask (https://pytask-dev.readthedocs.io): it compares what went in and what came out
by content, orders the tasks and remembers what is done. Here stands only what a flight and an
experiment are as a task: `notebooks` finds and reads them, `facts` says what goes in, `execution`
runs one, `plan` makes the tasks, `engine` hands them to pytask.

Names are imported on first use: a process that runs one notebook or one cell needs little of it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trexton.companion.build.facts import outputs_of
    from trexton.companion.build.pairs import FlightPair
    from trexton.companion.build.plan import Outcome, default_jobs, run_experiments

__all__ = ["FlightPair", "Outcome", "default_jobs", "outputs_of", "run_experiments"]

_PLACES = {"FlightPair": "pairs", "outputs_of": "facts"}


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module(f"trexton.companion.build.{_PLACES.get(name, 'plan')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
