"""Triggered landing in closed loop (paper, Analysis, "Triggered Landing").

The vehicle flies at random until the paper's filter believes it in the zone, and then comes down;
the same flights with the true position show what landing itself costs.
"""

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
    zone_ring,
)
from trexton.companion.experiments.metrics import with_interval
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.rates import success_rate
from trexton.companion.experiments.style import COLORS, canvas, floor_axes, show_floor
from trexton.companion.wording import middle, number, percent
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone

PAPER_LANDINGS, PAPER_INSIDE = 6, 4


@dataclass(frozen=True)
class Parameters(MapParameters, LandingParameters):
    """What can be chosen."""

    landings: int = option(16, "attempts, each with another zone, path, wind and start", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Land wherever the localizer says that the vehicle is in the zone, over and over.

    The map is trained on `train`, and flown over the floor it carries. Of `test` nothing is
    used: the virtual camera takes its place, under the light of an hour later.

    Raises
    ------
    ParameterError
        The flight has no floor or camera, or the area is too small for the zone.
    """
    mission = mission_over(train, parameters, seed=parameters.seed)
    zone = partial(LandingZone, radius=parameters.radius)
    options = {name: getattr(parameters, name) for name in ("samples", "particles", "neighbors")}
    paper = Lander(map_of(train, parameters), zone, options)
    flown = fly_all(mission, {"paper": paper, "perfect": Lander(None, zone)}, parameters.landings)
    floor, pictures = floor_picture(train)
    values = summarize_attempts(flown["paper"], parameters)
    values |= {"perfect": summarize_attempts(flown["perfect"], parameters)}
    series = _series(flown["paper"], parameters) | {"area_m": train.area} | floor
    return parameters.record(train, values=values, series=series, images=pictures)


def summarize_attempts(attempts: list[Attempt], parameters: LandingParameters) -> dict[str, Any]:
    """Rates with 95 % intervals, and distances beyond the circle."""
    done = [attempt for attempt in attempts if attempt.triggered]
    beyond = 100 * (distances(attempts, "touchdown") - parameters.radius)
    outliers = np.sort(beyond[beyond > 0])
    triggered_inside = int((distances(attempts, "truth") <= parameters.radius).sum())
    return {
        "attempts": len(attempts),
        "landings": len(done),
        "never_triggered": len(attempts) - len(done),
        "inside": len(done) - len(outliers),
        "inside_rate": success_rate(len(done) - len(outliers), len(done)),
        "triggered_inside_rate": success_rate(triggered_inside, len(done)),
        "outlier_mean_cm": _mean(outliers, stream(parameters.seed, "intervals")),
        "first_flights": {"inside": int((beyond[:PAPER_LANDINGS] <= 0).sum())},
    }


def _mean(values: np.ndarray, rng: np.random.Generator) -> dict[str, Any] | None:
    """Mean and its 95 % bootstrap interval."""
    if not len(values):
        return None
    means = values[rng.integers(len(values), size=(2000, len(values)))].mean(axis=1)
    return with_interval(values.mean(), means, len(values), block=1)


def _series(attempts: list[Attempt], parameters: LandingParameters) -> dict[str, Any]:
    """What the figures draw; paths in millimetres' resolution, of the first attempts only."""
    columns = {
        f"{name}_m": np.array([getattr(a, name) for a in attempts])
        for name in ("zone", "estimate", "truth", "touchdown")
    }
    return columns | {
        "beyond_cm": 100 * (distances(attempts, "touchdown") - parameters.radius),
        "paths_m": [np.round(attempt.path, 3) for attempt in attempts[:PAPER_LANDINGS]],
    }


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    if not values["landings"]:
        return f"None of {values['attempts']} flights triggered a landing."
    text = (
        f"By the paper's trigger {values['inside']} of {values['attempts']} flights ended in the "
        f"zone. {values['landings'] - values['inside']} landed beside it, and "
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
    rows = -(-count // 3)
    size = (7.8, 2.75 * rows + 0.3)
    entries: dict[str, Artist] = {}  # one legend for all panels, each entry once
    with canvas(rows, 3, size=size, sharex=True, sharey=True) as (figure, grid):
        for axes in grid.flat[count:]:
            axes.axis("off")
        for number, axes in enumerate(grid.flat[:count]):
            floor_axes(axes, series["area_m"])
            show_floor(axes, series.get("floor"), record.images.get("floor"), fade=0.3)
            axes.plot(
                *np.array(series["paths_m"][number]).T, color=COLORS["truth"], lw=1.1, label="flown"
            )
            zone_ring(axes, series["zone_m"][number], record.parameters["radius"], label="zone")
            beyond = series["beyond_cm"][number]
            outcome = "never triggered"
            axes.label_outer()
            if beyond is not None:
                outcome = "inside" if beyond <= 0 else f"{beyond:.0f} cm outside"
                for place, mark, color, label in (
                    (estimate, "X", COLORS["paper"], "estimate at the trigger"),
                    (truth, "s", COLORS["truth"], "truth at the trigger"),
                ):
                    line = {"color": color, "markeredgecolor": "white", "linestyle": "none"}
                    axes.plot(*place[number], mark, label=label, **line)
                label = f"touchdown {'inside' if beyond <= 0 else 'outside'}"
                landed(axes, touchdown[number, None], COLORS["truth"], label, inside=beyond <= 0)
            axes.set_title(f"{number + 1}: {outcome}", fontsize=9)
            handles, labels = axes.get_legend_handles_labels()
            entries |= dict(zip(labels, handles, strict=True))
        spaced: dict[str, Any] = {"ncols": 3, "columnspacing": 1.2, "handletextpad": 0.4}
        handles = list(entries.values())
        figure.legend(handles, list(entries), loc="outside lower center", **spaced)
    return figure


def table(record: Record) -> pd.DataFrame:
    """The paper's landings, ours, and those with the true position in the localizer's place."""
    values = record.values
    flown = {
        "Paper": published()["triggered_landing"],
        f"Our {values['attempts']} flights": values,
        "With the true position": values["perfect"],
    }
    rows = [
        {
            "": name,
            "Landings": counts["landings"],
            "Inside": counts["inside"],
            "Rate": percent(counts["inside_rate"]),
            "Triggered inside": percent(counts.get("triggered_inside_rate")),
            "Outside, beyond the circle (cm)": _beyond(counts["outlier_mean_cm"]),
        }
        for name, counts in flown.items()
    ]
    return pd.DataFrame(rows)


def _beyond(mean: Any) -> str:
    return "" if mean is None else number(middle(mean))


EXPERIMENT = Experiment("Triggered landing", Parameters, run, finding, needs=SURVEYED, cost_s=90)
