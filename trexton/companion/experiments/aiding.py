"""What the autopilot knows: a velocity beside the frames, right or turned by a wrong compass.

A survey and a later flight over one floor, at a height that ripples, are recorded as usual; the
later one is localized by its frames alone, and with the velocity.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.defaults import SAMPLES, TEXTONS
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import SURVEYED, Experiment, option
from trexton.companion.experiments.evaluation import frames_of
from trexton.companion.experiments.floors import FloorParameters, mean_over_floors, scratch_folder
from trexton.companion.experiments.style import errors_by_row
from trexton.companion.experiments.track import Track, fly
from trexton.companion.wording import distance, middle, number
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method, train_map
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.sensor import Effects
from trexton.vision.camera import Camera
from trexton.vision.textons import MAX_TEXTONS

# What comes beside a frame, and its label.
AIDINGS = {
    "nothing": "the frame alone",
    "velocity": "velocity",
    "turned": "velocity, by a wrong compass",
}
# The paper's filter has a motion model that asks for no velocity.
METHODS = {"paper": ("nothing",), "field": tuple(AIDINGS)}
FIRST_FLOOR = 500  # seed of the first painted floor; no setting was chosen on these
CELLS = 2  # parts of the image a side
RIPPLE = 0.1  # standard deviation of the height in metres
VELOCITY_M_S = 0.05  # noise of the velocity along each axis
COMPASS_DEG = 20.0  # by which a wrong compass turns the velocity
# By method and aiding the later flight over one floor, and its (N, 2) true positions.
_Over = tuple[dict[str, dict[str, Track]], np.ndarray]


@dataclass(frozen=True)
class Parameters(FloorParameters):
    """What can be chosen."""

    survey: int = option(400, "frames of the survey, every other one", low=20)
    frames: int = option(150, "of the later flight, every other one", low=20)
    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2, high=MAX_TEXTONS)
    samples: int = option(SAMPLES, "patches drawn from an image", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Localize one flight over each floor of `FloorParameters.over_each`, without a velocity and
    with it. Of `test` nothing is used.
    """
    over: list[_Over] = parameters.over_each(train, partial(_over, parameters), FIRST_FLOOR)
    rng = stream(parameters.seed, "intervals")
    errors = {
        method: {
            aid: np.stack([flown[method][aid].errors(truth) for flown, truth in over])
            for aid in asked
        }
        for method, asked in METHODS.items()
    }
    # A gain is taken frame by frame: the two share what is hard about a place.
    values: dict[str, Any] = {
        "error_cm": {
            method: {aid: mean_over_floors(100 * rows, rng) for aid, rows in found.items()}
            for method, found in errors.items()
        },
        "gain_cm": {
            method: {
                aid: mean_over_floors(100 * (found["nothing"] - rows), rng, -np.inf)
                for aid, rows in found.items()
                if aid != "nothing"
            }
            for method, found in errors.items()
        },
    }
    # Of the field, where it had a velocity: shares of frames.
    values["held"] = {}
    for aid in ("velocity", "turned"):
        shares = [flown["field"][aid].held(truth).mean() for flown, truth in over]
        values["held"][aid] = {"value": float(np.mean(shares))}
    values |= {"floors": len(over), "frames": int(errors["field"]["nothing"].size)}
    return parameters.record(train, values=values)


def _over(parameters: Parameters, seed: int, floor: Floor, camera: Camera, height: float) -> _Over:
    """Survey a floor, fly over it later, and localize that flight with all that is compared."""
    common: dict[str, Any] = {"floor": floor, "camera": camera, "height": height, "every": 2}
    common["effects"] = Effects(height_ripple=RIPPLE)
    with scratch_folder("aiding") as folder:
        survey = record_flight(folder / "survey", frames=parameters.survey, seed=seed, **common)
        later = record_flight(
            folder / "later", pattern="waypoints", frames=parameters.frames, seed=seed + 1, **common
        )
        maps = _maps(survey, parameters)
        frames = frames_of(later)
    offs = {"velocity": 0.0, "turned": np.radians(COMPASS_DEG)}
    aidings = {aid: _aiding(later, seed, off) for aid, off in offs.items()}
    aidings["nothing"] = [Aiding()] * len(later)

    def flown(method: str, aid: str) -> Track:
        # Each draws the same patches: what differs between them is not chance.
        localizer = Localizer(
            maps[method], samples=parameters.samples, rng=stream(seed, f"aiding {method}")
        )
        return fly(localizer, frames, aiding=aidings[aid])

    compared = {
        method: {aid: flown(method, aid) for aid in asked} for method, asked in METHODS.items()
    }
    return compared, later.position


def _maps(survey: Flight, parameters: Parameters) -> dict[str, TextonMap]:
    """By method."""
    base = train_map(
        survey, n_textons=parameters.textons, cells=CELLS, rng=stream(parameters.seed, "training")
    )
    return {
        method: for_method(base, method, rng=stream(parameters.seed, f"map {method}"))
        for method in METHODS
    }


def _aiding(later: Flight, seed: int, off: float) -> list[Aiding]:
    """The velocity that comes beside each frame, its compass `off` by so many radians."""
    noise = stream(seed, "autopilot", 1).standard_normal((len(later), 2))
    velocity = np.gradient(later.position, later.time, axis=0)
    velocity += VELOCITY_M_S * noise
    turn = np.array([[np.cos(off), np.sin(off)], [-np.sin(off), np.cos(off)]])
    return [Aiding(velocity=each) for each in velocity @ turn]


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    field, gains = values["error_cm"]["field"], values["gain_cm"]["field"]

    def error(aid: str) -> str:
        low, high = gains[aid]["low"], gains[aid]["high"]
        sure = "less," if low > 0 else "more," if high < 0 else "no difference"
        return f"it is {distance(middle(field[aid]))} ({sure} beyond chance)"

    return (
        f"By the frame alone the mean error of method field is {distance(field['nothing'])}. With "
        f"a velocity {error('velocity')}. With one that a compass turns by {number(COMPASS_DEG)} "
        f"degrees {error('turned')}."
    )


def errors(record: Record) -> Figure:
    """Mean error with its interval over what aided it, a colour for each method."""
    return errors_by_row(AIDINGS, {name: record.values["error_cm"][name] for name in METHODS})


def table(record: Record) -> pd.DataFrame:
    """Mean error and gain with their intervals, a row for each aiding."""
    rows = []
    for aid, label in AIDINGS.items():
        row = {"measured beside the frame": label}
        for method in METHODS:
            for what in ("error", "gain"):
                if entries := record.values[f"{what}_cm"][method]:
                    row[f"{method}, {what}"] = distance(entries[aid]) if aid in entries else ""
        rows.append(row)
    return pd.DataFrame(rows)


EXPERIMENT = Experiment(
    "Aiding by the autopilot", Parameters, run, finding, needs=SURVEYED, cost_s=40
)
