"""The declaration of the tiny notebooks: three parameters."""

from __future__ import annotations

from dataclasses import dataclass

from trexton.base.options import Options, option
from trexton.base.records import Record
from trexton.companion.experiments.declaration import Experiment


@dataclass(frozen=True)
class Parameters(Options):
    """What a tiny notebook can be told."""

    factor: int = option(2, "frames are counted so many times", low=-9)
    rate: float | None = option(0.5, "of nothing")
    label: str = option("a", "a word")


def run(train, test, parameters) -> Record:
    raise NotImplementedError("a tiny notebook makes its record itself")


def tiny(title: str, **more) -> Experiment:
    """An experiment whose page is a tiny notebook."""
    return Experiment(title, Parameters, run, **more)
