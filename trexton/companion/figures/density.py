"""Figure and table of how densely to survey."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.density import METHODS
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.wording import distance, number, percent

__all__ = ["errors", "table"]

STROKES = ("-", ":", "-")


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
                alone = np.array(by_floor[method])
                plot.plot(apart, alone, STROKES[place], color=color, alpha=0.3, linewidth=0.8)
            entries = [survey[method]["error_cm"] for survey in surveys]
            middle = np.array([entry["value"] for entry in entries])
            ends = np.array([[entry["low"], entry["high"]] for entry in entries]).T
            plot.errorbar(
                apart, middle, yerr=np.abs(ends - middle), fmt="osD"[place] + STROKES[place],
                color=color, label=label,
            )  # fmt: skip
        plot.set(
            xlabel="mean distance to the nearest frame of the survey (cm)",
            ylabel="mean error (cm)", xlim=(0, None), ylim=(0, None),
        )  # fmt: skip
        legend_above(plot)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Errors and regions, a row for each survey and method."""
    rows = []
    for survey in record.values["surveys"]:
        of_survey = f"{number(survey['lasted_s'])} s, {number(survey['apart_cm'])} cm"
        for name, label in METHODS.items():
            rows.append(
                {
                    "survey, nearest frame": of_survey,
                    "method": label,
                    "mean error": distance(survey[name]["error_cm"]),
                    "median": distance(survey[name]["median_cm"]),
                    "90 % region holds": percent(survey[name]["held"]),
                }
            )
    return pd.DataFrame(rows)
