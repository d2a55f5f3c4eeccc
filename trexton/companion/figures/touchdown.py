"""Figures and the table of the landings by predicted touchdown, from the record only."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas, landed
from trexton.companion.experiments.touchdown import LANDERS
from trexton.companion.wording import number, span

__all__ = ["bounds", "table", "targets", "waiting"]

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
            axes.add_patch(Circle((0, 0), radius, color=COLORS["zone"], alpha=0.22, lw=0))
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
            wait = np.sort(np.array(series["wait_s"])[fired])
            times = np.concatenate([[0], wait, [limit]])
            shares = 100 * np.concatenate([np.arange(len(wait) + 1), [len(wait)]]) / len(fired)
            plot.step(
                times, shares, where="post", color=color, linestyle=style, label=LANDERS[name].label
            )
        plot.set(
            xlabel="time of flight (s)", ylabel="triggered (% of flights)", xlim=(0, limit),
            ylim=(0, 102),
        )  # fmt: skip
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
