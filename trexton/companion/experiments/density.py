"""How densely to survey: what lanes closer to each other bring.

The vehicle surveys a floor for a while, for twice and for four times as long, each time in lanes
that cover all of it, and flies over it later. Paper, Sec. Dataset Generation: one survey.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
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
from trexton.companion.experiments.floors import FloorParameters, mean_over_floors
from trexton.companion.experiments.style import COLORS, canvas, legend_above, with_intervals
from trexton.companion.experiments.track import fly
from trexton.companion.wording import distance, number, percent
from trexton.field.grid import grid_cells
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.localization.training import counted, for_method, train_map
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


@dataclass(frozen=True)
class Parameters(FloorParameters):
    """What can be chosen."""

    survey: int = option(200, "frames of the shortest survey, every other one", low=20)
    frames: int = option(200, "of the later flight, every other one", low=20)
    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2, high=MAX_TEXTONS)
    cells: int = option(2, "parts of the image a side", low=1, high=8)
    samples: int = option(SAMPLES, "patches drawn from an image", low=1)


@dataclass(frozen=True, eq=False)
class _Over:
    """One survey of one floor, and the later flight.

    Attributes
    ----------
    errors, held : dict of str to (N,) array
        By method: metres, and whether the region that should hold 90 % held the truth.
    apart : float
        Mean distance from a place to the nearest frame of the survey, metres.
    lasted : float
        The survey, seconds.
    """

    errors: dict[str, np.ndarray]
    held: dict[str, np.ndarray]
    apart: float
    lasted: float


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly the same later flight with maps of surveys that took more and more time.

    Parameters
    ----------
    train, test : Flight
        `train` lends its floor, camera and height, unless there are floors to paint. Of `test`
        nothing is used.

    Raises
    ------
    ParameterError
        The flight has no floor or camera to lend.
    """
    flown = parameters.over_each(train, partial(_over, parameters), FIRST_FLOOR)
    rng = stream(parameters.seed, "intervals")
    surveys = []
    by_floor: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
    for times, over in zip(TIMES, zip(*flown, strict=True), strict=True):
        judged: dict[str, Any] = {}
        for name in METHODS:
            errors = 100 * np.stack([each.errors[name] for each in over])
            held = np.stack([each.held[name] for each in over])
            judged[name] = {
                "error_cm": mean_over_floors(errors, rng),
                "median_cm": float(np.median(errors)),
                "held": float(held.mean()),
            }
            by_floor[name].append(errors.mean(axis=1))
        apart = 100 * float(np.mean([each.apart for each in over]))
        lasted = float(np.mean([each.lasted for each in over]))
        surveys.append({
            "frames": times * parameters.survey, "lasted_s": lasted, "apart_cm": apart, **judged,
        })  # fmt: skip
    values = {"surveys": surveys, "floors": len(flown), "frames": parameters.frames}
    return parameters.record(train, values=values, series={"by_floor_cm": by_floor})


def _over(
    parameters: Parameters, seed: int, floor: Floor, camera: Camera, height: float
) -> list[_Over]:
    """The surveys of one floor, and one later flight."""
    if not parameters.floors:
        seed += 1000
    common: dict[str, Any] = {"floor": floor, "camera": camera, "height": height, "every": 2}
    with TemporaryDirectory(prefix="trexton-density-") as folder:
        later = record_flight(
            Path(folder) / "later", pattern="waypoints", frames=parameters.frames, seed=seed + 1,
            **common,
        )  # fmt: skip
        frames = frames_of(later)
        surveys = (
            record_flight(
                Path(folder) / f"survey-{times}", frames=times * parameters.survey, seed=seed,
                **common,
            )
            for times in TIMES
        )  # fmt: skip
        return [_surveyed(parameters, survey, frames, later.position, seed) for survey in surveys]


def _surveyed(
    parameters: Parameters, survey: Flight, frames: Sequence[np.ndarray], truth: np.ndarray,
    seed: int,
) -> _Over:  # fmt: skip
    """The later flight's frames with maps of one survey."""
    base = train_map(survey, n_textons=parameters.textons, rng=stream(parameters.seed, "training"))
    field = stream(parameters.seed, "map field")
    maps = {
        "paper": base,
        "field": for_method(base, "field", rng=field),
        "parts": for_method(counted(base, survey, parameters.cells), "field", rng=field),
    }
    errors, held = {}, {}
    for name, texton_map in maps.items():
        rng = stream(seed, f"density {name}")
        track = fly(Localizer(texton_map, samples=parameters.samples, rng=rng), frames)
        errors[name], held[name] = track.errors(truth), track.held(truth)
    places, _ = grid_cells(survey.area, PLACES)
    apart = float(cKDTree(survey.position).query(places)[0].mean())
    return _Over(errors, held, apart, float(survey.time[-1] - survey.time[0]))


def finding(record: Record) -> str:
    """What the experiment found, in three sentences."""
    short, *_, long = record.values["surveys"]
    near, far = (number(survey["apart_cm"]) for survey in (long, short))
    return (
        f"Surveyed for {number(short['lasted_s'])} s, a place lies {far} cm from the nearest frame "
        f"on average, and half of the frames of the field of whole images err by more than "
        f"{distance(short['field']['median_cm'])}, of that of their parts by more than "
        f"{distance(short['parts']['median_cm'])}; the 90 % regions hold "
        f"{percent(short['field']['held'])} and {percent(short['parts']['held'])} of the truth. "
        f"With closer lanes, in {number(long['lasted_s'])} s, the frame is {near} cm away, the "
        f"median errors are {distance(long['field']['median_cm'])} and "
        f"{distance(long['parts']['median_cm'])}, and the regions hold "
        f"{percent(long['field']['held'])} and {percent(long['parts']['held'])}. "
        f"The paper's filter goes from "
        f"{distance(short['paper']['median_cm'])} to {distance(long['paper']['median_cm'])}."
    )


def errors(record: Record) -> Figure:
    """Mean error over the distance to the nearest frame of the survey: all floors with their
    interval, and each of them alone.
    """
    surveys, by_floor = record.values["surveys"], record.series["by_floor_cm"]
    apart = np.array([survey["apart_cm"] for survey in surveys])
    with canvas(size=(6.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        for (method, label), mark, stroke in zip(METHODS.items(), "osD", "-:-", strict=True):
            color = COLORS[method if method in COLORS else "field"]
            if record.values["floors"] > 1:
                alone = np.array(by_floor[method])
                plot.plot(apart, alone, stroke, color=color, alpha=0.3, linewidth=0.8)
            entries = [survey[method]["error_cm"] for survey in surveys]
            with_intervals(plot, apart, entries, fmt=mark + stroke, color=color, label=label)
        plot.set(
            xlabel="mean distance to the nearest frame of the survey (cm)",
            ylabel="mean error (cm)", xlim=(0, None), ylim=(0, None),
        )  # fmt: skip
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
                "median": distance(survey[name]["median_cm"]),
                "90 % region holds": percent(survey[name]["held"]),
            }
            for survey in record.values["surveys"]
            for name, label in METHODS.items()
        ]
    )


EXPERIMENT = Experiment(
    "How densely to survey", Parameters, run, finding, needs=SURVEYED, cost_s=30
)
