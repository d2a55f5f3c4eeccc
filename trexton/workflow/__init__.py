"""Experiment notebooks over flights, reused while nothing that went in has changed.

The engine is pytask (https://pytask-dev.readthedocs.io): it compares what went in and what came out
by content, orders the tasks and remembers what is done. Here stands only what a flight and an
experiment are as a task: `notebooks` finds and reads them, `facts` says what goes in, `execution`
runs one, `plan` makes the tasks, `engine` hands them to pytask.
"""

from trexton.workflow.facts import outputs_of
from trexton.workflow.pairs import FlightPair
from trexton.workflow.plan import Outcome, default_jobs, run_experiments

__all__ = ["FlightPair", "Outcome", "default_jobs", "outputs_of", "run_experiments"]
