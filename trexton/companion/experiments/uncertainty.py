"""What a position's uncertainty is worth: by itself, and where an autopilot fuses it.

Consistency (NEES) and empirical coverage of several methods over one test flight, and the coverage
of receivers like EKF2 and EKF3 that fuse their reports with simulated accelerometers.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import mannwhitneyu

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import coverage, drawn_histograms, flown, method_map
from trexton.companion.experiments.metrics import mean_with_interval
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
from trexton.flights.flight import Flight
from trexton.localization.estimate import Estimate

METHODS = {"paper": "the paper's filter", "field": "the field"}
SETTLED_S = 2.0  # filters begin with no idea of the place
FUSED_SETTLED_S = 4.0  # and receivers with none of the velocity
FAR_M = 1.0  # an error that a claim should tell from smaller ones
GROUPS = 10
SENT = {"sent": "as it is sent", "plain": "as if independent"}
BAND = 0.8, 0.97  # of the truth in the fused 90 % region: that is honest


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
    repeats, counted = parameters.repeats, parameters.samples if test.has_images else None
    values: dict[str, Any] = {}
    series: dict[str, Any] = {}
    for name, label in METHODS.items():
        method = method_map(train, parameters, name)
        # All runs with the same histogram of each test frame.
        histograms = drawn_histograms(test, method, parameters.samples, seed)
        runs = tracks(method, histograms, repeats=repeats, seed=seed, label=label, counted=counted)
        judged, series[name] = _claimed(runs, test, stream(seed, "intervals"))
        quoted = flown(train, test, parameters, name, texton_map=method)
        flights = [track.estimates for track in runs]
        measured = flights[0][-1].measurement
        values[name] = judged | {
            "within_90": coverage(quoted, test, seed),
            "independent_s": None if measured is None else measured.independent_s,
        }
        if all(estimate.lost_in(test.area) for estimates in flights for estimate in estimates):
            continue
        for receiver, settings in RECEIVERS.items():
            # A report an age is news, whatever it shares with the one before.
            values[name][receiver] = {
                sent: _covered(
                    [_fuse(settings, one, every_s, test, pushes) for one in flights], test, seed
                )
                for sent, every_s in (("sent", period), ("plain", np.inf))
            }
    return parameters.record(train, test, values=values, series=series)


def _settled(test: Flight, after_s: float) -> slice:
    """The rows that count."""
    return slice(min(int(np.searchsorted(test.time, test.time[0] + after_s)), len(test) // 2), None)


def _claimed(
    runs: list[Track], test: Flight, rng: np.random.Generator
) -> tuple[dict[str, Any], list[dict[str, float]]]:
    """Errors against the covariance claimed, of the settled frames of all runs; and tenths of the
    frames by what was claimed: that, and the error made, cm an axis.
    """
    rows = _settled(test, SETTLED_S)
    truth = test.position[rows]
    covariance = np.array([run.covariance[rows] for run in runs])
    off = np.array([run.position[rows] - truth for run in runs])
    squared = np.einsum("rni,rnij,rnj->rn", off, np.linalg.inv(covariance), off)  # NEES: 2 if right
    error = np.array([run.errors(test.position)[rows] for run in runs])
    claimed = np.sqrt(np.trace(covariance, axis1=2, axis2=3) / 2)  # deviation along an axis
    far = error > FAR_M
    pairs = far.sum() * (~far).sum()
    values = {
        "far_auc": mannwhitneyu(claimed[far], claimed[~far])[0] / pairs if pairs else None,
        "axis_cm": 100 * np.sqrt(np.square(error).mean() / 2),
        "nees": mean_with_interval(squared, rng),
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


def _covered(believed: list[np.ndarray], test: Flight, seed: int) -> dict[str, Any]:
    """How often the truth lies in the 90 % region that receivers believe in, of all flights."""
    squared = np.concatenate([each[_settled(test, FUSED_SETTLED_S)].T for each in believed])
    held = np.where(np.isfinite(squared), squared < HELD, np.nan)
    return {"inside": mean_with_interval(held, stream(seed, "intervals"))}


def _fuse(
    settings: Settings, estimates: list[Estimate], every_s: float, test: Flight, pushes: np.ndarray
) -> np.ndarray:
    """``(N, R)`` squared errors of one flight in units of what its receivers believe, NaN before
    the first report.
    """
    receiver = Receiver(settings, pushes.shape[1])
    squared = np.full((len(estimates), pushes.shape[1]), np.nan)
    for row, (time, estimate) in enumerate(zip(test.time, estimates, strict=True)):
        if row and receiver.begun:
            receiver.drive(pushes[row - 1], float(time - test.time[row - 1]))
        if not estimate.lost_in(test.area):
            sent = estimate.for_fusion(every_s)
            receiver.fuse(float(time), sent.position, np.diagonal(sent.covariance))
        if receiver.begun:
            # In units of what is believed: 2 on average if that is honest.
            error = receiver.position - test.position[row]
            squared[row] = (error**2 / receiver.variance).sum(axis=1)
    return squared


def finding(record: Record) -> str:
    """What the experiment found, a sentence a method."""
    said = []
    for name, label in METHODS.items():
        values = record.values[name]
        text = (
            f"{label[0].upper()}{label[1:]} has 90 % regions that cover "
            f"{percent(middle(values['within_90']))} of the frames"
        )
        if "ekf2" in values:
            share = middle(values["ekf2"]["sent"]["inside"])
            said.append(f"{text}, and {percent(share)} where an autopilot fuses them as PX4 does.")
        else:
            said.append(f"{text}. It is always lost, and sends nothing to fuse.")
    return " ".join(said)


def error_against_claim(record: Record) -> Figure:
    """Tenths of the frames by what was claimed, on the diagonal honestly; and the error of those
    that are kept where the widest claims are refused.
    """
    with canvas(1, 2, size=(7.2, 3.6)) as (figure, axes):
        (claims, availability), kept = axes[0], np.arange(1, GROUPS + 1)
        for name, label in METHODS.items():
            claimed, error = (
                np.array([group[key] for group in record.series[name]], dtype=float)
                for key in ("claimed_cm", "error_cm")
            )
            claims.plot(claimed, error, "o-", color=COLORS[name], markersize=4, label=label)
            left = np.sqrt(2 * np.square(error).cumsum() / kept)
            availability.plot(100 * kept / GROUPS, left, "o-", color=COLORS[name], label=label)
        ends = np.concatenate([line.get_xydata() for line in claims.lines])
        both = [ends[ends > 0].min(), ends.max()]
        claims.plot(both, both, color=COLORS["truth"], linewidth=0.9, linestyle="--")
        claims.loglog()
        claims.set(xlabel="deviation claimed along an axis (cm)", ylabel="error along an axis (cm)")
        availability.set(xlabel="frames kept (%)", ylabel="RMS error (cm)", yscale="log")
        plain_log_ticks(claims.xaxis, claims.yaxis, availability.yaxis)
        legend_above(claims)
    return figure


# What is sent, the shift of its mark, its form, its face where that has not the method's colour.
_MARKS = (("sent", -0.15, "o", None), ("plain", 0.15, "s", "white"))


def truth_in_the_region(record: Record) -> Figure:
    """Share of the time that the truth lies in the fused 90 % region, by method and receiver."""
    order = [name for name in METHODS if "ekf2" in record.values[name]]
    with canvas(1, len(RECEIVERS), size=(7.2, 3.2), sharey=True) as (figure, axes):
        for plot, (receiver, settings) in zip(axes[0], RECEIVERS.items(), strict=True):
            low, high = (100 * share for share in BAND)
            plot.axhspan(low, high, color=COLORS["zone"], alpha=0.2, linewidth=0, zorder=0)
            for place, name in enumerate(order):
                mark: dict[str, Any] = {"color": COLORS[name], "markersize": 6, "scale": 100}
                for sent, offset, form, face in _MARKS:
                    at = np.array([place + offset])
                    share = record.values[name][receiver][sent]["inside"]
                    mark["label"] = SENT[sent] if place == len(order) - 1 else None
                    mark["markerfacecolor"] = face or COLORS[name]
                    with_intervals(plot, at, [share], fmt=form, **mark)
            plot.set_xticks(range(len(order)), [METHODS[name] for name in order], fontsize=8)
            plot.set(ylim=(0, 102), title=f"like {settings.label}")
            plot.grid(axis="x", visible=False)
        axes[0, 0].set_ylabel("truth in the fused 90 % region (%)")
        if order:
            axes[0, 0].legend(loc="center left", bbox_to_anchor=(-0.02, 0.65), fontsize=8)
    return figure


EXPERIMENT = Experiment(
    "Honest uncertainty", Parameters, run, finding, POSITIONS, ("mocap_training",), cost_s=40
)
