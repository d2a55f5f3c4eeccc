"""Landing that lands: the trigger asks where the vehicle will touch down.

Beyond the paper. Each flight is flown once, and all that are compared see its frames: the paper's
filter with the paper's trigger, and the methods beside it with one that predicts the touchdown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.defaults import SAMPLES
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.closed_loop import (
    ATTITUDE,
    Attempt,
    Lander,
    LandingParameters,
    Mission,
    fly_all,
)
from trexton.companion.experiments.declaration import SURVEYED, Experiment, option
from trexton.companion.experiments.evaluation import trained_map
from trexton.companion.experiments.floors import FloorParameters, painted_floor
from trexton.companion.experiments.style import COLORS, canvas, landed, share_over_time, zone_disc
from trexton.companion.experiments.triggered_landing import mission_over
from trexton.companion.wording import number, percent, span
from trexton.evaluation.metrics import euclidean, mean_over_groups, success_rate
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone, TouchdownZone
from trexton.localization.localizer import TextonMap
from trexton.localization.roles import make
from trexton.localization.training import for_method, train_map, with_parts
from trexton.simulator import record_flight


@dataclass(frozen=True)
class Entry:
    """One that lands: the words for it, its method (None knows the truth), its trigger, what the
    autopilot tells beside a frame, whether its map makes a velocity of the frames, and whether the
    survey took twice as long, in closer lanes.
    """

    label: str
    method: str | None
    trigger: str = "touchdown"
    aiding: tuple[str, ...] = ()
    odometry: bool = False
    longer: bool = False

    @property
    def map(self) -> tuple[str | None, bool, bool]:
        """Which map it flies with."""
        return self.method, self.odometry, self.longer


LANDERS = {
    "paper": Entry("The paper's filter and trigger", "paper", trigger="inside"),
    "field_inside": Entry("Field, the paper's trigger", "field", trigger="inside"),
    "field": Entry("Field, predicted touchdown", "field"),
    "field_longer": Entry("Field, twice the survey", "field", longer=True),
    "field_odometry": Entry(
        "Field and visual odometry", "field", aiding=(*ATTITUDE, "height"), odometry=True
    ),
    "odometry_longer": Entry(
        "Field, odometry, twice the survey",
        "field",
        aiding=(*ATTITUDE, "height"),
        odometry=True,
        longer=True,
    ),
    "fine": Entry("Coarse to fine", "fine", aiding=ATTITUDE),
    "truth": Entry("The true position", None),
}
FIRST_FLOOR = 600  # seed of the first painted floor; no setting was chosen on these
# What may be asked of a touchdown at first and at last.
CHANCES = ((0.8, 0.6), (0.9, 0.6), (0.9, 0.8), (0.95, 0.8), (0.95, 0.95), (0.99, 0.99))


@dataclass(frozen=True)
class Parameters(LandingParameters, FloorParameters):
    """What can be chosen."""

    survey: int = option(
        800, "frames of the survey of each painted floor, half those of the longer one", low=50
    )
    flights: int = option(2, "flights over each floor", low=1)
    bounds: int = option(
        20, "flights of the true position, which show what asking for more costs", low=1
    )
    samples: int = option(SAMPLES, "patches drawn from an image", low=1)
    textons: int = option(50, "textons of the field; the paper's filter has its 20", low=2)
    cells: int = option(2, "parts of the image a side for the field", low=1, high=8)
    settled_s: float = option(
        1.5, "seconds without a jump of the estimate before a predicted touchdown", low=0
    )
    attitude_deg: float = option(0.3, "noise of the autopilot's attitude in degrees", low=0)


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
        over = [(train.name, _over(train, parameters, parameters.seed, parameters.seed))]
    flown = {name: [trial[name] for _, trial in over] for name in LANDERS}
    radius = parameters.radius
    return parameters.record(
        train,
        values={
            "landers": {name: _summary(trials, radius) for name, trials in flown.items()},
            "floors": {
                floor: {name: _counts(attempts, radius) for name, attempts in trial.items()}
                for floor, trial in over
            },
            "passed": _passed(flown["truth"]),
            "bounds": _bounds(train, parameters),
        },
        series={name: _series(_joined(trials), radius) for name, trials in flown.items()},
    )


def _over_painted(parameters: Parameters, index: int) -> tuple[str, dict[str, list[Attempt]]]:
    """Survey one painted floor, and fly over it."""
    seed = FIRST_FLOOR + index
    name, floor = painted_floor(index, seed)
    with TemporaryDirectory(prefix="trexton-touchdown-") as folder:
        survey = record_flight(
            Path(folder) / name.replace(" ", "-"), seed=seed, floor=floor, frames=parameters.survey
        )
        return name, _over(survey, parameters, parameters.seed + 1000 * seed, seed)


def _over(
    train: Flight, parameters: Parameters, seed: int, survey_seed: int
) -> dict[str, list[Attempt]]:
    """The attempts of all landers over one floor."""
    mission = mission_over(train, parameters, seed=seed, attitude_deg=parameters.attitude_deg)
    maps = _maps(train, mission, parameters, survey_seed)
    zones: dict[str, Callable[[np.ndarray], LandingZone]] = {
        "inside": partial(LandingZone, radius=parameters.radius),
        "touchdown": _touchdown(parameters),
    }
    landers = {
        name: Lander(
            maps[entry.map],
            zones[entry.trigger],
            {"samples": parameters.samples},
            entry.aiding,
        )
        for name, entry in LANDERS.items()
    }
    return fly_all(mission, landers, parameters.flights)


def _touchdown(parameters: Parameters, **chances: Any) -> Callable[[np.ndarray], LandingZone]:
    """A trigger on the predicted touchdown around a centre, asking for its own chances or these."""
    return partial(
        TouchdownZone,
        radius=parameters.radius,
        time_limit=parameters.time_limit,
        settled_s=parameters.settled_s,
        **chances,
    )


def _bounds(train: Flight, parameters: Parameters) -> list[dict[str, Any]]:
    """What the true position lands, by the chances it asks for; flights that no other flies."""
    mission = mission_over(train, parameters, seed=parameters.seed + 1)
    landers = {
        f"{first} {last}": Lander(
            None,
            _touchdown(parameters, confidence=first, least=last),
        )
        for first, last in CHANCES
    }
    flown = fly_all(mission, landers, parameters.bounds)
    return [
        {"confidence": first, "least": last, **_summary([attempts], parameters.radius)}
        for (first, last), attempts in zip(CHANCES, flown.values(), strict=True)
    ]


def _maps(
    train: Flight, mission: Mission, parameters: Parameters, seed: int
) -> dict[tuple[str | None, bool, bool], TextonMap | None]:
    """By method, whether it makes a velocity of the frames, and whether the survey took twice as
    long.
    """
    rng = stream(parameters.seed, "training")
    paper = trained_map(train, seed=parameters.seed)
    with TemporaryDirectory(prefix="trexton-touchdown-") as folder:
        longer = record_flight(
            Path(folder) / "longer", seed=seed, frames=2 * parameters.survey, floor=mission.floor,
            camera=mission.camera, height=mission.height,
        )  # fmt: skip
        field = _field(train, parameters, rng)
        fine = for_method(paper, "fine", flight=train, rng=rng)
        denser = _field(longer, parameters, rng)
        odometry = {"odometry": make("odometry", "visual")}
        return {
            (None, False, False): None,
            ("paper", False, False): paper,
            ("field", False, False): field,
            ("field", True, False): with_parts(field, odometry, flight=train),
            ("field", False, True): denser,
            ("field", True, True): with_parts(denser, odometry, flight=longer),
            ("fine", False, False): fine,
        }


def _field(survey: Flight, parameters: Parameters, rng: np.random.Generator) -> TextonMap:
    """A trigger needs the velocity's covariance as it is: accelerations as they were flown."""
    agility: dict[str, Any] = {"motion.agility": 1.0}
    return train_map(
        survey, method="field", n_textons=parameters.textons, cells=parameters.cells, rng=rng,
        **agility,
    )  # fmt: skip


def _distances(attempts: list[Attempt], place: str) -> np.ndarray:
    """``(N,)`` metres from the zone's centre; NaN where nothing was triggered."""
    places = np.array([getattr(attempt, place) for attempt in attempts])
    return euclidean(places, np.array([attempt.zone for attempt in attempts]))


def _counts(attempts: list[Attempt], radius: float) -> dict[str, int]:
    """Flights, landings, and landings inside."""
    return {
        "attempts": len(attempts),
        "landings": sum(attempt.triggered for attempt in attempts),
        "inside": int((_distances(attempts, "touchdown") <= radius).sum()),
    }


def _passed(trials: Sequence[list[Attempt]]) -> dict[str, Any] | None:
    """Share of the flights, the same for all landers, that come over their zone at all."""
    passed = [sum(each.passed for each in trial) for trial in trials]
    return _rate(passed, [len(trial) for trial in trials])


def rates(floors: Sequence[Mapping[str, int]]) -> dict[str, Any]:
    """Three rates with 95 % intervals, of the counts over each of the floors.

    Flights over one floor are alike in what it is like, and stand together. Over a single floor
    nothing is said about others, and its flights are independent.
    """
    attempts, landings, inside = (
        [floor[name] for floor in floors] for name in ("attempts", "landings", "inside")
    )
    return {
        "landed_rate": _rate(landings, attempts),
        "inside_rate": _rate(inside, landings),
        "inside_of_flights": _rate(inside, attempts),
    }


def _rate(successes: list[int], trials: list[int]) -> dict[str, Any] | None:
    """Of counts by floor; flights over a single one are independent."""
    return success_rate(successes, trials) if len(trials) > 1 else success_rate(*successes, *trials)


def gain(record: Record, name: str, than: str) -> dict[str, float | None]:
    """By how much more of its flights one lander comes down inside than another, floor by floor,
    with its 95 % interval over floors.
    """
    gains = []
    for floor in record.values["floors"].values():
        share, other = (floor[who]["inside"] / floor[who]["attempts"] for who in (name, than))
        gains.append(share - other)
    return mean_over_groups(gains, lowest=-1.0, highest=1.0)


def _summary(trials: Sequence[list[Attempt]], radius: float) -> dict[str, Any]:
    """Of one lander's attempts over each floor: counts, rates, when it fired and how far off."""
    attempts = _joined(trials)
    landed = [attempt for attempt in attempts if attempt.triggered]
    error = [100 * np.hypot(*(attempt.estimate - attempt.truth)) for attempt in landed]
    return {
        **_counts(attempts, radius),
        **rates([_counts(trial, radius) for trial in trials]),
        "wait_s": float(np.median([attempt.wait_s for attempt in landed])) if landed else None,
        "trigger_error_cm": float(np.median(error)) if landed else None,
    }


def _joined(trials: Sequence[list[Attempt]]) -> list[Attempt]:
    return [attempt for trial in trials for attempt in trial]


def _series(attempts: list[Attempt], radius: float) -> dict[str, Any]:
    """What the figures draw, about the zone's centre, in the resolution of millimetres."""
    offset = np.array([attempt.touchdown - attempt.zone for attempt in attempts])
    return {
        "touchdown_m": np.round(offset, 3),
        "wait_s": [round(attempt.wait_s, 2) for attempt in attempts],
        "triggered": [attempt.triggered for attempt in attempts],
        "radius_m": radius,
    }


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    parts = []
    for name in ("field", "odometry_longer", "fine", "paper"):
        label, values = LANDERS[name].label, record.values["landers"][name]
        inside = (
            f"{percent(values['inside_rate'])} inside" if values["inside_rate"] else "none inside"
        )
        parts.append(
            f"{label[0].lower()}{label[1:]}: {values['landings']} of {values['attempts']} flights "
            f"landed, {inside}"
        )
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


_LINES = {
    "paper": (COLORS["paper"], "-"),
    "field_inside": (COLORS["field"], ":"),
    "field": (COLORS["field"], "-"),
    "field_longer": (COLORS["field"], "-."),
    "field_odometry": (COLORS["field"], "--"),
    "odometry_longer": (COLORS["field"], (0, (5, 1, 1, 1, 1, 1))),
    "fine": (COLORS["fine"], "-"),
    "truth": (COLORS["truth"], "--"),
}
_MARKERS = {
    "field": "o",
    "field_longer": "p",
    "field_odometry": "s",
    "odometry_longer": "D",
    "fine": "^",
}


def targets(record: Record) -> Figure:
    """Where each touched down, about the centre of its zone."""
    places = {
        name: np.array(record.series[name]["touchdown_m"], dtype=float).reshape(-1, 2)
        for name in LANDERS
    }
    radius = record.parameters["radius"]
    reach = max(1.2 * radius, *(np.nanmax(np.abs(place), initial=0) for place in places.values()))
    limits = (-1.08 * reach, 1.08 * reach)
    with canvas(2, 4, size=(7.2, 4.8), sharex=True, sharey=True) as (figure, grid):
        for axes, (name, place) in zip(grid.flat, places.items(), strict=True):
            zone_disc(axes, radius)
            inside = np.hypot(*place.T) <= radius
            missed = ~inside & np.isfinite(place[:, 0])
            landed(axes, place[inside], _LINES[name][0], "inside the zone")
            landed(axes, place[missed], _LINES[name][0], "outside", inside=False)
            axes.set_title(fill(LANDERS[name].label, 20), fontsize=8.5)
            axes.set(xlim=limits, ylim=limits, aspect="equal")
        keys = [landed(grid[0, 0], np.empty((0, 2)), COLORS["zone"], word, inside=within)
                for word, within in (("inside the zone", True), ("outside", False))]  # fmt: skip
        figure.legend(handles=keys, loc="outside upper center", ncols=2)
        figure.supxlabel("x from the zone's centre (m)")
        figure.supylabel("y from the zone's centre (m)")
    return figure


def waiting(record: Record) -> Figure:
    """Share of the flights that have landed, over time."""
    limit = record.parameters["time_limit"]
    with canvas(size=(7.2, 3.0)) as (figure, axes):
        plot = axes[0, 0]
        for name, (color, style) in _LINES.items():
            series: dict[str, Any] = record.series[name]
            fired = np.array(series["triggered"], dtype=bool)
            share_over_time(
                plot, np.array(series["wait_s"])[fired], len(fired), limit, color=color,
                linestyle=style, label=LANDERS[name].label,
            )  # fmt: skip
        plot.set(xlabel="time of flight (s)", ylabel="triggered (% of flights)")
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def bounds(record: Record) -> Figure:
    """Landings inside against flights landed, for the chances the true position may ask for, and
    for each method.
    """
    with canvas(size=(7.2, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        asked = [each for each in record.values["bounds"] if each["inside_rate"]]
        landed_at, inside_at = _rates(plot, asked, COLORS["truth"])
        plot.plot(landed_at, inside_at, color=COLORS["truth"], linestyle="--",
                  label="The true position, by what it asks for")  # fmt: skip
        for number, (each, *place) in enumerate(zip(asked, landed_at, inside_at, strict=True)):
            above = number % 2 == 0  # neighbours' words do not meet
            plot.annotate(f"{each['confidence']} to {each['least']}", place,
                          (4, 4) if above else (-4, -9), ha="left" if above else "right",
                          textcoords="offset points", fontsize=7)  # fmt: skip
        for name, marker in _MARKERS.items():
            values = record.values["landers"][name]
            if values["inside_rate"]:
                x, y = _rates(plot, [values], _LINES[name][0])
                plot.plot(x, y, marker, color=_LINES[name][0], label=LANDERS[name].label)
        plot.set(xlabel="landed (% of flights)", ylabel="inside (% of landings)")
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def _rates(plot: Axes, summaries: list[dict[str, Any]], color: str) -> list[list[float]]:
    """Flights landed and landings inside, per cent, their intervals drawn."""
    places = []
    for rates in ([each[key] for each in summaries] for key in ("landed_rate", "inside_rate")):
        middle = [100 * rate["value"] for rate in rates]
        reach = [[100 * abs(rate[end] - rate["value"]) for rate in rates]
                 for end in ("low", "high")]  # fmt: skip
        places.append((middle, reach))
    (x, across), (y, along) = places
    plot.errorbar(x, y, along, across, fmt="none", color=color, alpha=0.35, linewidth=0.8)
    return [x, y]


def table(record: Record) -> pd.DataFrame:
    """For each lander: flights, landings, inside, and the rates of both denominators."""
    rows = []
    for name, entry in LANDERS.items():
        values = record.values["landers"][name]
        rows.append(
            {
                "": entry.label,
                "flights": values["attempts"],
                "landed": values["landings"],
                "inside": values["inside"],
                "landed, of flights (%)": _percent(values["landed_rate"]),
                "inside, of landings (%)": _percent(values["inside_rate"]),
                "inside, of flights (%)": _percent(values["inside_of_flights"]),
                "wait (s)": _number(values["wait_s"]),
                "off at the trigger (cm)": _number(values["trigger_error_cm"]),
            }
        )
    return pd.DataFrame(rows)


def _percent(rate: dict[str, float] | None) -> str:
    if rate is None:
        return ""
    return span({key: 100 * value for key, value in rate.items()})


def _number(value: float | None) -> str:
    return "" if value is None else number(value)


EXPERIMENT = Experiment("Landing that lands", Parameters, run, finding, needs=SURVEYED, cost_s=60)
