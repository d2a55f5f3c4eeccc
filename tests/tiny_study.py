"""How fast the vehicle flew.

From positions alone: the distance between frames over the time between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.declaration import SeedParameters, option
from trexton.flights.flight import Flight


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    percentile: float = option(95.0, "of the speeds that counts as the top speed", low=0, high=100)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Speeds of the test flight."""
    speed = np.hypot(*np.diff(test.position, axis=0).T) / np.diff(test.time)
    top = np.percentile(speed, parameters.percentile)
    values = {"top_m_s": top, "median_m_s": np.median(speed)}
    return parameters.record(train, test, values=values, series={"speed_m_s": speed})


def over_time(record: Record) -> Figure:
    """Speed of the vehicle in every frame."""
    figure = Figure()
    figure.add_subplot(ylabel="speed (m/s)").plot(record.series["speed_m_s"])
    return figure


FIGURES = {"speed": over_time}
CLAIMS = ({"id": "top-speed", "place": "Flight tests", "text": "It flies slowly", "kind": "below",
           "ours": "tiny_study:top_m_s", "bound": 3.0, "unit": "m/s"},)  # fmt: skip
