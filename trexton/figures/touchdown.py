"""Figures and the table of the landings by predicted touchdown, from the record only."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from trexton.experiments.touchdown import LANDERS
from trexton.figures.style import COLORS, canvas, landed
from trexton.records import Record
from trexton.wording import span

__all__ = ["table", "targets", "waiting"]

_LINES = {
    "paper": (COLORS["paper"], "-"),
    "field_inside": (COLORS["field"], ":"),
    "field": (COLORS["field"], "-"),
    "field_odometry": (COLORS["field"], "--"),
    "fine": (COLORS["fine"], "-"),
    "truth": (COLORS["truth"], "--"),
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
    with canvas(2, 3, size=(7.2, 5.2), sharex=True, sharey=True) as (figure, grid):
        for axes, (name, place) in zip(grid.flat, places.items(), strict=True):
            axes.add_patch(Circle((0, 0), radius, color=COLORS["zone"], alpha=0.22, lw=0))
            inside = np.hypot(*place.T) <= radius
            missed = ~inside & np.isfinite(place[:, 0])
            landed(axes, place[inside], _LINES[name][0], "inside the zone")
            landed(axes, place[missed], _LINES[name][0], "outside", inside=False)
            axes.set_title(LANDERS[name][0], fontsize=8.5)
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
            wait = np.sort(np.array(series["wait_s"])[fired])
            times = np.concatenate([[0], wait, [limit]])
            shares = 100 * np.concatenate([np.arange(len(wait) + 1), [len(wait)]]) / len(fired)
            plot.step(
                times, shares, where="post", color=color, linestyle=style, label=LANDERS[name][0]
            )
        plot.set(
            xlabel="time of flight (s)", ylabel="triggered (% of flights)", xlim=(0, limit),
            ylim=(0, 102),
        )  # fmt: skip
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def table(record: Record) -> pd.DataFrame:
    """For each lander: flights, landings, inside, and the rates of both denominators."""
    rows = []
    for name, (label, *_) in LANDERS.items():
        values = record.values["landers"][name]
        rows.append(
            {
                "": label,
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
    return "" if value is None else f"{value:.0f}"
