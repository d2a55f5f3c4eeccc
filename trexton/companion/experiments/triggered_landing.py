"""Triggered landing in closed loop (paper, Analysis, "Triggered Landing")."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.errors import ParameterError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.closed_loop import (
    Attempt,
    Lander,
    LandingParameters,
    Mission,
    fly_all,
)
from trexton.companion.experiments.declaration import SURVEYED, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import floor_picture, map_of
from trexton.companion.experiments.floors import lent_floor
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    floor_axes,
    landed,
    legend_below,
    share_over_time,
    show_floor,
    zone_disc,
    zone_ring,
)
from trexton.companion.wording import number, percent
from trexton.evaluation.metrics import bootstrap_interval, success_rate
from trexton.evaluation.runtime import of_frames
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
    texton_map = map_of(train, parameters)
    zone = partial(
        LandingZone,
        radius=parameters.radius,
        spread=parameters.spread,
        consecutive=parameters.consecutive,
    )
    options = {
        "samples": parameters.samples,
        "particles": parameters.particles,
        "neighbors": parameters.neighbors,
    }
    landers = {"paper": Lander(texton_map, zone, options), "perfect": Lander(None, zone)}
    flown = fly_all(mission, landers, parameters.landings)
    attempts, perfect = flown["paper"], flown["perfect"]
    floor, pictures = floor_picture(train)
    frame_s = np.concatenate([attempt.frame_s for attempt in attempts])
    return parameters.record(
        train,
        values=summarize_attempts(attempts, mission)
        | {"perfect": summarize_attempts(perfect, mission)},
        series=_series(attempts, mission) | {"area_m": train.area} | floor,
        images=pictures,
        timings={"frame_s": of_frames(frame_s)},
    )


def mission_over(
    train: Flight, parameters: LandingParameters, *, seed: int, attitude_deg: float = 0.3
) -> Mission:
    """A mission over the floor that a flight carries, seen by its camera.

    Raises
    ------
    ParameterError
        The flight has no floor or camera, or the area is too small for the zone.
    """
    floor, camera, height = lent_floor(train)
    return Mission(
        floor=floor,
        camera=camera,
        height=height,
        area=train.area,
        places=_zone_places(train, parameters.radius),
        radius=parameters.radius,
        speed=parameters.speed,
        armed_after=parameters.armed_after,
        time_limit=parameters.time_limit,
        seed=seed,
        attitude_deg=attitude_deg,
    )


def _zone_places(train: Flight, radius: float) -> np.ndarray:
    low, high = (
        np.nanmin(train.position, axis=0) + radius,
        np.nanmax(train.position, axis=0) - radius,
    )
    if (low >= high).any():
        raise ParameterError(
            f"a zone of radius {radius} m does not fit into the area that flight {train.name!r} "
            "covers: choose a smaller one"
        )
    return np.array([low, high])


def summarize_attempts(attempts: list[Attempt], mission: Mission) -> dict[str, Any]:
    """Rates with 95 % intervals, distances beyond the circle, waiting times, the yardstick of
    chance.
    """
    done = [attempt for attempt in attempts if attempt.triggered]
    beyond = np.array([_beyond(attempt, attempt.touchdown, mission.radius) for attempt in done])
    outliers = np.sort(beyond[beyond > 0])
    triggered_inside = sum(_beyond(attempt, attempt.truth, mission.radius) <= 0 for attempt in done)
    inside_rate = success_rate(len(done) - len(outliers), len(done))
    first = [
        _beyond(attempt, attempt.touchdown, mission.radius)
        for attempt in attempts[:PAPER_LANDINGS]
        if attempt.triggered
    ]
    surveyed = np.prod(mission.places[1] - mission.places[0] + 2 * mission.radius)
    return {
        "attempts": len(attempts),
        "landings": len(done),
        "never_triggered": len(attempts) - len(done),
        "never_rate": success_rate(len(attempts) - len(done), len(attempts)),
        "inside": len(done) - len(outliers),
        "inside_rate": inside_rate,
        "triggered_inside_rate": success_rate(triggered_inside, len(done)),
        "outliers": len(outliers),
        "outliers_cm": outliers,
        "outlier_mean_cm": _mean(outliers, stream(mission.seed, "intervals")),
        "first_flights": {
            "attempts": len(attempts[:PAPER_LANDINGS]),
            "landings": len(first),
            "inside": sum(value <= 0 for value in first),
            "outliers_cm": [value for value in first if value > 0],
        },
        "paper_or_fewer_chance": _chance(inside_rate),
        "chance_rate": np.pi * mission.radius**2 / surveyed,
        "wait_s": _quantiles([attempt.wait_s for attempt in attempts]),
        "trigger_error_cm": _quantiles(
            [100 * np.hypot(*(attempt.estimate - attempt.truth)) for attempt in done]
        ),
        "lag_cm": _quantiles([_lag(attempt) for attempt in done]),
        "drift_cm": _quantiles(
            [100 * np.hypot(*(attempt.touchdown - attempt.truth)) for attempt in done]
        ),
    }


def _beyond(attempt: Attempt, place: np.ndarray, radius: float) -> float:
    """Distance in cm from the circle to a place outside it; negative inside."""
    return float(100 * (np.hypot(*(place - attempt.zone)) - radius))


def _lag(attempt: Attempt) -> float:
    """How far in cm the estimate trails the vehicle at the trigger, along the way it flies."""
    return float(
        100 * (attempt.truth - attempt.estimate) @ attempt.velocity / np.hypot(*attempt.velocity)
    )


def _mean(values: np.ndarray, rng: np.random.Generator, draws: int = 2000) -> dict[str, Any] | None:
    """Mean and its 95 % bootstrap interval."""
    if not len(values):
        return None
    means = values[rng.integers(len(values), size=(draws, len(values)))].mean(axis=1)
    low, high = bootstrap_interval(means, len(values), block=1)
    return {"value": values.mean(), "low": low, "high": high}


def _quantiles(values: list[float]) -> dict[str, Any] | None:
    return (
        dict(zip(("p10", "median", "p90"), np.percentile(values, (10, 50, 90)), strict=False))
        if values
        else None
    )


def _chance(rate: dict[str, Any] | None) -> float | None:
    """Chance of at most the paper's number inside, in as many landings as the paper's, at our
    rate.
    """
    if rate is None:
        return None
    from scipy.stats import binom

    return float(binom.cdf(PAPER_INSIDE, PAPER_LANDINGS, rate["value"]))


def _series(attempts: list[Attempt], mission: Mission) -> dict[str, Any]:
    """What the figures draw; paths in millimetres' resolution, of the first attempts only."""
    columns = {
        f"{name}_m": np.array([getattr(a, name) for a in attempts])
        for name in ("zone", "estimate", "truth", "touchdown")
    }
    return columns | {
        "triggered": [attempt.triggered for attempt in attempts],
        "wait_s": [attempt.wait_s for attempt in attempts],
        "beyond_cm": [_beyond(attempt, attempt.touchdown, mission.radius) for attempt in attempts],
        "paths_m": [np.round(attempt.path, 3) for attempt in attempts[:PAPER_LANDINGS]],
        "radius_m": mission.radius,
    }


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    if not values["landings"]:
        return f"None of {values['attempts']} flights triggered a landing."
    rate = values["inside_rate"]
    text = (
        f"{values['inside']} of {values['landings']} landings ended inside the zone "
        f"({percent(rate)}; the paper had {PAPER_INSIDE} of {PAPER_LANDINGS}), "
        f"and {values['never_triggered']} of "
        f"{values['attempts']} flights never triggered"
    )
    perfect = values["perfect"]
    if perfect["landings"]:
        text += (
            f", where the true position would have landed {perfect['inside']} of "
            f"{perfect['landings']}: the estimate was "
            f"{number(values['trigger_error_cm']['median'])} "
            "cm off, in the median, when it gave the word"
        )
    return text + "."


_COUNTS = ("", "Landings", "Inside", "Rate", "Triggered inside", "Never triggered")
_DISTANCES = ("Beyond the circle (cm), mean", "furthest")
_EDGE: dict[str, Any] = {"edgecolors": "white", "linewidths": 0.7, "zorder": 5}


def _array(values: list[Any]) -> np.ndarray:
    """Numbers of a record; what was not a number is NaN again."""
    return np.array(
        [[np.nan if value is None else value for value in np.atleast_1d(row)] for row in values],
        dtype=float,
    )


def first_flights(record: Record) -> Figure:
    """The first flights from above, as many as the paper's: path, zone, trigger and touchdown."""
    series = record.series
    zones, truth, estimate, touchdown = (
        _array(series[f"{name}_m"]) for name in ("zone", "truth", "estimate", "touchdown")
    )
    count = len(series["paths_m"])
    columns = min(3, count)
    rows = -(-count // columns)
    size = (2.6 * columns, 2.75 * rows + 0.3)
    with canvas(rows, columns, size=size, sharex=True, sharey=True) as (figure, grid):
        for axes in grid.flat[count:]:
            axes.axis("off")
        for number, axes in enumerate(grid.flat[:count]):
            floor_axes(axes, series["area_m"])
            show_floor(axes, series.get("floor"), record.images.get("floor"), fade=0.3)
            axes.plot(
                *np.array(series["paths_m"][number]).T, color=COLORS["truth"], lw=1.1, label="flown"
            )
            zone_ring(axes, zones[number], series["radius_m"], label="zone")
            axes.set_title(_outcome(series, number), fontsize=9)
            axes.label_outer()
            if series["triggered"][number]:
                lag = np.transpose((truth[number], estimate[number]))
                axes.plot(*lag, color=COLORS["truth"], lw=0.8, ls=":")
                inside = series["beyond_cm"][number] <= 0
                for place, marker, area, color, label in (
                    (estimate, "X", 46, COLORS["paper"], "estimate at the trigger"),
                    (truth, "s", 26, COLORS["truth"], "truth at the trigger"),
                ):
                    axes.scatter(
                        *place[number], marker=marker, s=area, color=color, label=label, **_EDGE
                    )
                label = "touchdown inside" if inside else "touchdown outside"
                landed(axes, touchdown[number, None], COLORS["truth"], label, inside=inside)
        _legend(figure, grid.flat[:count])
    return figure


def _outcome(series: dict[str, Any], number: int) -> str:
    if not series["triggered"][number]:
        return f"{number + 1}: never triggered"
    beyond = series["beyond_cm"][number]
    return f"{number + 1}: inside" if beyond <= 0 else f"{number + 1}: {beyond:.0f} cm outside"


def _legend(figure: Figure, grid: Iterable[Axes]) -> None:
    """One legend below all panels, each entry once."""
    entries: dict[str, Artist] = {}
    for axes in grid:
        handles, labels = axes.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=3,
        columnspacing=1.2, handletextpad=0.4,
    )  # fmt: skip


def targets(record: Record) -> Figure:
    """All landings as on a target: where the vehicle was at the trigger, and at touchdown."""
    series = record.series
    zones, radius = _array(series["zone_m"]), series["radius_m"]
    beyond = _array(series["beyond_cm"])[:, 0]
    titles = {"truth": "Where the trigger fired", "touchdown": "Where it touched down"}
    reach = radius
    with canvas(1, 2, size=(7.2, 3.9), sharex=True, sharey=True) as (figure, grid):
        for axes, (name, title) in zip(grid[0], titles.items(), strict=True):
            place = _array(series[f"{name}_m"]) - zones
            distance = np.hypot(*place.T)
            reach = max(reach, np.nanmax(np.abs(place), initial=0))
            zone_disc(axes, radius)
            zone_ring(axes, (0, 0), radius)
            for inside in (True, False):
                rows = ((distance <= radius) == inside) & np.isfinite(beyond)
                where = "inside" if inside else "outside"
                share = f"{where}: {rows.sum()} of {np.isfinite(beyond).sum()}"
                landed(axes, place[rows], COLORS["paper"], share, inside=inside)
            axes.set(title=title, xlabel="x from the zone's centre (m)", aspect="equal")
            legend_below(axes, 0.2, columns=2)
        limits = (-1.08 * reach, 1.08 * reach)
        grid[0, 0].set(ylabel="y from the zone's centre (m)", xlim=limits, ylim=limits)
    return figure


def waiting(record: Record) -> Figure:
    """Share of the flights whose trigger has fired, over time."""
    series = record.series
    wait = np.array(series["wait_s"])[np.array(series["triggered"], dtype=bool)]
    with canvas(size=(7.2, 2.5)) as (figure, axes):
        plot, limit = axes[0, 0], record.parameters["time_limit"]
        share_over_time(plot, wait, len(series["wait_s"]), limit, color=COLORS["paper"])
        armed = record.parameters["armed_after"]
        plot.axvline(armed, color=COLORS["truth"], linestyle=":", linewidth=1.2)
        plot.set(xlabel="time of flight (s)", ylabel="triggered (% of flights)")
    return figure


def table(record: Record) -> pd.DataFrame:
    """The paper's landings, ours, and those with the true position in the localizer's place."""
    paper, values = published()["triggered_landing"], record.values
    first, ideal = values["first_flights"], values["perfect"]
    missed = first["attempts"] - first["landings"]
    rows = [
        _row("Paper", paper, Rate=f"{paper['inside_rate']:.0%}"),
        _row(f"Our first {first['attempts']} flights", first, **{"Never triggered": missed}),
        _row(f"All {values['attempts']} flights", values, **_rates(values)),
        _row("With the true position", ideal, **_rates(ideal)),
    ]
    return pd.DataFrame(rows, columns=_COUNTS + _DISTANCES, dtype=object).fillna("")


def causes(record: Record) -> pd.DataFrame:
    """What a miss is made of: the estimate's error, its lag, the drift while landing."""
    columns = {
        "Error at the trigger": "trigger_error_cm",
        "Lag of the estimate": "lag_cm",
        "Drift to touchdown": "drift_cm",
    }
    rows = [
        {"cm": name} | {column: _range(summary[key]) for column, key in columns.items()}
        for name, summary in (
            ("Localizer", record.values),
            ("True position", record.values["perfect"]),
        )
    ]
    return pd.DataFrame(rows)


def _range(quantiles: dict[str, Any] | None) -> str:
    if quantiles is None:
        return ""
    return (
        f"{quantiles['median']:.0f} <small>[{quantiles['p10']:.0f}, {quantiles['p90']:.0f}]</small>"
    )


def _row(name: str, counts: dict[str, Any], **more: Any) -> dict[str, Any]:
    distances = counts["outliers_cm"]
    summary = (f"{np.mean(distances):.0f}", f"{max(distances):.0f}") if distances else ("", "")
    row = dict(zip(_COUNTS[:3], (name, counts["landings"], counts["inside"]), strict=True))
    return row | dict(zip(_DISTANCES, summary, strict=True)) | more


def _rates(summary: dict[str, Any]) -> dict[str, Any]:
    rates = {"Rate": "inside_rate", "Triggered inside": "triggered_inside_rate"}
    cells = {column: _percent(summary[key]) for column, key in rates.items()}
    return cells | {"Never triggered": summary["never_triggered"]}


def _percent(rate: dict[str, Any] | None) -> str:
    if rate is None:
        return ""
    return f"{rate['value']:.0%} <small>[{rate['low']:.0%}, {rate['high']:.0%}]</small>"


EXPERIMENT = Experiment("Triggered landing", Parameters, run, finding, needs=SURVEYED, cost_s=90)
