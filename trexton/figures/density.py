"""Figure and table of how densely to survey."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.experiments.density import METHODS
from trexton.figures.style import COLORS, canvas, legend_above
from trexton.records import Record
from trexton.wording import distance, number, percent

__all__ = ["errors", "table"]


def errors(record: Record) -> Figure:
    """Mean error over the distance to the nearest frame of the survey: all floors with their
    interval, and each of them alone.
    """
    surveys, by_floor = record.values["surveys"], record.series["by_floor_cm"]
    apart = np.array([survey["apart_cm"] for survey in surveys])
    with canvas(size=(6.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        for place, (method, label) in enumerate(METHODS.items()):
            color = COLORS[method if method in COLORS else "field"]
            if record.values["floors"] > 1:
                plot.plot(apart, np.array(by_floor[method]), color=color, alpha=0.3, linewidth=0.8)
            entries = [survey[method]["error_cm"] for survey in surveys]
            middle = np.array([entry["value"] for entry in entries])
            ends = np.array([[entry["low"], entry["high"]] for entry in entries]).T
            plot.errorbar(
                apart, middle, yerr=np.abs(ends - middle), fmt=("o-", "s--", "D-")[place],
                color=color, label=label,
            )  # fmt: skip
        plot.set(
            xlabel="mean distance to the nearest frame of the survey (cm)",
            ylabel="mean error (cm)", xlim=(0, None), ylim=(0, None),
        )  # fmt: skip
        legend_above(plot)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Errors and regions, a row for each survey."""
    rows = []
    for survey in record.values["surveys"]:
        row = {
            "survey": f"{number(survey['lasted_s'])} s",
            "nearest frame (cm)": number(survey["apart_cm"]),
        }
        for name, label in METHODS.items():
            row[f"{label}: mean"] = distance(survey[name]["error_cm"])
            row[f"{label}: median"] = distance(survey[name]["median_cm"])
        for name in ("field", "parts"):
            row[f"{METHODS[name]}: 90 % region holds"] = percent(survey[name]["held"])
        rows.append(row)
    return pd.DataFrame(rows)
