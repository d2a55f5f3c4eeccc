"""Carried away and found again (paper, Related Work: global methods address the kidnapped robot
problem).

A recorded flight is cut: the vehicle has been localized for a while, and in the next frame it is
somewhere far away. How long does the filter take to follow, does it say that it is lost meanwhile,
and how often does it say so for nothing?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.errors import FlightError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import drawn_histograms, map_of
from trexton.companion.experiments.style import COLORS, band, canvas, legend_above, share_over_time
from trexton.companion.experiments.track import fly
from trexton.companion.wording import number, percent
from trexton.evaluation.metrics import euclidean, success_rate
from trexton.flights.flight import Flight
from trexton.localization.estimate import LOST_SHARE, ignorance
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method

# name: method, choices
FILTERS: dict[str, tuple[str, dict[str, object]]] = {
    "plain": ("paper", {"recovery": "none"}),
    "augmented": ("paper", {"recovery": "augmented"}),
    "field": ("field", {}),
}
IN_TIME_S = 3.0
SETTLED = 25  # frames, two seconds, in which the filter finds the vehicle for the first time
FAR = 2.0  # tolerances: a frame so far off is elsewhere, and not beside its place
# Of ignorance, at which the vehicle could be called lost.
SHARES = np.round(np.arange(0.1, 1.51, 0.05), 2)


@dataclass(frozen=True, eq=False)
class Trial:
    """One kidnapping: errors in metres, the cloud's width as a share of knowing nothing, and the
    filter's own `lost`.

    The arrays start with the undisturbed part; the kidnapping lies between the frames `cut - 1` and
    `cut`. `taken` and `carried` number the stretches of the flight, as long as the patience, that
    the two parts begin in: trials of one stretch share frames.
    """

    error: np.ndarray
    width: np.ndarray
    lost: np.ndarray
    cut: int
    taken: int = 0
    carried: int = 0

    @property
    def calm(self) -> slice:
        """The undisturbed part, once it has settled."""
        return slice(min(SETTLED, self.cut // 2), self.cut)

    def found_after(self, tolerance: float, consecutive: int) -> int | None:
        """Frames to the first of `consecutive` in a row within `tolerance` metres, or None."""
        return found_after(self.error[self.cut :] < tolerance, consecutive)


def found_after(right: np.ndarray, consecutive: int) -> int | None:
    """Frames to the first of `consecutive` in a row that are right, or None."""
    for frame in range(len(right) - consecutive + 1):
        if right[frame : frame + consecutive].all():
            return frame
    return None


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    kidnappings: int = option(200, "drawn from one flight, the same for each filter", low=1)
    patience_s: float = option(10.0, "seconds that the filter has to find the vehicle again", low=0)
    tolerance: float = option(1.0, "metres of error that count as found", low=0)
    consecutive: int = option(5, "frames in a row within the tolerance", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Kidnap the vehicle again and again, with the paper's filter, with augmented Monte Carlo
    localization and with the field.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms.
    """
    texton_map, frames = map_of(train, parameters), train.select(train.located)
    period = float(np.median(np.diff(test.time)))
    patience = min(round(parameters.patience_s / period), len(test) // 3)
    plan = _plan(test, parameters.kidnappings, patience, stream(parameters.seed, "plan"))
    values: dict[str, Any] = {}
    series = {"time_s": np.arange(patience) * period, "shares": SHARES, "area_m": test.area}
    for name, (method, choices) in FILTERS.items():
        if method == "paper":
            choices = choices | {"particles": parameters.particles}
        flown = for_method(texton_map, method, flight=frames)
        trials = filter_trials(
            flown,
            drawn_histograms(test, flown, parameters.samples, parameters.seed),
            test.position,
            plan,
            patience,
            choices,
            samples=parameters.samples if test.has_images else None,
            seed=parameters.seed,
        )
        values[name] = _values(trials, parameters.tolerance, parameters.consecutive, period)
        series[name] = _series(trials, parameters.tolerance, parameters.consecutive, period)
    distances = euclidean(*test.position[plan.T])
    return parameters.record(
        train,
        test,
        values=values
        | {
            "distance_m": {"median": np.median(distances), "shortest": distances.min()},
            "patience_s": patience * period,
            "lost_share": LOST_SHARE,
            "counts": {
                "kidnappings": len(plan),
                "train": len(texton_map.positions),
                "test": len(test),
            },
        },
        series=series,
    )


def _plan(test: Flight, count: int, patience: int, rng: np.random.Generator) -> np.ndarray:
    """``(count, 2)`` rows: the frame after which the vehicle is taken, and the frame to which it is
    carried.

    At least half the longer side of the area lies between the two, `patience` frames before the
    first and after the second.
    """
    x_min, x_max, y_min, y_max = test.area
    far = max(x_max - x_min, y_max - y_min) / 2
    starts, targets = np.arange(patience, len(test)), np.arange(len(test) - patience + 1)
    apart = euclidean(test.position[targets], test.position[starts][:, None])
    pairs = np.argwhere(apart >= far)
    if not len(pairs):
        raise FlightError(
            f"flight {test.name!r} has no two places {far:.1f} m apart, {patience} frames from its "
            "ends: fly longer"
        )
    chosen = pairs[rng.integers(len(pairs), size=count)]
    return np.column_stack([starts[chosen[:, 0]], targets[chosen[:, 1]]])


def filter_trials(
    texton_map: TextonMap,
    histograms: np.ndarray,
    truth: np.ndarray,
    plan: np.ndarray,
    patience: int,
    choices: Mapping[str, object],
    *,
    samples: int | None = None,
    seed: int,
) -> list[Trial]:
    """Fly every kidnapping of the `plan` with a filter of its own; trial i draws from the i-th
    stream. `samples` were counted for each of the histograms.
    """
    rows = [
        np.r_[taken - patience : taken, carried : carried + patience] for taken, carried in plan
    ]
    trial = partial(_trial, texton_map, histograms, truth, patience, choices, samples, seed)
    return spread(trial, list(enumerate(rows)), f"kidnappings, {texton_map.method}")


def _trial(
    texton_map: TextonMap,
    histograms: np.ndarray,
    truth: np.ndarray,
    patience: int,
    choices: Mapping[str, Any],
    samples: int | None,
    seed: int,
    numbered: tuple[int, np.ndarray],
) -> Trial:
    """One kidnapping: the frames of its rows, flown with a filter of its own."""
    number, rows = numbered
    nothing = float(np.hypot(*ignorance(texton_map.area)))
    rng = stream(seed, "kidnappings", number)
    run = fly(Localizer(texton_map, rng=rng, **choices), histograms[rows], counted=samples)
    return Trial(
        run.errors(truth[rows]),
        np.sqrt([np.trace(estimate.about_position) for estimate in run.estimates]) / nothing,
        run.lost,
        patience,
        taken=int(rows[0]) // patience,
        carried=int(rows[patience]) // patience,
    )


def _rate(outcomes: Sequence[bool], stretches: Sequence[int]) -> dict[str, Any] | None:
    """The share of trials that came out so, those of one stretch of the flight taken together."""
    return success_rate(np.bincount(stretches, outcomes).astype(int), np.bincount(stretches))


def _values(
    trials: list[Trial], tolerance: float, consecutive: int, period: float
) -> dict[str, Any]:
    found = [trial.found_after(tolerance, consecutive) for trial in trials]
    after = [np.inf if frames is None else period * frames for frames in found]
    times = [seconds for seconds in after if seconds < np.inf]
    control = [found_after(trial.error[trial.calm] < tolerance, consecutive) for trial in trials]
    taken, carried = ([getattr(trial, end) for trial in trials] for end in ("taken", "carried"))
    return {
        "recovered_rate": _rate([seconds < np.inf for seconds in after], carried),
        "in_time_rate": _rate([seconds <= IN_TIME_S for seconds in after], carried),
        "recovery_s": dict(
            zip(("median", "p90", "longest"), np.percentile(times, (50, 90, 100)), strict=False)
        )
        if times
        else None,
        "control_rate": _rate([frames is not None for frames in control], taken),
        "undisturbed_error_cm": 100
        * np.concatenate([trial.error[trial.calm] for trial in trials]).mean(),
        "lost": _lost(
            trials, [trial.lost | (trial.width > LOST_SHARE) for trial in trials], found, tolerance
        ),
        "lost_by_fit": _lost(trials, [trial.lost for trial in trials], found, tolerance),
    }


def _lost(
    trials: list[Trial], flags: list[np.ndarray], found: list[int | None], tolerance: float
) -> dict[str, Any]:
    """How well lost frames are detected: in which share of kidnappings, of wrong frames until
    found, of those that are far off, of calm frames.
    """
    declared, stretches, wrongs, fars, calms, errors = [], [], [], [], [], []
    for trial, lost, frames in zip(trials, flags, found, strict=False):
        end = len(trial.error) if frames is None else trial.cut + frames
        if end > trial.cut:
            declared.append(bool(lost[trial.cut : end].any()))
            stretches.append(trial.carried)
            error = trial.error[trial.cut : end]
            wrongs.append(lost[trial.cut : end][error >= tolerance])
            fars.append(lost[trial.cut : end][error >= FAR * tolerance])
        calms.append(lost[trial.calm])
        errors.append(trial.error[trial.calm])
    calm, calm_error = np.concatenate(calms), np.concatenate(errors)
    wrong, far = np.concatenate([[], *wrongs]), np.concatenate([[], *fars])
    right = calm_error < tolerance
    return {
        "declared_rate": _rate(declared, stretches),
        "wrong_frames_rate": wrong.mean() if len(wrong) else None,
        "wrong_frames": len(wrong),
        "far_frames_rate": far.mean() if len(far) else None,
        "far_frames": len(far),
        "calm_frames_rate": calm.mean(),
        "right_frames_rate": calm[right].mean() if right.any() else None,
        "calm_error_cm": {
            "lost": 100 * calm_error[calm].mean() if calm.any() else None,
            "not_lost": 100 * calm_error[~calm].mean() if not calm.all() else None,
        },
    }


def _series(
    trials: list[Trial], tolerance: float, consecutive: int, period: float
) -> dict[str, Any]:
    found = [trial.found_after(tolerance, consecutive) for trial in trials]
    error = np.array([trial.error[trial.cut :] for trial in trials])
    lost = np.array([(trial.lost | (trial.width > LOST_SHARE))[trial.cut :] for trial in trials])
    shares = [
        _lost(trials, [trial.width > share for trial in trials], found, tolerance)
        for share in SHARES
    ]
    return {
        "recovery_s": sorted(period * frames for frames in found if frames is not None),
        "error_m": dict(
            zip(("low", "median", "high"), np.percentile(error, (10, 50, 90), axis=0), strict=False)
        ),
        "lost": lost.mean(axis=0),
        "detection_rate": [entry["wrong_frames_rate"] for entry in shares],
        "false_alarm_rate": [entry["calm_frames_rate"] for entry in shares],
    }


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    names = {"plain": "The paper's filter", "augmented": "with random particles it",
             "field": "the field"}  # fmt: skip
    parts = []
    for key, name in names.items():
        values = record.values[key]
        rate, after = percent(values["recovered_rate"]), values["recovery_s"]
        when = f" after {number(after['median'])} s in the median" if after else ""
        wrong = values["lost"]["wrong_frames_rate"]
        lost = (
            "has no wrong frame to call lost"
            if wrong is None
            else f"calls {percent(wrong)} of its wrong frames lost"
        )
        parts.append(
            f"{name} finds the vehicle again in {rate} of the kidnappings{when}, and {lost}"
        )
    return "; ".join(parts) + "."


_FILTERS = {
    "plain": ("the paper's filter", COLORS["paper"], "-"),
    "augmented": ("with random particles", COLORS["guarded"], "--"),
    "field": ("the field", COLORS["field"], "-."),
}


def time_to_recover(record: Record) -> Figure:
    """Share of the kidnappings after which the vehicle has been found again, over time."""
    counts, patience = record.values["counts"], record.values["patience_s"]
    with canvas(size=(6.4, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        for name, (label, color, style) in _FILTERS.items():
            share_over_time(
                plot, record.series[name]["recovery_s"], counts["kidnappings"], patience,
                color=color, linestyle=style, label=label,
            )  # fmt: skip
        plot.set(xlabel="time since the kidnapping (s)", ylabel="localized again (%)")
        legend_above(plot)
    return figure


def error_since(record: Record) -> Figure:
    """Median error after a kidnapping with the range of four fifths, and the share called lost."""
    time = np.array(record.series["time_s"])
    with canvas(2, 1, size=(6.4, 4.8), sharex=True, height_ratios=(3, 2)) as (figure, axes):
        error, lost = axes[:, 0]
        for name, (label, color, style) in _FILTERS.items():
            spans = record.series[name]["error_m"]
            band(
                error, time, spans["low"], spans["median"], spans["high"], color=color,
                linestyle=style, label=label,
            )  # fmt: skip
            share = 100 * np.array(record.series[name]["lost"])
            lost.plot(time, share, color=color, linestyle=style)
        tolerance = record.parameters["tolerance"]
        error.axhline(tolerance, color=COLORS["truth"], linestyle=":", label="counts as localized")
        error.set(ylabel="error (m)", ylim=(0, None))
        lost.set(xlabel="time since the kidnapping (s)", ylabel="called lost (%)")
        lost.set(ylim=(0, None), xlim=(0, time[-1]))
        legend_above(error)
    return figure


def lost_told(record: Record) -> Figure:
    """What a width of the cloud, taken as "lost", detects of wrong frames, and its false alarms
    among calm ones; and the field's own flag."""
    series, values = record.series["augmented"], record.values["augmented"]
    shares, detected, false_alarms = (
        100 * np.array(column, dtype=float)
        for column in (
            record.series["shares"],
            series["detection_rate"],
            series["false_alarm_rate"],
        )
    )
    with canvas(size=(6.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        label = "the cloud's width alone"
        plot.plot(
            false_alarms, detected, color=COLORS["guarded"], marker="o", markersize=4, label=label
        )
        for share in (30, 50):  # above the curve, where nothing else is
            at = int(np.argmin(np.abs(shares - share)))
            if false_alarms[at] > 50:
                continue
            plot.annotate(
                f"{share} %", (false_alarms[at], detected[at]), xytext=(-5, 5), ha="right",
                fontsize=9, textcoords="offset points",
            )  # fmt: skip
        for point, label, color, marker in (
            (values["lost_by_fit"], "the filter's fit alone", COLORS["guarded"], "D"),
            (values["lost"], "both, as on board", COLORS["guarded"], "s"),
            (record.values["field"]["lost"], "the field", COLORS["field"], "^"),
        ):
            if point["wrong_frames_rate"] is not None:
                calm, wrong = 100 * point["calm_frames_rate"], 100 * point["wrong_frames_rate"]
                plot.plot(
                    calm,
                    wrong,
                    marker,
                    color=color,
                    markersize=8,
                    markeredgecolor="white",
                    label=label,
                )
        plot.set(xlabel="of undisturbed frames called lost (%)", xlim=(-1, 50))
        plot.set(ylabel="of wrong frames called lost (%)", ylim=(-2, 102))
        legend_above(plot)
    return figure


EXPERIMENT = Experiment(
    "Carried away and found again", Parameters, run, finding, needs=POSITIONS, cost_s=65
)
