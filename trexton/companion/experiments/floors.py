"""Which floor will do, from a picture alone: fly over it virtually, learn, and see how far off one
would be.

The prediction uses the training part of the virtual flight only; the error beside it is measured on
a second flight, under another light.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.base.files import scratch_folder
from trexton.base.options import Options, option
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SeedParameters
from trexton.companion.experiments.evaluation import constant_guess, frames_of
from trexton.companion.experiments.rates import mean_over_groups
from trexton.companion.experiments.track import fly
from trexton.evaluation.metrics import euclidean, mean_with_interval
from trexton.evaluation.suitability import local_losses
from trexton.field.likelihood import grid_cells
from trexton.flights.flight import Flight
from trexton.flights.registry import data_folder
from trexton.localization.localizer import Localizer
from trexton.localization.training import for_method, train_map
from trexton.simulator import LAYOUTS, PERIOD, Floor, record_flight
from trexton.vision.camera import Camera

LANE = 0.5  # metres between the lanes of a survey that sees everything twice
SURVEY_SPEED = 1.2  # metres a second, the simulator's survey
EVERY = 2  # frames: half the camera's rate, so that fewer frames cover the floor
CELL, CELLS = 0.1, 40_000  # metres, of the map of expected errors; and at most so many of them
SIGMA_M = 0.8  # of the paper's map loss
METHOD = "field"  # the one whose error is predicted
# Of a survey for a first number.
FIRST_FRAMES, FIRST_EVERY, FIRST_CAMERA = 200, 5, Camera(320, 240, 260.0)


@dataclass(frozen=True)
class FloorParameters(SeedParameters):
    """Those of experiments over painted floors, or over the one that a flight lends."""

    floors: int = option(
        0, "painted floors to survey and fly over; 0 is the flight's own", low=0, high=1000
    )

    def over_each(
        self, train: Flight, fly_over: Callable[[int, Floor, Camera, float], Any], first: int
    ) -> list[Any]:
        """What `fly_over` gives of each floor: of those painted from seed `first` on, or of the one
        that `train` lends.

        Parameters
        ----------
        fly_over : callable
            Of a seed, a floor, a camera and a height in metres; it can be pickled.

        Raises
        ------
        ParameterError
            The flight has no floor or camera to lend.
        """
        if not self.floors:
            return [fly_over(self.seed, *lent_floor(train))]
        return spread(partial(self._over_painted, fly_over, first), range(self.floors), "floors")

    def _over_painted(
        self, fly_over: Callable[[int, Floor, Camera, float], Any], first: int, index: int
    ) -> Any:
        _, floor = painted_floor(index, first + index)
        return fly_over(self.seed + 1000 * (index + 1), floor, Camera(), 1.0)


def mean_over_floors(
    rows: np.ndarray, rng: np.random.Generator, lowest: float = 0.0
) -> Mapping[str, float | None]:
    """Mean of ``(F, N)`` values with its 95 % interval over floors, as records hold it; over one
    floor, that over stretches of its flight.
    """
    if len(rows) == 1:
        return mean_with_interval(rows, rng)
    return mean_over_groups(rows.mean(axis=1), lowest)


@dataclass(frozen=True)
class VirtualFlights(Options):
    """How a floor is flown over."""

    frames: int = option(0, "of the survey; 0 takes as many as its lanes need", low=0, high=20000)
    test_frames: int = option(200, "of the flight on which errors are measured", low=20, high=20000)
    height: float = option(1.0, "metres above the floor", low=0.2, high=10)
    seed: int = option(1, "of the flights", low=0)

    def fly_over(self, floor: Floor, folder: Path) -> tuple[Flight, Flight]:
        """A survey, and a flight between random places an hour later."""
        x_min, x_max, y_min, y_max = floor.area
        path = 2 * (x_max - x_min) * (y_max - y_min) / LANE
        frames = self.frames or int(np.clip(path / (SURVEY_SPEED * PERIOD * EVERY), 200, 2000))
        common: dict[str, Any] = {"floor": floor, "height": self.height, "every": EVERY}
        return (
            record_flight(
                folder / "survey", pattern="survey", frames=frames, seed=self.seed, **common
            ),
            record_flight(
                folder / "later", pattern="waypoints", frames=self.test_frames,
                seed=self.seed + 1, **common,
            ),
        )  # fmt: skip


def first_prediction(floor: Floor, *, flights: VirtualFlights) -> float | None:
    """Centimetres of error to expect over a floor, by a survey of few frames and a quarter of the
    pixels: within seconds, and coarser than `judge_floor`. None where that shows too little.
    """
    with scratch_folder("floor") as folder:
        survey = record_flight(
            folder / "survey", frames=min(flights.frames or FIRST_FRAMES, FIRST_FRAMES),
            seed=flights.seed, floor=floor, height=flights.height, every=FIRST_EVERY,
            camera=FIRST_CAMERA,
        )  # fmt: skip
        try:
            coarse = train_map(survey, method=METHOD, rng=stream(flights.seed, "map"))
        except MapError:
            return None
    predicted = _over_floor(coarse.parts["measurement"].predicted_error, floor.area)
    return float(100 * predicted.mean())


def judge_floor(
    floor: Floor,
    *,
    flights: VirtualFlights = VirtualFlights(),
    methods: Sequence[str] = (METHOD,),
) -> dict[str, Any]:
    """Predict how far off one would be over a floor, and measure it on a virtual flight.

    Parameters
    ----------
    floor : Floor
    flights : VirtualFlights
    methods : sequence of str
        Flown over the second flight; see `trexton.localization.methods.METHODS`.

    Returns
    -------
    dict
        ``area_m``; ``loss``, the paper's L(D); ``predicted_cm``, the error to expect over the
        floor, from the survey alone; ``measured``, for each method ``mean_cm``, ``low``, ``high``;
        ``centre_cm``, the error of always guessing the middle; ``heat``, predicted error over the
        floor in metres; ``worst_m``, where the field knows least.
    """
    with scratch_folder("floor") as name:
        train, test = flights.fly_over(floor, name)
        frames = frames_of(test)
        base = train_map(train, rng=stream(flights.seed, "map"))
        maps = {
            method: for_method(
                base, method, flight=train, rng=stream(flights.seed, f"map {method}")
            )
            for method in dict.fromkeys((METHOD, *methods))  # each once
        }
        runs = {}
        for method in methods:
            localizer = Localizer(maps[method], rng=stream(flights.seed, "flight", 0))
            runs[method] = fly(localizer, frames).position
    field = maps[METHOD].parts["measurement"]
    heat = _over_floor(field.predicted_error, floor.area)
    rng = stream(flights.seed, "intervals")
    centre = constant_guess(base.positions, len(test))
    losses = local_losses(base.histograms, base.positions, SIGMA_M)
    return {
        "area_m": floor.area,
        "frames": {"survey": len(train), "test": len(test)},
        "loss": losses.mean(),
        "predicted_cm": 100 * heat.mean(),
        "measured": {name: _summary(run, test, rng) for name, run in runs.items()},
        "centre_cm": (100 * euclidean(centre, test.position)).mean(),
        "heat": {"error_m": heat.round(4)},
        "worst_m": _worst(_over_floor(field.variance_at, floor.area), floor.area),
    }


def _over_floor(
    expected: Callable[[np.ndarray], np.ndarray], area: tuple[float, float, float, float]
) -> np.ndarray:
    """``(rows, columns)`` expected errors at the centres of cells, row 0 at the smallest y."""
    sides = area[1] - area[0], area[3] - area[2]
    places, shape = grid_cells(area, min(CELLS, round(sides[0] * sides[1] / CELL**2)))
    return expected(places).reshape(shape).T


def _summary(estimates: np.ndarray, flight: Flight, rng: np.random.Generator) -> dict[str, float]:
    """Mean error in cm with its 95 % interval over stretches of the flight."""
    errors = 100 * euclidean(estimates, flight.position)
    mean = mean_with_interval(errors[None], rng)
    return {"mean_cm": errors.mean(), "low": mean["low"], "high": mean["high"]}


def _worst(heat: np.ndarray, extent: Sequence[float]) -> tuple[float, float]:
    """Centre of the cell of the largest value, metres."""
    row, column = np.unravel_index(np.nanargmax(heat), heat.shape)
    x_min, x_max, y_min, y_max = extent
    rows, columns = heat.shape
    return (
        float(x_min + (column + 0.5) * (x_max - x_min) / columns),
        float(y_min + (row + 0.5) * (y_max - y_min) / rows),
    )


def named_floor(name: str) -> Floor:
    """A floor by name: a layout, a colon and a seed, as in ``moved:3``; or a picture and its width
    in metres, as in ``maps/hall.png@5``, found in the folder of the data unless absolute.

    Raises
    ------
    ImageError
        There is no such picture.
    ParameterError
        The name is of another form, the layout unknown, or the width out of range.
    """
    if painted := re.fullmatch(r"([a-z]+):(\d+)", name):
        return Floor.painted(painted[1], int(painted[2]))
    if photographed := re.fullmatch(r"(.+)@(\d+(?:\.\d+)?)", name):
        return Floor.from_file(data_folder() / photographed[1], float(photographed[2]))
    raise ParameterError(
        f"floor {name!r}: expected a layout and a seed, as in moved:3, "
        "or a picture and its width in metres, as in maps/hall.png@5"
    )


def painted_floor(number: int, seed: int) -> tuple[str, Floor]:
    """The name and the floor that `seed` paints; its layout is the next for each number."""
    layout = list(LAYOUTS)[number % len(LAYOUTS)]
    return f"{layout} {seed}", Floor.painted(layout, seed)


def lent_floor(flight: Flight) -> tuple[Floor, Camera, float]:
    """What a recorded flight lends to a virtual one: its floor, its camera, its height in metres.

    Raises
    ------
    ParameterError
        The flight has no floor or camera.
    """
    if flight.floor is None or flight.camera is None:
        raise ParameterError(
            f"flight {flight.name!r} has no picture of its floor or no camera: a virtual flight "
            "over it needs both, as trexton simulate gives them"
        )
    height = 1.0 if flight.height is None else float(np.nanmean(flight.height))
    return Floor(flight.floor), flight.camera, height
