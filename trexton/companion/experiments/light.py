"""Other light: what drifting exposure and another white balance cost each method.

All lights share one path over one floor, and all methods one map of the training flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.beyond import VARIANTS
from trexton.companion.experiments.declaration import SURVEYED, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.experiments.floors import lent_floor
from trexton.companion.experiments.style import COLORS, canvas, legend_above, with_intervals
from trexton.companion.experiments.track import fly
from trexton.companion.wording import apart, distance, interval, middle, percent
from trexton.evaluation.metrics import mean_with_interval
from trexton.flights.flight import Flight
from trexton.localization.base import Area
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method, with_choices
from trexton.simulator import Effects, Floor, Light, Plan, Simulator, random_waypoints
from trexton.vision.camera import Camera

DRIFTS = (0.0, 0.02, 0.05, 0.10)  # standard deviations of the camera's gain, as a share
WARMTHS = (0.0, 0.03, 0.06)  # shares by which red gains and blue loses
# variants of `trexton.companion.experiments.beyond` that are compared: label, colour, stroke
METHODS = {
    "paper": ("paper", COLORS["paper"], "o-"),
    "both": ("paper, agile", COLORS["paper"], "s--"),
    "field": ("field", COLORS["field"], "o-"),
}

LIGHTS = {"drift": "gain drifts by {:g} %", "warmth": "red gains and blue loses {:g} %"}
JUDGED = 0.05  # the drift that is compared with none


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    frames: int = option(80, "of every flight", low=2)
    speed: float = option(0.6, "of the vehicle, metres a second", low=0)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly one path over the floor of the training flight under one light after another.

    Parameters
    ----------
    train, test : Flight
        The map is trained on `train` and flown over the floor it carries; `test` is not used.

    Raises
    ------
    ParameterError
        The flight has no floor or camera.
    """
    lent = lent_floor(train)  # before anything is trained
    base, located = map_of(train, parameters), train.select(train.located)
    maps = {
        name: with_choices(
            for_method(base, VARIANTS[name].method, flight=located), VARIANTS[name].choices
        )
        for name in METHODS
    }
    lights = {f"drift {drift:g}": (drift, 0.0) for drift in DRIFTS}
    lights |= {f"warmth {warmth:g}": (0.0, warmth) for warmth in WARMTHS[1:]}
    errors: dict[str, dict[str, dict[str, float]]] = {}
    for label, (drift, warmth) in lights.items():
        frames, truth = _flight(train.area, lent, parameters, drift, Light(warmth=warmth))
        errors[label] = _errors(maps, frames, truth, parameters)
    still, moving = errors["drift 0"], errors[f"drift {JUDGED:g}"]
    values: dict[str, Any] = {
        "error_cm": errors,
        "ratio": {name: middle(moving[name]) / middle(still[name]) for name in METHODS},
        "frames": parameters.frames,
    }
    series = {
        "drift": DRIFTS,
        "warmth": WARMTHS,
        "by_drift_cm": {n: [errors[f"drift {drift:g}"][n] for drift in DRIFTS] for n in METHODS},
        "by_warmth_cm": {
            name: [still[name], *(errors[f"warmth {warmth:g}"][name] for warmth in WARMTHS[1:])]
            for name in METHODS
        },
    }
    return parameters.record(train, values=values, series=series)


def _flight(
    area: Area,
    lent: tuple[Floor, Camera, float],
    parameters: Parameters,
    drift: float,
    light: Light,
) -> tuple[list[np.ndarray], np.ndarray]:
    """Frames and ``(N, 2)`` positions of the path that all lights share."""
    floor, camera, height = lent
    plan_rng, simulator_rng = stream(parameters.seed, "light").spawn(2)
    plan = Plan(random_waypoints(area, plan_rng))
    effects = Effects(exposure=drift).without("jpeg")
    simulator = Simulator(
        floor, camera=camera, effects=effects, light=light, start=plan.start,
        height=height, speed=parameters.speed, rng=simulator_rng,
    )  # fmt: skip
    frames, places = [], np.empty((parameters.frames, 2))
    state = simulator.state
    for row in range(parameters.frames):
        state = simulator.step(plan.goal(state.position))
        frames.append(simulator.render())
        places[row] = state.position[:2]
    return frames, places


def _errors(
    maps: dict[str, TextonMap], frames: list[np.ndarray], truth: np.ndarray, parameters: Parameters
) -> dict[str, dict[str, float]]:
    """Mean error in cm of each method, with its interval over stretches of the flight."""
    found = {}
    for name, texton_map in maps.items():
        rng = stream(parameters.seed, f"light {name}")
        localizer = Localizer(texton_map, samples=parameters.samples, rng=rng)
        error_cm = 100 * fly(localizer, frames).errors(truth)
        found[name] = mean_with_interval(error_cm[None], stream(parameters.seed, "intervals"))
    return found


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    errors = record.values["error_cm"]
    still, moving = errors["drift 0"], errors[f"drift {JUDGED:g}"]

    def compared(method: str) -> str:
        words = f"{interval(moving[method], 'cm')}, without drift {interval(still[method], 'cm')}"
        chance = ", which may be the same but for chance"
        return words if apart(moving[method], still[method]) else words + chance

    return (
        f"Where the camera's gain drifts by {percent(JUDGED)}, the mean error of method field is "
        f"{compared('field')}; that of the paper's filter {compared('paper')}."
    )


def sweeps(record: Record) -> Figure:
    """Mean error of each method with its interval over the drift of the gain, and over the white
    balance.
    """
    series = record.series
    with canvas(1, 2, size=(7.2, 3.2), sharey=True) as (figure, axes):
        for plot, what, xlabel in (
            (axes[0, 0], "drift", "drift of the gain (%)"),
            (axes[0, 1], "warmth", "white balance (%)"),
        ):
            shares = 100 * np.array(series[what])
            for place, (name, errors) in enumerate(series[f"by_{what}_cm"].items()):
                label, color, stroke = METHODS[name]
                # beside one another, so that no bar hides another
                places = shares + 0.012 * (place - 1) * shares.max()
                with_intervals(
                    plot, places, errors, fmt=stroke, color=color, elinewidth=1, label=label
                )
            plot.set(xlabel=xlabel, ylim=(0, None))
        axes[0, 0].set_ylabel("mean error (cm)")
        legend_above(axes[0, 0], 3)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error of each method with its interval, a row for each light; the steady one first."""
    rows = [
        {"light": words.format(100 * share) if share else "steady"}
        | {METHODS[name][0]: distance(errors[i]) for name, errors in series.items()}
        for what, words in LIGHTS.items()
        for series in (record.series[f"by_{what}_cm"],)
        for i, share in enumerate(record.series[what])
        if share or what == "drift"
    ]
    return pd.DataFrame(rows)


EXPERIMENT = Experiment("Other light", Parameters, run, finding, needs=SURVEYED, cost_s=16)
