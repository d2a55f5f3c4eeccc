"""What every experiment declares: its parameters, told once, and the record made with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.base.defaults import NEIGHBORS, PARTICLES, SAMPLES, TEXTONS
from trexton.base.options import Options, option
from trexton.base.records import Record, software_versions
from trexton.flights.flight import Flight

__all__ = ["FilterParameters", "MapParameters", "SeedParameters", "option"]


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
                "versions": software_versions(),
            },
        )


@dataclass(frozen=True)
class FilterParameters(SeedParameters):
    """With those of the localizer; the defaults are the paper's."""

    samples: int = option(SAMPLES, "patches drawn from an image", low=1)
    particles: int = option(PARTICLES, "particles of the filter", low=1)
    neighbors: int = option(NEIGHBORS, "neighbours that vote, k", low=1)


@dataclass(frozen=True)
class MapParameters(FilterParameters):
    """With those of a texton map too."""

    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2)
