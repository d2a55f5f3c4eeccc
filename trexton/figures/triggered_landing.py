"""Figures and the table of the triggered landings, from the record only."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from trexton.figures.style import COLORS, canvas, floor_axes, show_floor
from trexton.paper import published
from trexton.records import Record

__all__ = ["first_flights", "table", "targets", "waiting"]

_COLUMNS = (
    "", "Landings", "Inside", "Rate", "Triggered inside", "Never triggered", "Beyond the circle (cm), mean", "furthest",
)  # fmt: skip
INSIDE, OUTSIDE = COLORS["accent"], COLORS["estimate"]
_EDGE = {"edgecolors": "white", "linewidths": 0.7, "zorder": 5}


def _array(values: list) -> np.ndarray:
    """Numbers of a record; what was not a number is NaN again."""
    return np.array([[np.nan if value is None else value for value in np.atleast_1d(row)] for row in values], dtype=float)


def first_flights(record: Record) -> Figure:
    """The first flights from above, as many as the paper's: path, zone, where the trigger fired, where it touched down."""
    series = record.series
    zones, truth, estimate, touchdown = (_array(series[f"{name}_m"]) for name in ("zone", "truth", "estimate", "touchdown"))
    count = len(series["paths_m"])
    columns = min(3, count)
    rows = -(-count // columns)
    with canvas(rows, columns, size=(2.6 * columns, 2.75 * rows + 0.3), sharex=True, sharey=True) as (figure, grid):
        for axes in grid.flat[count:]:
            axes.axis("off")
        for number, axes in enumerate(grid.flat[:count]):
            floor_axes(axes, series["area_m"])
            show_floor(axes, series.get("floor"), record.images.get("floor"), fade=0.3)
            axes.plot(*np.array(series["paths_m"][number]).T, color=COLORS["truth"], linewidth=1.1, label="flown")
            axes.add_patch(Circle(zones[number], series["radius_m"], fill=False, color=COLORS["spread"], linewidth=2, label="zone"))
            axes.set_title(_outcome(series, number), fontsize=9)
            axes.label_outer()
            if not series["triggered"][number]:
                continue
            axes.plot(*zip(truth[number], estimate[number]), color=COLORS["truth"], linewidth=0.8, linestyle=":")
            axes.scatter(*estimate[number], marker="X", s=46, color=COLORS["paper"], label="estimate at the trigger", **_EDGE)
            axes.scatter(*truth[number], marker="o", s=30, color=COLORS["knn"], label="truth at the trigger", **_EDGE)
            color = INSIDE if series["beyond_cm"][number] <= 0 else OUTSIDE
            axes.scatter(*touchdown[number], marker="^", s=52, color=color, label="touchdown", **_EDGE)
        _legend(figure, grid.flat[:count])
    return figure


def _outcome(series: dict, number: int) -> str:
    if not series["triggered"][number]:
        return f"{number + 1}: never triggered"
    beyond = series["beyond_cm"][number]
    return f"{number + 1}: inside" if beyond <= 0 else f"{number + 1}: {beyond:.0f} cm outside"


def _legend(figure: Figure, grid) -> None:
    """One legend below all panels, each entry once."""
    entries = {}
    for axes in grid:
        entries |= dict(reversed(pair) for pair in zip(*axes.get_legend_handles_labels()))
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=5, columnspacing=1.2, handletextpad=0.4)


def targets(record: Record) -> Figure:
    """All landings as on a target: where the vehicle was at the trigger and where it touched down, the zone in the middle."""
    series = record.series
    zones, radius = _array(series["zone_m"]), series["radius_m"]
    beyond = _array(series["beyond_cm"])[:, 0]
    reach = 0.0
    with canvas(1, 2, size=(7.2, 3.9), sharex=True, sharey=True) as (figure, grid):
        for axes, name, title in zip(grid[0], ("truth", "touchdown"), ("Where the trigger fired", "Where it touched down")):
            place = _array(series[f"{name}_m"]) - zones
            distance = np.hypot(*place.T)
            reach = max(reach, np.nanmax(np.abs(place), initial=radius))
            axes.add_patch(Circle((0, 0), radius, color=COLORS["spread"], alpha=0.22, linewidth=0))
            axes.add_patch(Circle((0, 0), radius, fill=False, color=COLORS["spread"], linewidth=2))
            for inside, color, marker in ((True, INSIDE, "o"), (False, OUTSIDE, "^")):
                rows = (distance <= radius) == inside
                rows &= np.isfinite(beyond)
                axes.scatter(*place[rows].T, marker=marker, s=30, color=color, **_EDGE)
                share = f"{rows.sum()} of {np.isfinite(beyond).sum()}"
                axes.scatter([], [], marker=marker, s=30, color=color, label=f"{'inside' if inside else 'outside'}: {share}")
            axes.set(title=title, xlabel="x from the zone's centre (m)", aspect="equal")
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
        grid[0, 0].set(ylabel="y from the zone's centre (m)", xlim=(-1.08 * reach, 1.08 * reach), ylim=(-1.08 * reach, 1.08 * reach))
    return figure


def waiting(record: Record) -> Figure:
    """Share of the flights whose trigger has fired, over time."""
    series = record.series
    wait = np.sort([seconds for seconds, fired in zip(series["wait_s"], series["triggered"]) if fired])
    total, limit = len(series["wait_s"]), record.parameters["time_limit"]
    with canvas(size=(7.2, 2.5)) as (figure, axes):
        plot = axes[0, 0]
        times = np.concatenate([[0], wait, [limit]])
        shares = 100 * np.concatenate([[0], np.arange(1, len(wait) + 1), [len(wait)]]) / total
        plot.step(times, shares, where="post", color=COLORS["accent"])
        plot.axvline(record.parameters["armed_after"], color=COLORS["truth"], linestyle=":", linewidth=1.2)
        plot.set(xlabel="time of flight (s)", ylabel="triggered (% of flights)", xlim=(0, limit), ylim=(0, 102))
    return figure


def table(record: Record) -> pd.DataFrame:
    """The paper's landings, ours, and those with the true position in the localizer's place."""
    paper, values = published()["triggered_landing"], record.values
    first = values["first_flights"]
    rows = [{"": "Paper", "Landings": paper["landings"], "Inside": paper["inside"], "Rate": f"{paper['inside_rate']:.0%}"}]
    rows[0] |= _outliers(paper["outliers_cm"])
    missed = first["attempts"] - first["landings"]
    counts = {"": f"Our first {first['attempts']} flights", "Landings": first["landings"], "Inside": first["inside"]}
    rows.append(counts | _outliers(first["outliers_cm"]) | {"Never triggered": missed})
    for name, summary in ((f"All {values['attempts']} flights", values), ("With the true position", values["perfect"])):
        counts = {"": name, "Landings": summary["landings"], "Inside": summary["inside"], "Rate": _percent(summary["inside_rate"])}
        fired = {"Triggered inside": _percent(summary["triggered_inside_rate"]), "Never triggered": summary["never_triggered"]}
        rows.append(counts | _outliers(summary["outliers_cm"]) | fired)
    return pd.DataFrame(rows, columns=_COLUMNS, dtype=object).fillna("")


def _percent(rate: dict | None) -> str:
    return "" if rate is None else f"{rate['median']:.0%} <small>[{rate['low']:.0%}, {rate['high']:.0%}]</small>"


def _outliers(distances: list[float]) -> dict:
    if not distances:
        return {}
    return {"Beyond the circle (cm), mean": f"{np.mean(distances):.0f}", "furthest": f"{max(distances):.0f}"}
