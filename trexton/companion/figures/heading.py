"""Figures of any heading: error by what was done to the picture, and how it was counted."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.wording import distance

__all__ = ["errors", "table"]

COUNTS = {
    "paper": "whole, the paper's distance",
    "hellinger": "whole, Hellinger's distance",
    "cells": "2 x 2 cells, Hellinger's",
}
# Hellinger's distance is that of method field.
MARKS = {
    "paper": {"fmt": "o", "color": COLORS["paper"]},
    "hellinger": {"fmt": "s", "color": COLORS["field"]},
    "cells": {"fmt": "D", "color": COLORS["field"], "markerfacecolor": "white"},
}
VIEWS = {
    "whole": "whole picture, as flown",
    "square": "its square, as flown",
    "turned": "turned by any angle",
    "tolerant": "turned, tolerant dictionary",
    "back": "turned back by a compass",
}


def errors(record: Record) -> Figure:
    """Mean error with its interval, a line for each view, a mark for each way to count."""
    values = record.values
    with canvas(size=(7.2, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        rows = np.arange(len(VIEWS))
        for place, (count, label) in enumerate(COUNTS.items()):
            each = [values["error_cm"][view][count] for view in VIEWS]
            middle = np.array([entry["value"] for entry in each]) / 100
            ends = np.array([[entry["low"], entry["high"]] for entry in each]).T / 100
            plot.errorbar(
                middle, rows + 0.2 * (place - 1), xerr=np.abs(ends - middle),
                label=label, **MARKS[count],
            )  # fmt: skip
        for name, label in (("bound_cm", "nearest picture"), ("centre_cm", "always the centre")):
            plot.axvline(values[name] / 100, color=COLORS["truth"], linestyle="--", linewidth=1)
            plot.annotate(
                label, (values[name] / 100, -0.5), xytext=(-3, -2), textcoords="offset points",
                rotation=90, ha="right", va="top", fontsize=8.5, color=COLORS["truth"],
            )  # fmt: skip
        plot.set(
            yticks=rows, yticklabels=list(VIEWS.values()), xlabel="mean error (m)", xlim=(0, None),
            ylim=(len(VIEWS) - 0.5, -0.5),
        )  # fmt: skip
        plot.grid(axis="y", visible=False)
        legend_above(plot, 2)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error with its interval, a row for each view, a column for each way to count."""
    return pd.DataFrame(
        [
            {"picture": label}
            | {words: distance(record.values["error_cm"][view][c]) for c, words in COUNTS.items()}
            for view, label in VIEWS.items()
        ]
    )
