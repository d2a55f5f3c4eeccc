"""Landing that lands: the trigger asks where the vehicle will touch down.

Beyond the paper. Each flight is flown once, and all that are compared see its frames: the paper's
filter with the paper's trigger, and the methods beside it with one that predicts the touchdown.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from trexton.base.defaults import SAMPLES
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SURVEYED, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.experiments.floors import FloorParameters, painted_floor, scratch_folder
from trexton.companion.experiments.landings import (
    ATTITUDE,
    Attempt,
    Lander,
    LandingParameters,
    distances,
    fly_all,
    landed,
    mission_over,
    zone_ring,
)
from trexton.companion.experiments.rates import success_rate
from trexton.companion.experiments.style import COLORS, canvas
from trexton.companion.wording import number, percent
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone, TouchdownZone
from trexton.localization.localizer import TextonMap
from trexton.localization.methods import make
from trexton.localization.training import for_method, train_map, with_parts
from trexton.simulator.recording import record_flight


class Entry(NamedTuple):
    """One that lands: the words for it, which of the maps it flies with (``truth`` knows where it
    is), its trigger, and what the autopilot tells beside a frame.
    """

    label: str
    map: str
    trigger: str = "touchdown"
    aiding: tuple[str, ...] = ()


LANDERS = {
    "paper": Entry("The paper's filter and trigger", "paper", "inside"),
    "field_inside": Entry("Field, the paper's trigger", "field", "inside"),
    "field": Entry("Field, predicted touchdown", "field"),
    "field_odometry": Entry("Field and visual odometry", "odometry", aiding=(*ATTITUDE, "height")),
    "fine": Entry("Method fine", "fine", aiding=ATTITUDE),
    "truth": Entry("The true position", "truth"),
}
CELLS = 2  # parts of the image a side for the field
FIRST_FLOOR = 600  # seed of the first painted floor; no setting was chosen on these


@dataclass(frozen=True)
class Parameters(LandingParameters, FloorParameters):
    """What can be chosen."""

    survey: int = option(800, "frames of the survey of each painted floor", low=50)
    flights: int = option(2, "flights over each floor", low=1)
    samples: int = option(SAMPLES, "patches drawn from an image", low=1)
    textons: int = option(50, "textons of the field; the paper's filter has its 20", low=2)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly at random and land, over the flight's floor or over painted ones with a survey each.

    Parameters
    ----------
    train, test : Flight
        The map is trained on `train`, and flown over the floor it carries, unless there are floors
        to paint. Of `test` nothing is used.
    """
    if parameters.floors:
        over = spread(partial(_over_painted, parameters), range(parameters.floors), "floors")
    else:
        over = [(train.name, _over(train, parameters, parameters.seed))]
    flown = {name: [trial[name] for _, trial in over] for name in LANDERS}
    return parameters.record(
        train,
        values={
            "landers": {name: _summary(trials, parameters) for name, trials in flown.items()},
            "floors": {
                floor: {name: _counts(attempts, parameters) for name, attempts in trial.items()}
                for floor, trial in over
            },
        },
        # About the zone's centre, in the resolution of millimetres.
        series={
            name: {"touchdown_m": np.round([a.touchdown - a.zone for a in sum(trials, [])], 3)}
            for name, trials in flown.items()
        },
    )


def _over_painted(parameters: Parameters, index: int) -> tuple[str, dict[str, list[Attempt]]]:
    """Survey one painted floor, and fly over it."""
    seed = FIRST_FLOOR + index
    name, floor = painted_floor(index, seed)
    with scratch_folder("touchdown") as folder:
        survey = record_flight(
            folder / name.replace(" ", "-"), seed=seed, floor=floor, frames=parameters.survey
        )
        return name, _over(survey, parameters, parameters.seed + 1000 * seed)


def _over(train: Flight, parameters: Parameters, seed: int) -> dict[str, list[Attempt]]:
    """The attempts of all landers over one floor."""
    mission = mission_over(train, parameters, seed=seed)
    maps = _maps(train, parameters)
    zones: dict[str, Callable[[np.ndarray], LandingZone]] = {
        "inside": partial(LandingZone, radius=parameters.radius),
        "touchdown": partial(
            TouchdownZone, radius=parameters.radius, time_limit=parameters.time_limit
        ),
    }
    options = {"samples": parameters.samples}
    landers = {
        name: Lander(maps.get(entry.map), zones[entry.trigger], options, entry.aiding)
        for name, entry in LANDERS.items()
    }
    return fly_all(mission, landers, parameters.flights)


def _maps(train: Flight, parameters: Parameters) -> dict[str, TextonMap]:
    """Of one survey. A trigger needs the velocity's covariance as it is, so the field takes
    accelerations as they were flown.
    """
    rng = stream(parameters.seed, "training")
    agility: dict[str, Any] = {"motion.agility": 1.0}
    paper = map_of(train, MapParameters(parameters.seed))
    field = train_map(
        train, method="field", n_textons=parameters.textons, cells=CELLS, rng=rng, **agility
    )
    return {
        "paper": paper,
        "field": field,
        "odometry": with_parts(field, {"odometry": make("odometry", "visual")}, flight=train),
        "fine": for_method(paper, "fine", flight=train, rng=rng),
    }


def _counts(attempts: list[Attempt], parameters: Parameters) -> dict[str, int]:
    """Flights, landings, and landings inside."""
    return {
        "attempts": len(attempts),
        "landings": sum(attempt.triggered for attempt in attempts),
        "inside": int((distances(attempts, "touchdown") <= parameters.radius).sum()),
    }


def rates(floors: Sequence[Mapping[str, int]]) -> dict[str, Any]:
    """Three rates with 95 % intervals, of the counts over each of the floors.

    Flights over one floor are alike in what it is like, and stand together. Over a single floor
    nothing is said about others, and its flights are independent.
    """

    def rate(name: str, of: str) -> dict[str, Any] | None:
        counts, trials = ([floor[key] for floor in floors] for key in (name, of))
        alone = len(floors) == 1
        return success_rate(counts[0], trials[0]) if alone else success_rate(counts, trials)

    return {
        "landed_rate": rate("landings", "attempts"),
        "inside_rate": rate("inside", "landings"),
        "inside_of_flights": rate("inside", "attempts"),
    }


def _summary(trials: Sequence[list[Attempt]], parameters: Parameters) -> dict[str, Any]:
    """Of one lander's attempts over each floor: counts, rates, when it fired and how far off."""
    attempts: list[Attempt] = sum(trials, [])
    landed = [attempt for attempt in attempts if attempt.triggered]
    error = [100 * np.hypot(*(attempt.estimate - attempt.truth)) for attempt in landed]
    return {
        **_counts(attempts, parameters),
        **rates([_counts(trial, parameters) for trial in trials]),
        "wait_s": float(np.median([attempt.wait_s for attempt in landed])) if landed else None,
        "trigger_error_cm": float(np.median(error)) if landed else None,
    }


def finding(record: Record) -> str:
    """What the experiment found, of all flights."""
    landers = record.values["landers"]
    inside = {
        name: percent(landers[name]["inside"] / landers[name]["attempts"]) for name in LANDERS
    }
    return (
        f"Of {landers['truth']['attempts']} flights the field brings {inside['field']} inside the "
        f"zone by the predicted touchdown, and {inside['field_inside']} by the paper's trigger. "
        f"With visual odometry it is {inside['field_odometry']}, with `fine` {inside['fine']}, "
        f"with the true position {inside['truth']}. The paper's filter and trigger bring "
        f"{inside['paper']}."
    )


def targets(record: Record) -> Figure:
    """Where each touched down, about the centre of its zone."""
    radius, most = record.parameters["radius"], 0.0
    with canvas(2, 3, size=(7.2, 5.6), sharex=True, sharey=True) as (figure, grid):
        for axes, (name, entry) in zip(grid.flat, LANDERS.items(), strict=True):
            places = np.array(record.series[name]["touchdown_m"], dtype=float).reshape(-1, 2)
            places = places[np.isfinite(places[:, 0])]
            most = max(most, np.abs(places).max(initial=radius))
            axes.add_patch(Circle((0, 0), radius, color=COLORS["zone"], alpha=0.22, lw=0))
            zone_ring(axes, (0, 0), radius)
            inside = np.hypot(*places.T) <= radius
            for within, rows in ((True, inside), (False, ~inside)):
                color = COLORS.get(entry.map, COLORS["field"])
                landed(axes, places[rows], color, "", inside=within)
            words = f"{entry.label}: {inside.sum()} of {len(inside)} inside"
            axes.set_title(fill(words, 24), fontsize=8.5)
            axes.set_aspect("equal")
        limits = (-1.08 * most, 1.08 * most)
        grid[0, 0].set(xlim=limits, ylim=limits)
        figure.supxlabel("x from the zone's centre (m)")
        figure.supylabel("y from the zone's centre (m)")
    return figure


def table(record: Record) -> pd.DataFrame:
    """For each lander its rates, when it fired and how far off it was."""
    rows = []
    for name, entry in LANDERS.items():
        values = record.values["landers"][name]
        row = {
            "": entry.label,
            "inside, of flights": percent(values["inside_of_flights"]),
            "inside, of landings": percent(values["inside_rate"]),
            "landed, of flights": percent(values["landed_rate"]),
            "wait (s)": number(values["wait_s"]),
            "off at the trigger (cm)": number(values["trigger_error_cm"]),
        }
        rows.append(row)
    return pd.DataFrame(rows)


EXPERIMENT = Experiment("Predicted touchdown", Parameters, run, finding, needs=SURVEYED, cost_s=40)
