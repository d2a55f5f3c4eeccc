"""What a position's uncertainty is worth: by itself, and where an autopilot fuses it.

Consistency (NEES) and empirical coverage of several methods over one test flight, and of what
receivers like EKF2 and EKF3 make of their reports, fused with simulated accelerometers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom, chi2, mannwhitneyu

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import coverage, drawn_histograms, flown, method_map
from trexton.companion.experiments.receivers import RECEIVERS, Receiver, Settings, readings
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    legend_above,
    plain_log_ticks,
    with_intervals,
)
from trexton.companion.experiments.track import HELD, Track, tracks
from trexton.companion.wording import middle, percent
from trexton.evaluation.metrics import euclidean, mean_with_interval
from trexton.flights.flight import Flight
from trexton.localization.estimate import Estimate
from trexton.localization.localizer import TextonMap

METHODS = {"paper": "the paper's filter", "field": "the field"}
SETTLED_S = 2.0  # filters begin with no idea of the place
FUSED_SETTLED_S = 4.0  # and receivers with none of the velocity
WRONG = 16.0  # squared deviations: four
FAR_M = 1.0  # an error that a claim should tell from smaller ones
QUARTERS, GROUPS = 4, 10
SENT = {"sent": "as it is sent", "plain": "as if each were news"}
BAND = {"low": 0.8, "high": 0.97}  # of the truth in the fused 90 % region: that is honest


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(5, "independent runs of each filter over the test flight", low=1)
    vehicles: int = option(10, "accelerometers that each run is fused with", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly the test flight with each method; compare errors with the covariance claimed, and fuse.

    A report is sent once, and only where a vehicle may steer by it: a method that says of every
    frame that it is lost sends nothing. Beside what is sent stands the same with each report's own
    covariance, whatever it shares with the ones before.
    """
    seed, period = parameters.seed, float(np.median(np.diff(test.time)))
    pushes = readings(test.position, test.time, parameters.vehicles, stream(seed, "accelerometers"))
    quarter_s = float(test.time[-1] - test.time[_settled(test, SETTLED_S)]) / QUARTERS
    values: dict[str, Any] = {"order": list(METHODS), "silent": [], "band": BAND}
    series: dict[str, Any] = {}
    for name, method, runs in _runs(train, test, parameters):
        judged, series[name] = _claimed(runs, test, stream(seed, "intervals"))
        flights = [track.estimates for track in runs]
        usable = [not estimate.lost_in(test.area) for flown in flights for estimate in flown]
        measured = flights[0][-1].measurement
        lasting = None if measured is None else measured.independent_s
        alike = 1.0 if lasting is None else max(1.0, lasting / period)
        quoted = flown(train, test, parameters, name, texton_map=method)
        values[name] = judged | {
            "within_90": coverage(quoted, test, seed),
            "independent_s": lasting,
            "chance": None if lasting is None else _by_chance(quarter_s / lasting),
            "alike": alike,
            "usable_rate": np.mean(usable),
        }
        if not any(usable):
            values["silent"].append(name)
            continue
        for receiver, settings in RECEIVERS.items():
            values[name][receiver] = {}
            for sent in SENT:
                # A report an age is news, whatever it shares with the one before.
                every = period if sent == "sent" else np.inf
                fused = [_fuse(settings, flown, every, test, pushes) for flown in flights]
                values[name][receiver][sent] = _consistency(
                    fused, test, alike if sent == "sent" else 1.0, stream(seed, "intervals")
                )
    counts = {"repeats": parameters.repeats, "vehicles": parameters.vehicles}
    values |= {"quarter_s": quarter_s, "counts": {"test": len(test)} | counts}
    return parameters.record(train, test, values=values, series=series)


def _runs(
    train: Flight, test: Flight, parameters: Parameters
) -> Iterator[tuple[str, TextonMap, list[Track]]]:
    """Each method, its map and its runs, all with the same histogram of each test frame."""
    for name, label in METHODS.items():
        method = method_map(train, parameters, name)
        histograms = drawn_histograms(test, method, parameters.samples, parameters.seed)
        yield name, method, tracks(
            method, histograms, repeats=parameters.repeats, seed=parameters.seed, label=label,
            counted=parameters.samples if test.has_images else None,
        )  # fmt: skip


def _settled(test: Flight, after_s: float) -> int:
    """The first row that counts."""
    return min(int(np.searchsorted(test.time, test.time[0] + after_s)), len(test) // 2)


def _by_chance(independent: float) -> dict[str, float]:
    """Between which shares 19 of 20 consistent quarters lie, of so many independent frames each."""
    count = max(1, round(independent))
    low, high = binom.interval(0.95, count, 0.9)
    return {"independent_frames": count, "low": float(low) / count, "high": float(high) / count}


def _claimed(
    runs: list[Track], test: Flight, rng: np.random.Generator
) -> tuple[dict[str, Any], list[dict[str, float]]]:
    """Errors against the covariance claimed, of the settled frames of all runs; and tenths of the
    frames by what was claimed: that, and the error made, cm an axis.
    """
    rows = slice(_settled(test, SETTLED_S), None)
    truth = test.position[rows]
    covariance = np.array([run.covariance[rows] for run in runs])
    off = np.array([run.position[rows] - truth for run in runs])
    squared = np.einsum("rni,rnij,rnj->rn", off, np.linalg.inv(covariance), off)  # NEES: 2 if right
    error = np.array([run.errors(test.position)[rows] for run in runs])
    claimed = np.sqrt(np.trace(covariance, axis1=2, axis2=3) / 2)  # deviation along an axis
    lost = np.array([run.lost[rows] for run in runs])
    held, wrong, far = squared < HELD, squared > WRONG, error > FAR_M
    pairs = far.sum() * (~far).sum()
    values = {
        "far_auc": mannwhitneyu(claimed[far], claimed[~far])[0] / pairs if pairs else None,
        "error_cm": 100 * error.mean(),
        "axis_cm": 100 * np.sqrt(np.square(error).mean() / 2),
        "claimed_cm": 100 * np.sqrt(np.square(claimed).mean()),
        "quarters": [part.mean() for part in np.array_split(held, QUARTERS, axis=1)],
        "nees": mean_with_interval(squared, rng),
        "wrong_rate": wrong.mean(),
        "wrong_lost_rate": lost[wrong].mean() if wrong.any() else None,
        "false_alarm_rate": lost[~wrong].mean() if (~wrong).any() else None,
    }
    tenths = np.array_split(np.argsort(claimed, axis=None, kind="stable"), GROUPS)
    groups = [
        {
            "claimed_cm": 100 * np.sqrt(np.square(claimed.ravel()[tenth]).mean()),
            "error_cm": 100 * np.sqrt(np.square(error.ravel()[tenth]).mean() / 2),
        }
        for tenth in tenths
    ]
    return values, groups


def _fuse(
    settings: Settings, flown: list[Estimate], every_s: float, test: Flight, pushes: np.ndarray
) -> np.ndarray:
    """``(4, N, R)`` one flight as its receivers came to believe it, NaN before the first report:
    length of the error, the deviation believed, both in metres, NEES, and NIS where a report came.
    """
    vehicles = pushes.shape[1]
    receiver = Receiver(settings, vehicles)
    fused = np.full((4, len(flown), vehicles), np.nan)
    for row, (time, estimate) in enumerate(zip(test.time, flown, strict=True)):
        if row and receiver.begun:
            receiver.drive(pushes[row - 1], float(time - test.time[row - 1]))
        if not estimate.lost_in(test.area):
            sent = estimate.for_fusion(every_s)
            ratios = receiver.fuse(float(time), sent.position, np.diagonal(sent.covariance))
            fused[3, row] = ratios.sum(axis=1)
        if receiver.begun:
            fused[0, row] = euclidean(receiver.position, test.position[row])
            fused[1, row] = np.sqrt(receiver.variance.sum(axis=1))
            fused[2, row] = receiver.squared_error(test.position[row])
    return fused


def _consistency(
    fused: list[np.ndarray], test: Flight, alike: float, rng: np.random.Generator
) -> dict[str, Any]:
    """How honest the receivers are; `alike` reports share an error and say so.

    Innovations are as large as ever where the covariance that is sent grew by so much: their ratio
    is expected to be 2 over that. Its band holds 95 % of the means of as many independent ones as
    there are in the flight.
    """
    first = _settled(test, FUSED_SETTLED_S)
    error, claimed, squared, nis = np.concatenate(
        [np.swapaxes(each[:, first:], 1, 2) for each in fused], axis=1
    )
    held = np.where(np.isfinite(squared), squared < HELD, np.nan)
    freedom = max(2.0, 2 * np.isfinite(nis).sum(axis=1).mean() / alike)
    low, high = 2 / alike * chi2.ppf((0.025, 0.975), freedom) / freedom
    return {
        "inside": mean_with_interval(held, rng),
        "nees": np.nanmean(squared),
        "error_cm": 100 * np.nanmean(error),
        "axis_cm": 100 * np.sqrt(np.nanmean(np.square(error)) / 2),
        "claimed_cm": 100 * np.sqrt(np.nanmean(np.square(claimed)) / 2),
        "nis": {"mean": np.nanmean(nis), "low": low, "high": high},
    }


def _sending(record: Record) -> list[str]:
    """Methods that sent anything."""
    return [name for name in record.values["order"] if name not in record.values["silent"]]


def finding(record: Record) -> str:
    """What the experiment found, a sentence a method."""
    said = []
    for name in record.values["order"]:
        values, label = record.values[name], METHODS[name]
        text = (
            f"{label[0].upper()}{label[1:]} has 90 % regions that cover "
            f"{percent(middle(values['within_90']))} of the frames"
        )
        if name in _sending(record):
            share = middle(values["ekf2"]["sent"]["inside"])
            said.append(f"{text}, and {percent(share)} where a receiver like EKF2 fuses them.")
        else:
            said.append(f"{text}. It is always lost, and sends nothing to fuse.")
    return " ".join(said)


def error_against_claim(record: Record) -> Figure:
    """Tenths of the frames by what was claimed; on the diagonal the claim is honest."""
    with canvas(size=(5.6, 4.6)) as (figure, axes):
        plot = axes[0, 0]
        for name in record.values["order"]:
            claimed, error = (
                [group[key] for group in record.series[name]] for key in ("claimed_cm", "error_cm")
            )
            plot.plot(claimed, error, "o-", color=COLORS[name], markersize=4, label=METHODS[name])
        ends = np.concatenate([line.get_xydata() for line in plot.lines])
        both = [ends[ends > 0].min(), ends.max()]
        plot.plot(both, both, color=COLORS["truth"], linewidth=0.9, linestyle="--")
        plot.set(
            xlabel="deviation claimed along an axis (cm)", xscale="log",
            ylabel="error along an axis (cm)", yscale="log",
        )  # fmt: skip
        plain_log_ticks(plot.xaxis, plot.yaxis)
        legend_above(plot)
    return figure


def availability(record: Record) -> Figure:
    """Error of the frames that are kept where those with the widest claims are refused."""
    with canvas(size=(5.6, 3.4)) as (figure, axes):
        plot, kept = axes[0, 0], np.arange(1, GROUPS + 1)
        for name in record.values["order"]:
            squared = np.square([group["error_cm"] for group in record.series[name]])
            left = np.sqrt(2 * squared.cumsum() / kept)
            plot.plot(100 * kept / GROUPS, left, "o-", color=COLORS[name], label=METHODS[name])
        plot.set(xlabel="frames kept (%)", ylabel="root mean square error (cm)", yscale="log")
        plain_log_ticks(plot.yaxis)
        legend_above(plot)
    return figure


def truth_in_the_region(record: Record) -> Figure:
    """Share of the time that the truth lies in the fused 90 % region, by method and receiver."""
    band, order = record.values["band"], _sending(record)
    with canvas(1, len(RECEIVERS), size=(7.2, 3.2), sharey=True) as (figure, axes):
        for plot, (receiver, settings) in zip(axes[0], RECEIVERS.items(), strict=True):
            honest = 100 * band["low"], 100 * band["high"]
            plot.axhspan(*honest, color=COLORS["zone"], alpha=0.2, linewidth=0, zorder=0)
            for place, name in enumerate(order):
                for offset, sent in zip((-0.15, 0.15), SENT, strict=True):
                    share = record.values[name][receiver][sent]["inside"]
                    with_intervals(
                        plot, np.array([place + offset]), [share], scale=100, color=COLORS[name],
                        fmt="o" if sent == "sent" else "s", markersize=6,
                        markerfacecolor=COLORS[name] if sent == "sent" else "white",
                        label=SENT[sent] if place == len(order) - 1 else None,
                    )  # fmt: skip
            plot.set_xticks(range(len(order)), [METHODS[name] for name in order], fontsize=8)
            plot.set(ylim=(0, 102), title=f"like {settings.label}")
            plot.grid(axis="x", visible=False)
        axes[0, 0].set_ylabel("truth in the fused 90 % region (%)")
        if order:
            axes[0, 0].legend(loc="center left", bbox_to_anchor=(-0.02, 0.65), fontsize=8)
    return figure


EXPERIMENT = Experiment(
    "Honest uncertainty", Parameters, run, finding,
    needs=POSITIONS, after=("mocap_training",), cost_s=40,
)  # fmt: skip
