"""What a position's uncertainty is worth: errors against the posterior covariance claimed.

Consistency (NEES) and empirical coverage of several methods over one test flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import runs_by_method
from trexton.companion.experiments.mocap_training import LANDING_SPREAD_M
from trexton.companion.experiments.style import COLORS, canvas, legend_above, plain_log_ticks
from trexton.companion.experiments.track import HELD, Track
from trexton.companion.wording import number, percent
from trexton.evaluation.metrics import mean_with_interval
from trexton.flights.flight import Flight
from trexton.localization.estimate import Estimate

METHODS = {
    "paper": "the paper's filter",
    "guarded": "the guarded filter",
    "field": "the field",
}
SETTLED_S = 2.0
WRONG = 16.0  # squared deviations: four
QUARTERS, GROUPS = 4, 10


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(5, "independent runs of each filter over the test flight", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly the test flight with each method, and compare errors with the covariance claimed.

    The first two seconds are left out: filters begin there with no idea.
    """
    values: dict[str, Any] = {}
    series: dict[str, Any] = {}
    quarter_s = float(test.time[-1] - test.time[_settled(test)]) / QUARTERS
    for name, runs in runs_by_method(
        train, test, parameters, methods=METHODS, repeats=parameters.repeats, purpose="calibration"
    ):
        claims = _Claims.of(runs, test)
        values[name] = claims.values(stream(parameters.seed, "intervals"))
        values[name]["independent_s"] = lasting = _independent(runs[0])
        values[name]["chance"] = None if lasting is None else _by_chance(quarter_s / lasting)
        series[name] = claims.groups()
    values["order"] = list(METHODS)
    values["quarter_s"] = quarter_s
    values["counts"] = {"test": len(test), "repeats": parameters.repeats}
    return parameters.record(train, test, values=values, series=series)


def _settled(test: Flight) -> int:
    """The first row that counts."""
    first = int(np.searchsorted(test.time, test.time[0] + SETTLED_S))
    return min(first, len(test) // 2)


def _by_chance(independent: float) -> dict[str, float]:
    """Between which shares 19 of 20 consistent quarters lie, of so many independent frames each."""
    count = max(1, round(independent))
    low, high = binom.interval(0.95, count, 0.9)
    return {"independent_frames": count, "low": float(low) / count, "high": float(high) / count}


def _independent(run: Track) -> float | None:
    measured = run.estimates[-1].measurement
    return None if measured is None else measured.independent_s


@dataclass(frozen=True, eq=False)
class _Claims:
    """Errors and claims of all runs; arrays ``(R, N)``, the settled frames only.

    Attributes
    ----------
    squared : array
        Errors over what was claimed, squared (NEES; 2 on average if all is honest).
    error, claimed : arrays
        Lengths of errors, and deviations claimed along an axis, metres.
    lost : array
    measured : array
        As `squared`, of what single frames measured; NaN where nothing was.
    spread : array
        The larger deviation of both axes, which the landing asks for, metres.
    """

    squared: np.ndarray
    error: np.ndarray
    claimed: np.ndarray
    lost: np.ndarray
    measured: np.ndarray
    spread: np.ndarray

    @classmethod
    def of(cls, runs: list[Track], test: Flight) -> _Claims:
        first, rows = _settled(test), []
        for run in runs:
            errors, claimed = (run.position - test.position)[first:], run.covariance[first:]
            rows.append((
                _squared(errors, claimed),
                run.errors(test.position)[first:],
                np.sqrt(np.trace(claimed, axis1=1, axis2=2) / 2),
                run.lost[first:],
                _measured(run.estimates[first:], test.position[first:]),
                run.spread[first:].max(axis=1),
            ))  # fmt: skip
        return cls(*(np.array(column) for column in zip(*rows, strict=True)))

    def values(self, rng: np.random.Generator) -> dict[str, Any]:
        held = self.squared < HELD
        wrong = self.squared > WRONG
        alone = self.measured[np.isfinite(self.measured)]
        return {
            "error_cm": 100 * self.error.mean(),
            "axis_cm": 100 * np.sqrt(np.square(self.error).mean() / 2),
            "claimed_cm": 100 * np.sqrt(np.square(self.claimed).mean()),
            "within_90": mean_with_interval(held, rng),
            "quarters": [part.mean() for part in np.array_split(held, QUARTERS, axis=1)],
            "nees": mean_with_interval(self.squared, rng),
            "single_frame": {
                "within_90": (alone < HELD).mean() if len(alone) else None,
                "nees": alone.mean() if len(alone) else None,
            },
            "wrong_rate": wrong.mean(),
            "wrong_lost_rate": self.lost[wrong].mean() if wrong.any() else None,
            "false_alarm_rate": self.lost[~wrong].mean() if (~wrong).any() else None,
            "landing_allowed_rate": (self.spread < LANDING_SPREAD_M).mean(),
        }

    def groups(self) -> list[dict[str, float]]:
        """Tenths of the frames by what was claimed: that, and the error made, cm an axis."""
        order = np.argsort(self.claimed, axis=None, kind="stable")
        claimed, error = self.claimed.ravel()[order], self.error.ravel()[order]
        return [
            {
                "claimed_cm": 100 * np.sqrt(np.square(a).mean()),
                "error_cm": 100 * np.sqrt(np.square(b).mean() / 2),
            }
            for a, b in zip(
                np.array_split(claimed, GROUPS), np.array_split(error, GROUPS), strict=True
            )
        ]


def _squared(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    squared: np.ndarray = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    return squared


def _measured(flown: list[Estimate], truth: np.ndarray) -> np.ndarray:
    squared = np.full(len(flown), np.nan)
    for row, estimate in enumerate(flown):
        if estimate.measurement is not None:
            off = estimate.measurement.position - truth[row]
            squared[row] = off @ np.linalg.solve(estimate.measurement.covariance, off)
    return squared


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    said = []
    for name in record.values["order"]:
        values = record.values[name]
        said.append(
            f"{METHODS[name]} claims {number(values['claimed_cm'])} cm along an axis, its error is "
            f"{number(values['axis_cm'])} cm, and its 90 % regions hold the truth in "
            f"{percent(values['within_90'])} of the frames"
        )
    text = "; ".join(said)
    return f"{text[0].upper()}{text[1:]}."


def error_against_claim(record: Record) -> Figure:
    """Tenths of the frames by what was claimed; on the diagonal the claim is honest."""
    with canvas(size=(5.6, 4.6)) as (figure, axes):
        plot = axes[0, 0]
        ends = []
        for name in record.values["order"]:
            groups = record.series[name]
            claimed = [group["claimed_cm"] for group in groups]
            error = [group["error_cm"] for group in groups]
            plot.plot(claimed, error, "o-", color=COLORS[name], markersize=4, label=METHODS[name])
            ends += [value for value in (*claimed, *error) if value > 0]
        both = [min(ends), max(ends)]
        plot.plot(both, both, color=COLORS["truth"], linewidth=0.9, linestyle="--")
        plot.set(
            xlabel="deviation claimed along an axis (cm)",
            ylabel="error along an axis (cm)",
            xscale="log",
            yscale="log",
        )
        plain_log_ticks(plot.xaxis, plot.yaxis)
        legend_above(plot)
    return figure


def regions_by_quarter(record: Record) -> Figure:
    """Share of the truth inside the 90 % regions in each quarter of the flight, and where chance
    alone puts honest ones.
    """
    with canvas(size=(6.4, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        order = record.values["order"]
        width = 0.8 / len(order)
        for place, name in enumerate(order):
            shares = 100 * np.array(record.values[name]["quarters"])
            at = np.arange(len(shares)) + (place - (len(order) - 1) / 2) * width
            plot.bar(at, shares, width, color=COLORS[name], label=METHODS[name])
            if (chance := record.values[name]["chance"]) is not None:
                low, high = 100 * chance["low"], 100 * chance["high"]
                plot.vlines(at, low, high, color=COLORS["truth"], linewidth=1.5)
        plot.axhline(90, color=COLORS["truth"], linewidth=0.9, linestyle="--")
        plot.set_xticks(range(4), ["first quarter", "second", "third", "last"])
        plot.set(ylabel="truth in the 90 % region (%)", ylim=(0, 100))
        plot.grid(axis="x", visible=False)
        legend_above(plot)
    return figure


EXPERIMENT = Experiment(
    "What the uncertainty is worth",
    Parameters,
    run,
    finding,
    needs=POSITIONS,
    after=("mocap_training",),
    cost_s=17,
)
