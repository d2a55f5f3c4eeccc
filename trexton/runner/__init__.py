"""The runner: experiment notebooks over flights, reused while nothing that went in has changed."""

from trexton.runner.pairs import FlightPair
from trexton.runner.schedule import Outcome, default_jobs, run_experiments

__all__ = ["FlightPair", "Outcome", "default_jobs", "run_experiments"]
