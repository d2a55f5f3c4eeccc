"""Figures of what the autopilot knows: error by what came beside the frames."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.aiding import METHODS
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.wording import distance

__all__ = ["errors", "table"]

KNOWN = {
    "nothing": "the frame alone",
    "attitude": "roll and pitch",
    "height": "height",
    "view": "roll, pitch and height",
    "velocity": "velocity",
    "turned": "velocity, by a wrong compass",
    "all": "all of it",
}
LABELS = {"paper": "the paper's filter", "field": "field"}


def errors(record: Record) -> Figure:
    """Mean error with its interval over what was known, a colour for each method."""
    values = record.values["error_cm"]
    with canvas(size=(7.2, 3.0)) as (figure, axes):
        plot = axes[0, 0]
        for place, (method, label) in enumerate(LABELS.items()):
            entries = [values[method][known] for known in METHODS[method]]
            rows = [list(KNOWN).index(known) for known in METHODS[method]]
            middle = np.array([entry["value"] for entry in entries])
            ends = np.array([[entry["low"], entry["high"]] for entry in entries]).T
            plot.errorbar(
                middle, np.array(rows) + 0.16 * (place - 0.5), xerr=np.abs(ends - middle),
                fmt="os"[place], color=COLORS[method], label=label,
            )  # fmt: skip
        plot.set(
            yticks=range(len(KNOWN)), yticklabels=list(KNOWN.values()), xlabel="mean error (cm)",
            xlim=(0, None), ylim=(len(KNOWN) - 0.5, -0.5),
        )  # fmt: skip
        plot.grid(axis="y", visible=False)
        legend_above(plot, 2)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error and gain with their intervals, a row for each thing known."""
    errors, gains = record.values["error_cm"], record.values["gain_cm"]
    return pd.DataFrame(
        [
            {"known beside the frame": label}
            | {
                f"{LABELS[method]}, {what}": distance(found[method][known])
                if known in found[method]
                else ""
                for method in LABELS
                for what, found in (("error", errors), ("gain", gains))
            }
            for known, label in KNOWN.items()
        ]
    )
