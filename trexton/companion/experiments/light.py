"""Other light: what another brightness, white balance or drifting exposure costs each method.

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
from trexton.companion.experiments.declaration import SURVEYED, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.experiments.floors import lent_floor
from trexton.companion.experiments.style import COLORS, canvas, with_intervals
from trexton.companion.experiments.track import fly
from trexton.companion.wording import apart, distance, middle
from trexton.evaluation.metrics import mean_with_interval
from trexton.flights.flight import Flight
from trexton.localization.base import Area
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method, with_choices
from trexton.simulator import Effects, Floor, Light, Plan, Simulator, random_waypoints
from trexton.vision.camera import Camera

# Shares, of what differs from the light of the survey: how it differs, in words.
LIGHTS = {
    "drift": (0.0, 0.02, 0.05, 0.10),
    "gain": (-0.2, -0.1, 0.0, 0.1, 0.2),
    "warmth": (-0.06, -0.03, 0.0, 0.03, 0.06),
}
WORDS = {
    "drift": "gain drifts by {:g} %",
    "gain": "gain {:+g} %",
    "warmth": "red {:+g} %, blue the other way",
}
# label, colour, stroke, method, choices
METHODS: dict[str, tuple[str, str, str, str, dict[str, object]]] = {
    "paper": ("paper", COLORS["paper"], "o-", "paper", {}),
    "unadapted": (
        "field, light not followed", COLORS["field"], "s--", "field", {"appearance": "none"},
    ),
    "field": ("field", COLORS["field"], "o-", "field", {}),
}  # fmt: skip

JUDGED = "gain -0.2"  # the light that is compared with that of the survey


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
        name: with_choices(for_method(base, method, flight=located), choices)
        for name, (*_, method, choices) in METHODS.items()
    }
    errors: dict[str, dict[str, dict[str, float]]] = {}
    for what, shares in LIGHTS.items():
        for share in shares:
            drift = share if what == "drift" else 0.0
            gain, warmth = (share if what == each else 0.0 for each in ("gain", "warmth"))
            light = Light(gain=1 + gain, warmth=warmth)
            frames, truth = _flight(train.area, lent, parameters, drift, light)
            errors[f"{what} {share:g}"] = _errors(maps, frames, truth, parameters)
    still, changed = errors["drift 0"], errors[JUDGED]
    values: dict[str, Any] = {
        "error_cm": errors,
        "ratio": {name: middle(changed[name]) / middle(still[name]) for name in METHODS},
        "frames": parameters.frames,
    }
    series = {
        f"by_{what}_cm": {n: [errors[f"{what} {share:g}"][n] for share in shares] for n in METHODS}
        for what, shares in LIGHTS.items()
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
    """What the experiment found, in two sentences."""
    errors = record.values["error_cm"]
    still, changed = errors["drift 0"], errors[JUDGED]

    def compared(method: str) -> str:
        same = "" if apart(changed[method], still[method]) else ", the same but for chance"
        before, now = (distance(middle(errors[method])) for errors in (still, changed))
        return f"{now} instead of {before}{same}"

    return (
        f"Where the light is a fifth dimmer, the mean error of method field is "
        f"{compared('field')}. That of the paper's filter is {compared('paper')}."
    )


def sweeps(record: Record) -> Figure:
    """Mean error of each method with its interval over the drift of the gain, the gain, and the
    white balance.
    """
    labels = {"drift": "drift of the gain (%)", "gain": "gain (%)", "warmth": "white balance (%)"}
    with canvas(1, 3, size=(9.0, 3.2), sharey=True) as (figure, axes):
        for plot, (what, xlabel) in zip(axes[0], labels.items(), strict=True):
            shares = 100 * np.array(LIGHTS[what])
            for place, (name, errors) in enumerate(record.series[f"by_{what}_cm"].items()):
                label, color, stroke, *_ = METHODS[name]
                # beside one another, so that no bar hides another
                places = shares + 0.012 * (place - 1) * np.ptp(shares)
                with_intervals(
                    plot, places, errors, fmt=stroke, color=color, elinewidth=1, label=label
                )
            plot.set_xlabel(xlabel)
        axes[0, 0].set(ylabel="mean error (cm)", yscale="log")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error of each method with its interval, a row for each light."""
    rows = [
        {"light": WORDS[what].format(100 * share)}
        | {METHODS[name][0]: distance(errors[i]) for name, errors in series.items()}
        for what, shares in LIGHTS.items()
        for series in (record.series[f"by_{what}_cm"],)
        for i, share in enumerate(shares)
        if share or what == "drift"
    ]
    return pd.DataFrame(rows)


EXPERIMENT = Experiment("Other light", Parameters, run, finding, needs=SURVEYED, cost_s=16)
