"""Triggered landing in closed loop (paper, Analysis, "Triggered Landing").

The vehicle flies at random until the paper's filter believes it in the zone, and then comes down;
the same flights with the true position show what landing itself costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import SURVEYED, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import floor_picture, map_of
from trexton.companion.experiments.landings import (
    Attempt,
    Lander,
    LandingParameters,
    distances,
    fly_all,
    landed,
    mission_over,
    on_target,
    target_limits,
    zone_ring,
)
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.style import COLORS, canvas, floor_axes, legend_below, show_floor
from trexton.companion.wording import percent
from trexton.evaluation.metrics import bootstrap_interval, success_rate
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone

PAPER_LANDINGS, PAPER_INSIDE = 6, 4


@dataclass(frozen=True)
class Parameters(MapParameters, LandingParameters):
    """What can be chosen."""

    landings: int = option(16, "attempts, each with another zone, path, wind and start", low=1)
    spread: float = option(0.6, "theta: standard deviation in metres that still lands", low=0)
    consecutive: int = option(1, "estimates in a row that must agree", low=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        LandingZone((0, 0), self.radius, self.spread, self.consecutive)  # refuses the rest


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Land wherever the localizer says that the vehicle is in the zone, over and over.

    Parameters
    ----------
    train, test : Flight
        The map is trained on `train`, and flown over the floor it carries. Of `test` nothing is
        used: the virtual camera takes its place, under the light of an hour later.

    Raises
    ------
    ParameterError
        The flight has no floor or camera, or the area is too small for the zone.
    """
    mission = mission_over(train, parameters, seed=parameters.seed)
    zone = partial(
        LandingZone,
        radius=parameters.radius,
        spread=parameters.spread,
        consecutive=parameters.consecutive,
    )
    options = {name: getattr(parameters, name) for name in ("samples", "particles", "neighbors")}
    paper = Lander(map_of(train, parameters), zone, options)
    flown = fly_all(mission, {"paper": paper, "perfect": Lander(None, zone)}, parameters.landings)
    floor, pictures = floor_picture(train)
    return parameters.record(
        train,
        values=summarize_attempts(flown["paper"], parameters)
        | {"perfect": summarize_attempts(flown["perfect"], parameters)},
        series=_series(flown["paper"], parameters) | {"area_m": train.area} | floor,
        images=pictures,
    )


def summarize_attempts(attempts: list[Attempt], parameters: LandingParameters) -> dict[str, Any]:
    """Rates with 95 % intervals, distances beyond the circle, waiting times, what a miss is of."""
    done = [attempt for attempt in attempts if attempt.triggered]
    beyond = 100 * (distances(attempts, "touchdown") - parameters.radius)
    outliers = np.sort(beyond[beyond > 0])
    first, early = attempts[:PAPER_LANDINGS], beyond[:PAPER_LANDINGS]
    triggered_inside = int((distances(attempts, "truth") <= parameters.radius).sum())
    return {
        "attempts": len(attempts),
        "landings": len(done),
        "never_triggered": len(attempts) - len(done),
        "inside": len(done) - len(outliers),
        "inside_rate": success_rate(len(done) - len(outliers), len(done)),
        "triggered_inside_rate": success_rate(triggered_inside, len(done)),
        "outliers_cm": outliers,
        "outlier_mean_cm": _mean(outliers, stream(parameters.seed, "intervals")),
        "first_flights": {
            "attempts": len(first),
            "landings": sum(attempt.triggered for attempt in first),
            "inside": int((early <= 0).sum()),
            "outliers_cm": early[early > 0],
        },
        "wait_s": _quantiles([attempt.wait_s for attempt in attempts]),
        "trigger_error_cm": _quantiles(
            [100 * np.hypot(*(attempt.estimate - attempt.truth)) for attempt in done]
        ),
        "lag_cm": _quantiles([_lag(attempt) for attempt in done]),
        "drift_cm": _quantiles(
            [100 * np.hypot(*(attempt.touchdown - attempt.truth)) for attempt in done]
        ),
    }


def _lag(attempt: Attempt) -> float:
    """How far in cm the estimate trails the vehicle at the trigger, along the way it flies."""
    return float(
        100 * (attempt.truth - attempt.estimate) @ attempt.velocity / np.hypot(*attempt.velocity)
    )


def _mean(values: np.ndarray, rng: np.random.Generator) -> dict[str, Any] | None:
    """Mean and its 95 % bootstrap interval."""
    if not len(values):
        return None
    means = values[rng.integers(len(values), size=(2000, len(values)))].mean(axis=1)
    low, high = bootstrap_interval(means, len(values), block=1)
    return {"value": values.mean(), "low": low, "high": high}


def _quantiles(values: list[float]) -> dict[str, Any] | None:
    if not values:
        return None
    return dict(zip(("p10", "median", "p90"), np.percentile(values, (10, 50, 90)), strict=True))


def _series(attempts: list[Attempt], parameters: LandingParameters) -> dict[str, Any]:
    """What the figures draw; paths in millimetres' resolution, of the first attempts only."""
    columns = {
        f"{name}_m": np.array([getattr(a, name) for a in attempts])
        for name in ("zone", "estimate", "truth", "touchdown")
    }
    return columns | {
        "triggered": [attempt.triggered for attempt in attempts],
        "wait_s": [attempt.wait_s for attempt in attempts],
        "beyond_cm": 100 * (distances(attempts, "touchdown") - parameters.radius),
        "paths_m": [np.round(attempt.path, 3) for attempt in attempts[:PAPER_LANDINGS]],
        "radius_m": parameters.radius,
    }


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    if not values["landings"]:
        return f"None of {values['attempts']} flights triggered a landing."
    text = (
        f"{values['inside']} of {values['attempts']} flights ended inside the zone. "
        f"{values['landings'] - values['inside']} landed beside it, and "
        f"{values['never_triggered']} never triggered."
    )
    if values["perfect"]["landings"]:
        text += f" The true position would have brought {values['perfect']['inside']} inside."
    return (
        f"{text} The paper had {PAPER_INSIDE} of {PAPER_LANDINGS} landings inside, the first "
        f"{PAPER_LANDINGS} flights here {values['first_flights']['inside']}."
    )


def first_flights(record: Record) -> Figure:
    """The first flights from above, as many as the paper's: path, zone, trigger and touchdown."""
    series = record.series
    truth, estimate, touchdown = (
        np.array(series[f"{name}_m"], dtype=float) for name in ("truth", "estimate", "touchdown")
    )
    count = len(series["paths_m"])
    columns = min(3, count)
    rows = -(-count // columns)
    size = (2.6 * columns, 2.75 * rows + 0.3)
    entries: dict[str, Artist] = {}  # one legend for all panels, each entry once
    with canvas(rows, columns, size=size, sharex=True, sharey=True) as (figure, grid):
        for axes in grid.flat[count:]:
            axes.axis("off")
        for number, axes in enumerate(grid.flat[:count]):
            floor_axes(axes, series["area_m"])
            show_floor(axes, series.get("floor"), record.images.get("floor"), fade=0.3)
            axes.plot(
                *np.array(series["paths_m"][number]).T, color=COLORS["truth"], lw=1.1, label="flown"
            )
            zone_ring(axes, series["zone_m"][number], series["radius_m"], label="zone")
            beyond = series["beyond_cm"][number]
            outcome = "never triggered"
            axes.label_outer()
            if series["triggered"][number]:
                outcome = "inside" if beyond <= 0 else f"{beyond:.0f} cm outside"
                lag = np.transpose((truth[number], estimate[number]))
                axes.plot(*lag, color=COLORS["truth"], lw=0.8, ls=":")
                for place, marker, area, color, label in (
                    (estimate, "X", 46, COLORS["paper"], "estimate at the trigger"),
                    (truth, "s", 26, COLORS["truth"], "truth at the trigger"),
                ):
                    axes.scatter(
                        *place[number], marker=marker, s=area, color=color, label=label,
                        edgecolors="white", linewidths=0.7, zorder=5,
                    )  # fmt: skip
                label = f"touchdown {'inside' if beyond <= 0 else 'outside'}"
                landed(axes, touchdown[number, None], COLORS["truth"], label, inside=beyond <= 0)
            axes.set_title(f"{number + 1}: {outcome}", fontsize=9)
            handles, labels = axes.get_legend_handles_labels()
            entries |= dict(zip(labels, handles, strict=True))
        figure.legend(
            list(entries.values()), list(entries), loc="outside lower center", ncols=3,
            columnspacing=1.2, handletextpad=0.4,
        )  # fmt: skip
    return figure


def targets(record: Record) -> Figure:
    """All landings as on a target: where the vehicle was at the trigger, and at touchdown."""
    series = record.series
    titles = {"truth": "Where the trigger fired", "touchdown": "Where it touched down"}
    places = [
        np.array(series[f"{name}_m"], dtype=float) - np.array(series["zone_m"]) for name in titles
    ]
    limits = target_limits(places, series["radius_m"])
    with canvas(1, 2, size=(7.2, 3.9), sharex=True, sharey=True) as (figure, grid):
        for axes, place, title in zip(grid[0], places, titles.values(), strict=True):
            on_target(axes, place, series["radius_m"], COLORS["paper"])
            axes.set(title=title, xlabel="x from the zone's centre (m)", aspect="equal")
            legend_below(axes, 0.2, columns=2)
        grid[0, 0].set(ylabel="y from the zone's centre (m)", xlim=limits, ylim=limits)
    return figure


def table(record: Record) -> pd.DataFrame:
    """The paper's landings, ours, and those with the true position in the localizer's place."""
    values, first = record.values, record.values["first_flights"]
    flown = {
        "Paper": published()["triggered_landing"],
        f"Our first {first['attempts']} flights": first,
        f"All {values['attempts']} flights": values,
        "With the true position": values["perfect"],
    }
    rows = [
        {
            "": name,
            "Landings": counts["landings"],
            "Inside": counts["inside"],
            "Rate": percent(counts["inside_rate"]) if "inside_rate" in counts else "",
            "Triggered inside": percent(counts.get("triggered_inside_rate")),
            "Outside: mean, furthest (cm)": _outside(counts["outliers_cm"]),
        }
        for name, counts in flown.items()
    ]
    return pd.DataFrame(rows)


def _outside(beyond: list[float]) -> str:
    return f"{np.mean(beyond):.0f}, {max(beyond):.0f}" if len(beyond) else ""


def causes(record: Record) -> pd.DataFrame:
    """What a miss is made of: the estimate's error, its lag, the drift while landing; and waits."""
    columns = {
        "Error at the trigger (cm)": "trigger_error_cm",
        "Lag of the estimate (cm)": "lag_cm",
        "Drift to touchdown (cm)": "drift_cm",
        "Wait for the trigger (s)": "wait_s",
    }
    flown = {"Localizer": record.values, "True position": record.values["perfect"]}
    return pd.DataFrame(
        [
            {"": name} | {column: _range(summary[key]) for column, key in columns.items()}
            for name, summary in flown.items()
        ]
    )


def _range(quantiles: dict[str, Any] | None) -> str:
    if quantiles is None:
        return ""
    median, low, high = (f"{quantiles[key]:.0f}" for key in ("median", "p10", "p90"))
    return f"{median} <small>[{low}, {high}]</small>"


EXPERIMENT = Experiment("Triggered landing", Parameters, run, finding, needs=SURVEYED, cost_s=90)
