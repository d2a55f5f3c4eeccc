"""What every experiment declares: its parameters, its run and its finding, each stated once.

Offers `Experiment`, the bases of its parameters (which make its record), and what flights may lack.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from trexton.base.defaults import NEIGHBORS, PARTICLES, SAMPLES, TEXTONS
from trexton.base.options import Options
from trexton.base.options import option as option
from trexton.base.records import Record
from trexton.companion.provenance import made_by
from trexton.flights.flight import Flight


class Need(NamedTuple):
    """What a flight may have: how to see it, what it is, the reason for a skip without it."""

    has: Callable[[Flight], bool]
    words: str
    lacking: str


NEEDS = {
    "images": Need(lambda flight: flight.has_images, "camera images", "has no images"),
    "histograms": Need(
        lambda flight: not flight.has_images, "histograms and no images",
        "has images: the page of the real flight has it",
    ),
    "positions": Need(
        lambda flight: flight.has_positions, "a position for every frame",
        "lacks positions in some frames",
    ),
    "floor": Need(
        lambda flight: flight.floor_file is not None, "a picture of the true floor",
        "has no picture of its true floor",
    ),
    "camera": Need(
        lambda flight: flight.camera is not None, "a calibrated camera", "has no calibrated camera"
    ),
}  # fmt: skip

POSITIONS = ("positions",)
IMAGES = ("positions", "images")
SURVEYED = ("positions", "images", "floor", "camera")


@dataclass(frozen=True)
class Experiment:
    """An experiment, and what the workflow must know of it.

    Attributes
    ----------
    title : str
        The title of its page.
    parameters : class of `Options`
        What can be chosen.
    run : callable, optional
        Of the training flight, the test flight and the parameters; makes the record. Without, the
        page runs once, after all flights, over all their records.
    finding : callable, optional
        What a record says, in a sentence or two.
    needs : tuple of str
        What both flights must have: keys of `NEEDS`.
    after : tuple of str
        Experiments that run before it on the same flight, because it reads what they leave.
    cost_s : float
        About how long it takes, for the time that is left.
    alone : bool
        It measures time: nothing runs beside it.
    claims : tuple of dict
        What it claims itself, beyond the paper: tables as in ``data/paper/claims.toml``.
    """

    title: str
    parameters: type[Options] = Options
    run: Callable[[Flight, Flight, Any], Record] | None = None
    finding: Callable[[Record], str] | None = None
    needs: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    cost_s: float = 20.0
    alone: bool = False
    claims: tuple[dict[str, Any], ...] = ()

    @property
    def every_flight(self) -> bool:
        """Whether it has no run of its own, but a page over the records of all flights."""
        return self.run is None

    @property
    def module(self) -> str:
        """The module that declares its parameters and its run."""
        return self.parameters.__module__


@dataclass(frozen=True)
class SeedParameters(Options):
    """Base of an experiment's parameters; the module it stands in names the experiment."""

    seed: int = option(1, "of all random numbers", low=0)

    def record(
        self,
        *flights: Flight,
        values: Mapping[str, Any],
        series: Mapping[str, Any] | None = None,
        images: Mapping[str, np.ndarray] | None = None,
        timings: Mapping[str, Any] | None = None,
    ) -> Record:
        """The record of a run with these parameters on `flights`, of which the first names it.

        See `trexton.base.records.Record` for what belongs where.
        """
        return Record(
            experiment=type(self).__module__.rpartition(".")[2],
            flight=flights[0].name,
            parameters=self.as_dict(),
            values=dict(values),
            series=dict(series or {}),
            images=dict(images or {}),
            timings=dict(timings or {}),
            provenance={
                "flights": {flight.name: flight.data_hash for flight in flights},
                **made_by(type(self).__module__),
            },
        )


@dataclass(frozen=True)
class MapParameters(SeedParameters):
    """With those of a texton map and its localizer; the defaults are the paper's."""

    samples: int = option(SAMPLES, "patches drawn from an image", low=1)
    particles: int = option(PARTICLES, "particles of the filter", low=1)
    neighbors: int = option(NEIGHBORS, "neighbours that vote, k", low=1)
    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2)
