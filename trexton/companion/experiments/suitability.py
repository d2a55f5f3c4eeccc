"""Which floors will do: the error predicted from a picture against that of other flights.

Every floor is flown over virtually, whether it is painted or a photograph: to predict, and after
another survey to measure. A good predictor ranks floors as they will turn out, and is right about
the centimetres; the paper's loss stands beside it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments import style
from trexton.companion.experiments.correlation import rank_correlation
from trexton.companion.experiments.declaration import SURVEYED, Experiment, SeedParameters, option
from trexton.companion.experiments.evaluation import map_picture
from trexton.companion.experiments.floors import named_floor
from trexton.companion.experiments.virtual_flights import VirtualFlights, judge_floor, measured_cm
from trexton.companion.wording import fixed, percent, span
from trexton.field.likelihood import bilinear
from trexton.flights.flight import Flight
from trexton.simulator.floor import Floor

METHODS = ("field", "paper")  # flown; the error of the first is predicted, the loss is the second's
LEVEL = 0.3  # share by which a prediction may differ from what is measured, to count as level
OTHER = 1000  # what is added to the seed of the flights that measure


@dataclass(frozen=True)
class Parameters(SeedParameters, VirtualFlights):
    """What can be chosen; ``height`` too."""

    floors: str = option(
        "hall:21 few:23 carpet:24",
        "LAYOUT:SEED paints one, PICTURE@METRES lays a picture so wide; separated by blanks",
    )
    frames: int = option(160, "of each survey; 0 takes as many as its lanes need", low=0)
    test_frames: int = option(60, "of each flight that measures; half as many predict", low=20)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Judge every floor. The flights name the record; those over the floors are recorded here."""
    names = parameters.floors.split()
    rows = spread(partial(_judged, parameters), names, "floors")
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    values = {
        "floors": dict(zip(names, rows, strict=True)),
        "mean": means,
        "validation": validation(rows, parameters.seed),
    }
    return parameters.record(train, test, values=values)


def _judged(parameters: Parameters, name: str) -> dict[str, float]:
    floor, others = named_floor(name), replace(parameters, seed=parameters.seed + OTHER)
    half = replace(parameters, test_frames=max(20, parameters.test_frames // 2))
    judged = judge_floor(floor, flights=half)
    errors, places = measured_cm(floor, flights=others, methods=METHODS)
    expected = 100 * bilinear(judged["heat"]["error_m"].T, np.array(floor.area), places)
    hard = expected >= min(judged["predicted_cm"], expected.max())  # one place at least
    kept = {key: float(judged[key]) for key in ("predicted_cm", "loss", "centre_cm")}
    errors["hard"] = errors[METHODS[0]][hard]
    measured = {f"{name}_cm": float(each.mean()) for name, each in errors.items()}
    return kept | measured | {f"{key}_frames": n for key, n in judged["frames"].items()}


def kept_rows(table: Mapping[str, Any] | None) -> dict[str, dict[str, float]]:
    """By floor, the rows of a sweep that flew over one floor a cell; empty without a table."""
    return {
        row["floors"]: {
            key.removeprefix("mean."): value
            for key, value in row.items()
            if key.startswith("mean.")
        }
        for row in (table or {"rows": []})["rows"]
    }


def validation(rows: Iterable[Mapping[str, float]], seed: int) -> dict[str, Any]:
    """How well floors are ranked, and how level the centimetres are.

    Parameters
    ----------
    rows : iterable of mapping
        One a floor, with ``predicted_cm``, ``loss``, and a measured ``METHOD_cm`` each.

    Returns
    -------
    dict
        ``count``; ``rank``, Spearman's rho of predicted and measured error with its interval over
        floors; ``loss_rank``, the same of the paper's loss and the measured error; ``ratio``,
        median of measured over predicted; ``off``, the median of by how much of the prediction they
        differ; ``level`` and ``twice``, shares of floors within `LEVEL` and within a factor of two;
        ``hard``, median of the error at hard places, those predicted worse than the mean, over
        the measured one.
    """
    rows = list(rows)
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    measured, predicted = columns[f"{METHODS[0]}_cm"], columns["predicted_cm"]
    ratio = measured / predicted

    def rank(a: np.ndarray, b: np.ndarray) -> dict[str, Any]:
        return rank_correlation(a, b, rng=stream(seed, "floors"), block=1, draws=2000)

    return {
        "count": len(rows),
        "rank": rank(predicted, measured),
        "loss_rank": rank(columns["loss"], measured),
        "ratio": float(np.median(ratio)),
        "off": float(np.median(np.abs(ratio - 1))),
        "level": float((np.abs(ratio - 1) <= LEVEL).mean()),
        "twice": float((np.abs(np.log2(ratio)) <= 1).mean()),
        "hard": float(np.median(columns["hard_cm"] / measured)),
    }


def finding(record: Record, kept: Mapping[str, Any] | None = None) -> str:
    """What the experiment found, in a sentence, or what a `kept` validation of more floors says."""
    found = kept or record.values["validation"]
    rank, loss = found["rank"], found["loss_rank"]
    return (
        f"Over {found['count']} floors the predicted error has a rank correlation of "
        f"{interval(rank)} with the measured one, the paper's loss of {interval(loss)}. The "
        f"measured error is within {percent(LEVEL)} of it on {percent(found['level'])} of the "
        f"floors, within a factor of two on {percent(found['twice'])}."
    )


def interval(entry: Mapping[str, Any]) -> str:
    """A correlation with its interval over floors, which few that agree cannot give."""
    if entry["low"] == entry["high"]:
        return f"{fixed(entry['value'], 2)} (too few floors for an interval)"
    return span(entry, 2)


Rows = Mapping[str, Mapping[str, float]]


def predicted_errors(floor: Floor, judged: dict[str, Any]) -> Figure:
    """The expected error over the floor's picture; within the line it is above the mean."""
    heat = 100 * np.array(judged["heat"]["error_m"], dtype=float)
    extent = judged["area_m"]
    with style.canvas(1, 1, size=(5.6, 5.0)) as (figure, [[plan]]):
        style.floor_axes(plan, extent)
        place, picture = map_picture(floor.picture, 700)
        style.show_floor(plan, place, picture, fade=0.35)
        style.heat_map(figure, plan, heat, extent, "expected error (cm)")
        x, y = judged["worst_m"]
        plan.plot(x, y, "x", color=style.COLORS["truth"], markersize=8)
        plan.contour(heat, [judged["predicted_cm"]], extent=extent, origin="lower", colors="k")
        plan.annotate("hardest", (x, y), xytext=(6, 6), textcoords="offset points")
    return figure


def measured_over_predicted(rows: Rows, kept: Rows) -> Figure:
    """Measured error over the predicted one, and over the paper's loss; `kept` floors open."""
    with style.canvas(1, 2, size=(7.2, 3.4), sharey=True) as (figure, axes):
        for points, face, label in ((kept, "none", "long run"), (rows, None, "this run")):
            measured = [row["field_cm"] for row in points.values()]
            for plot, key in zip(axes[0], ("predicted_cm", "loss"), strict=True):
                predicted = [row[key] for row in points.values()]
                if points:
                    dot: dict[str, Any] = {"color": style.COLORS["field"], "markersize": 5}
                    plot.plot(predicted, measured, "o", markerfacecolor=face, label=label, **dot)
        shown, keys = (*rows.values(), *kept.values()), ("predicted_cm", "field_cm")
        both = [row[key] for row in shown for key in keys]
        ends = [min(both) / 1.2, max(both) * 1.2]
        axes[0, 0].plot(ends, ends, color=style.COLORS["truth"], linewidth=0.8, zorder=0)
        axes[0, 0].set(xscale="log", yscale="log", xlim=ends, ylim=ends)
        axes[0, 0].set(xlabel="predicted error (cm)", ylabel="measured error (cm)")
        style.plain_log_ticks(axes[0, 0].xaxis, axes[0, 0].yaxis, axes[0, 1].yaxis)
        axes[0, 1].set_xlabel("the paper's loss")
        style.legend_above(axes[0, 0], 2)
    return figure


EXPERIMENT = Experiment(
    "Error predicted from a picture", Parameters, run, finding, needs=SURVEYED, cost_s=45
)
