"""Other senses: methods that were made for textons, on the signals of radio beacons.

The public Bluetooth walks take the place of the flight; training and defaults are as for textons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.errors import DataError
from trexton.base.records import Record
from trexton.companion.experiments.baselines import LABELS, compare, verdict
from trexton.companion.experiments.baselines import Parameters as Compared
from trexton.companion.experiments.declaration import Experiment
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.wording import interval, percent
from trexton.evaluation.metrics import constant_guess, euclidean
from trexton.flights.flight import Flight
from trexton.flights.importers.signals import read_ble
from trexton.flights.registry import locate

GRID_FILTER_CM = 176.0  # mean error of a Gaussian process a receiver with a grid filter
STROKES = {"neighbors": ":", "hmm": "-.", "field": "-"}
CLAIMS = (
    {
        "id": "senses-error", "place": "Other senses", "measure": "mean error (cm)",
        "text": "On radio method field is as good as Gaussian processes with a grid filter",
        "kind": "below", "bound": GRID_FILTER_CM, "ours": "senses:field.mean_cm",
        "needs": "the public Bluetooth walks",
    },
)  # fmt: skip


@dataclass(frozen=True)
class Parameters(Compared):
    """What can be chosen."""


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Train on seven walks and locate the frames of two others, with every method.

    Parameters
    ----------
    train, test : Flight
        Not used; they name the record.
    """
    try:
        walks = read_ble(*locate("ble"))
    except DataError as error:
        return parameters.record(train, values={"absent": str(error)})
    first, last = walks.part("train"), walks.part("test")
    values, errors, _ = compare(first, last, parameters)
    guess = euclidean(constant_guess(first.position, len(last)), last.position)
    values |= {"absent": None, "center_cm": 100 * guess.mean()}
    values["frames"] = {"train": len(first), "test": len(last)}
    series = {"errors_cm": {name: np.sort(each) for name, each in errors.items()}}
    return parameters.record(train, values=values, series=series)


def finding(record: Record) -> str:
    """What the experiment found, in a sentence or two."""
    if record.values["absent"]:
        return f"The data are not at hand: {record.values['absent']}."
    held = percent(record.values["field"]["held"])
    return f"{verdict(record.values)} Its 90 % region holds {held} of the positions."


def table(record: Record) -> pd.DataFrame:
    """Mean error of every method in cm, and how often its 90 % region held the position."""
    if record.values["absent"]:
        return pd.DataFrame({"method": []})
    rows = [
        {
            "method": label,
            "mean error (cm)": interval(record.values[name]["mean_cm"]),
            "in the 90 % region": percent(record.values[name]["held"]),
        }
        for name, label in LABELS.items()
    ]
    return pd.DataFrame(rows)


def shares(record: Record) -> Figure:
    """Share of frames with a smaller error."""
    with canvas(size=(7.2, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        for name, stroke in STROKES.items() if not record.values["absent"] else ():
            errors = np.asarray(record.series["errors_cm"][name])
            share = 100 * (np.arange(len(errors)) + 0.5) / len(errors)
            color = COLORS.get(name, COLORS["zone"])
            plot.plot(errors / 100, share, stroke, color=color, label=LABELS[name])
        plot.set(xlim=(0, None), ylim=(0, 100), xlabel="error (m)", ylabel="frames (%)")
        if not record.values["absent"]:
            legend_above(plot, 3)
    return figure


EXPERIMENT = Experiment(
    "Other senses: the same method on radio", Parameters, run, finding, needs=("histograms",),
    cost_s=10, claims=CLAIMS,
)  # fmt: skip
