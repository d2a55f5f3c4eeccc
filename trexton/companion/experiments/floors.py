"""Floors of experiments: by name, painted one after another, or lent by a recorded flight; means
over several.
"""

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.files import work_folder
from trexton.base.options import option
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SeedParameters
from trexton.companion.experiments.metrics import mean_with_interval
from trexton.companion.experiments.rates import mean_over_groups
from trexton.flights.flight import Flight
from trexton.flights.registry import data_folder
from trexton.simulator.floor import LAYOUTS, Floor
from trexton.vision.camera import Camera


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
    rows: Sequence[np.ndarray] | np.ndarray, rng: np.random.Generator, lowest: float = 0.0
) -> Mapping[str, float | None]:
    """Mean of ``(N,)`` values of each of F floors with its 95 % interval over floors, as records
    hold it; over one floor, that over stretches of its flight.
    """
    if len(rows) == 1:
        return mean_with_interval(np.stack(list(rows)), rng)
    return mean_over_groups([row.mean() for row in rows], lowest)


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


def scratch_folder(kind: str) -> AbstractContextManager[Path]:
    """A folder of the system's temporary ones; what a killed process left of this kind goes."""
    return work_folder(Path(tempfile.gettempdir()) / f"trexton-{kind}")
