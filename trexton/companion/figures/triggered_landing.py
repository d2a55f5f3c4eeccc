"""Figures and the table of the triggered landings, from the record only."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from trexton.base.records import Record
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    floor_axes,
    landed,
    legend_below,
    show_floor,
)

__all__ = ["causes", "first_flights", "table", "targets", "waiting"]

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
            ring: dict[str, Any] = {
                "fill": False,
                "color": COLORS["zone"],
                "lw": 2,
                "label": "zone",
            }
            axes.add_patch(Circle(zones[number], series["radius_m"], **ring))
            axes.set_title(_outcome(series, number), fontsize=9)
            axes.label_outer()
            if series["triggered"][number]:
                axes.plot(
                    *zip(truth[number], estimate[number], strict=True),
                    color=COLORS["truth"],
                    lw=0.8,
                    ls=":",
                )
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
    options: dict[str, Any] = {
        "loc": "outside lower center",
        "ncols": 3,
        "columnspacing": 1.2,
        "handletextpad": 0.4,
    }
    figure.legend(list(entries.values()), list(entries), **options)


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
            axes.add_patch(Circle((0, 0), radius, color=COLORS["zone"], alpha=0.22, lw=0))
            axes.add_patch(Circle((0, 0), radius, fill=False, color=COLORS["zone"], lw=2))
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
    wait = np.sort(
        [
            seconds
            for seconds, fired in zip(series["wait_s"], series["triggered"], strict=True)
            if fired
        ]
    )
    total, limit = len(series["wait_s"]), record.parameters["time_limit"]
    with canvas(size=(7.2, 2.5)) as (figure, axes):
        plot = axes[0, 0]
        times = np.concatenate([[0], wait, [limit]])
        shares = 100 * np.concatenate([[0], np.arange(1, len(wait) + 1), [len(wait)]]) / total
        plot.step(times, shares, where="post", color=COLORS["paper"])
        plot.axvline(
            record.parameters["armed_after"], color=COLORS["truth"], linestyle=":", linewidth=1.2
        )
        plot.set(
            xlabel="time of flight (s)",
            ylabel="triggered (% of flights)",
            xlim=(0, limit),
            ylim=(0, 102),
        )
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
