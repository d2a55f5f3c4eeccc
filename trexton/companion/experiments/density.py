"""How densely to survey: what lanes closer to each other bring.

The vehicle surveys a floor for a while, for twice and for four times as long, each time in lanes
that cover all of it, and flies over it later. Paper, Sec. Dataset Generation: one survey.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from trexton.base.defaults import SAMPLES, TEXTONS
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import SURVEYED, Experiment, option
from trexton.companion.experiments.evaluation import frames_of
from trexton.companion.experiments.floors import FloorParameters, mean_over_floors, scratch_folder
from trexton.companion.experiments.style import COLORS, canvas, legend_above, with_intervals
from trexton.companion.experiments.track import Track, fly
from trexton.companion.wording import distance, middle, number, percent
from trexton.field.likelihood import grid_cells
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method, full_histograms, train_map
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera
from trexton.vision.textons import MAX_TEXTONS

METHODS = {
    "paper": "the paper's filter",
    "field": "the field, of whole images",
    "parts": "the field, of their parts",
}
TIMES = (1, 2, 4)  # as long as the shortest survey
FIRST_FLOOR = 700  # seed of the first painted floor; no setting was chosen on these
PLACES = 2500  # of a grid, to which a survey comes more or less near
CELLS = 2  # parts of the image a side
# One survey of one floor: by method the later flight with its map, the survey's seconds, and the
# mean distance from a place to its nearest frame in metres.
_Over = tuple[dict[str, Track], float, float]


@dataclass(frozen=True)
class Parameters(FloorParameters):
    """What can be chosen."""

    survey: int = option(200, "frames of the shortest survey, every other one", low=20)
    frames: int = option(200, "of the later flight, every other one", low=20)
    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2, high=MAX_TEXTONS)
    samples: int = option(SAMPLES, "patches drawn from an image", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly the same later flight with maps of surveys that took more and more time, over each floor
    of `FloorParameters.over_each`. Of `test` nothing is used.
    """
    floors = parameters.over_each(train, partial(_over, parameters), FIRST_FLOOR)
    rng = stream(parameters.seed, "intervals")
    surveys = []
    for index, times in enumerate(TIMES):
        over: list[_Over] = [surveyed[index] for surveyed, _ in floors]
        survey: dict[str, Any] = {
            "frames": times * parameters.survey,
            "lasted_s": float(np.mean([lasted for _, lasted, _ in over])),
            "apart_cm": 100 * float(np.mean([apart for *_, apart in over])),
        }
        for name in METHODS:
            runs = [(each[0][name], floor[1]) for each, floor in zip(over, floors, strict=True)]
            errors = 100 * np.stack([run.errors(truth) for run, truth in runs])
            survey[name] = {
                "error_cm": mean_over_floors(errors, rng),
                "held": float(np.mean([run.held(truth) for run, truth in runs])),
            }
        surveys.append(survey)
    values = {"surveys": surveys, "floors": len(floors), "frames": parameters.frames}
    return parameters.record(train, values=values)


def _over(
    parameters: Parameters, seed: int, floor: Floor, camera: Camera, height: float
) -> tuple[list[_Over], np.ndarray]:
    """The surveys of one floor, and the true positions of one later flight."""
    if not parameters.floors:
        seed += 1000
    common: dict[str, Any] = {"floor": floor, "camera": camera, "height": height, "every": 2}
    with scratch_folder("density") as folder:
        later = record_flight(
            folder / "later", pattern="waypoints", frames=parameters.frames, seed=seed + 1, **common
        )
        frames, over = frames_of(later), []
        for times in TIMES:
            survey = record_flight(
                folder / f"survey-{times}", frames=times * parameters.survey, seed=seed, **common
            )
            places, _ = grid_cells(survey.area, PLACES)
            apart = float(cKDTree(survey.position).query(places)[0].mean())
            flown = {
                name: fly(
                    Localizer(
                        each, samples=parameters.samples, rng=stream(seed, f"density {name}")
                    ),
                    frames,
                )
                for name, each in _maps(parameters, survey).items()
            }
            over.append((flown, float(survey.time[-1] - survey.time[0]), apart))
    return over, later.position


def _maps(parameters: Parameters, survey: Flight) -> dict[str, TextonMap]:
    """By method, of one survey."""
    base = train_map(survey, n_textons=parameters.textons, rng=stream(parameters.seed, "training"))
    rng = stream(parameters.seed, "map field")
    cut = base.with_histograms(full_histograms(survey, base.alphabet, CELLS), CELLS)
    return {
        "paper": base,
        "field": for_method(base, "field", rng=rng),
        "parts": for_method(cut, "field", rng=rng),
    }


def finding(record: Record) -> str:
    """What the experiment found, a sentence for the shortest survey and one for the longest."""
    said = []
    for survey in (record.values["surveys"][0], record.values["surveys"][-1]):
        said.append(
            f"After a survey of {number(survey['lasted_s'])} s the mean error of the field is "
            f"{distance(survey['parts']['error_cm'])} by parts of the images, "
            f"{distance(middle(survey['field']['error_cm']))} by whole ones, of the paper's filter "
            f"{distance(middle(survey['paper']['error_cm']))}."
        )
    return " ".join(said)


def errors(record: Record) -> Figure:
    """Mean error with its interval over the distance to the nearest frame of the survey."""
    surveys = record.values["surveys"]
    apart = np.array([survey["apart_cm"] for survey in surveys])
    with canvas(size=(6.4, 3.6)) as (figure, [[plot]]):
        for (method, label), mark, stroke in zip(METHODS.items(), "osD", "-:-", strict=True):
            color = COLORS[method if method in COLORS else "field"]
            entries = [survey[method]["error_cm"] for survey in surveys]
            with_intervals(plot, apart, entries, fmt=mark + stroke, color=color, label=label)
        plot.set_xlabel("mean distance to the nearest frame of the survey (cm)")
        plot.set(ylabel="mean error (cm)", xlim=(0, None), ylim=(0, None))
        legend_above(plot)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Errors and regions, a row for each survey and method."""
    return pd.DataFrame(
        [
            {
                "survey, nearest frame": f"{number(survey['lasted_s'])} s, "
                f"{number(survey['apart_cm'])} cm",
                "method": label,
                "mean error": distance(survey[name]["error_cm"]),
                "90 % region covers": percent(survey[name]["held"]),
            }
            for survey in record.values["surveys"]
            for name, label in METHODS.items()
        ]
    )


EXPERIMENT = Experiment(
    "How densely to survey", Parameters, run, finding, needs=SURVEYED, cost_s=30
)
