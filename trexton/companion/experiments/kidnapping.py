"""Kidnapped and recovered (paper, Related Work: global methods and the kidnapped robot problem).

A recorded flight is cut: the vehicle has been localized for a while, and in the next frame it is
somewhere far away. How long does the filter take to follow, does it say that it is lost meanwhile,
and how often does it say so for nothing?
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from trexton.base.errors import FlightError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import drawn_histograms, map_of
from trexton.companion.experiments.metrics import euclidean
from trexton.companion.experiments.rates import success_rate
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.experiments.track import fly
from trexton.companion.wording import middle, number, percent
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method

# name: how it begins a sentence, method, choices, style of its line
FILTERS: dict[str, tuple[str, str, dict[str, object], dict[str, Any]]] = {
    "plain": ("The paper's filter", "paper", {"recovery": "none"}, {"color": COLORS["paper"]}),
    "augmented": (
        "With random particles it",
        "paper",
        {"recovery": "augmented"},
        {"color": COLORS["other"], "linestyle": "--"},
    ),
    "field": ("The field", "field", {}, {"color": COLORS["field"], "linestyle": "-."}),
}
SETTLED = 25  # frames, two seconds, in which the filter localizes the vehicle for the first time


class Trial(NamedTuple):
    """One kidnapping, between the frames `cut - 1` and `cut`: errors in metres, and whether the
    vehicle was called lost. Trials that are `carried` to one stretch of the flight share frames.
    """

    error: np.ndarray
    lost: np.ndarray
    cut: int
    carried: int = 0

    @property
    def calm(self) -> slice:
        """The undisturbed part, once it has settled."""
        return slice(min(SETTLED, self.cut // 2), self.cut)


def recovered_after(right: np.ndarray, consecutive: int) -> int | None:
    """Frames to the first of `consecutive` in a row that are right, or None."""
    for frame in range(len(right) - consecutive + 1):
        if right[frame : frame + consecutive].all():
            return frame
    return None


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    kidnappings: int = option(200, "drawn from one flight, the same for each filter", low=1)
    patience_s: float = option(
        10.0, "seconds that the filter has to localize the vehicle again", low=0
    )
    tolerance: float = option(1.0, "metres of error that count as localized", low=0)
    consecutive: int = option(5, "frames in a row within the tolerance", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Kidnap the vehicle again and again, with the paper's filter, with augmented Monte Carlo
    localization and with the field.
    """
    texton_map, frames = map_of(train, parameters), train.select(train.located)
    period = float(np.median(np.diff(test.time)))
    patience = min(round(parameters.patience_s / period), len(test) // 3)
    plan = _plan(test, parameters.kidnappings, patience, stream(parameters.seed, "plan"))
    rows = [
        np.r_[taken - patience : taken, carried : carried + patience] for taken, carried in plan
    ]
    samples = parameters.samples if test.has_images else None
    values: dict[str, Any] = {
        "patience_s": patience * period,
        "counts": {"kidnappings": len(plan), "train": len(train), "test": len(test)},
    }
    series = {}
    for name, (_, method, choices, _) in FILTERS.items():
        if method == "paper":
            choices = choices | {"particles": parameters.particles}
        flown = for_method(texton_map, method, flight=frames)
        histograms = drawn_histograms(test, flown, parameters.samples, parameters.seed)
        trial = partial(_trial, flown, histograms, test.position, choices, samples, parameters.seed)
        trials = spread(trial, list(enumerate(rows)), f"kidnappings, {method}")
        values[name], times = _outcome(trials, parameters, period)
        series[name] = {"recovery_s": times}
    return parameters.record(train, test, values=values, series=series)


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


def _trial(
    texton_map: TextonMap,
    histograms: np.ndarray,
    truth: np.ndarray,
    choices: Mapping[str, Any],
    samples: int | None,
    seed: int,
    numbered: tuple[int, np.ndarray],
) -> Trial:
    """One kidnapping: the frames of its rows, half before it and half after, flown with a filter of
    its own; the i-th draws from the i-th stream. `samples` were counted for each histogram.
    """
    number, rows = numbered
    cut = len(rows) // 2
    rng = stream(seed, "kidnappings", number)
    run = fly(Localizer(texton_map, rng=rng, **choices), histograms[rows], counted=samples)
    lost = np.array([estimate.lost_in(texton_map.area) for estimate in run.estimates])
    return Trial(run.errors(truth[rows]), lost, cut, int(rows[cut]) // cut)


def _outcome(
    trials: list[Trial], parameters: Parameters, period: float
) -> tuple[dict[str, Any], list[float]]:
    """Values of the trials of one filter, and the seconds to each recovery, sorted."""
    consecutive, tolerance = parameters.consecutive, parameters.tolerance
    recovered = [
        recovered_after(trial.error[trial.cut :] < tolerance, consecutive) for trial in trials
    ]
    after = np.array([np.inf if frames is None else period * frames for frames in recovered])
    times = np.sort(after[after < np.inf])
    stretches = [trial.carried for trial in trials]
    # Trials of one stretch of the flight are taken together.
    counts = np.bincount(stretches, after < np.inf).astype(int), np.bincount(stretches)
    calm = np.concatenate([trial.error[trial.calm] for trial in trials])
    return {
        "recovered_rate": success_rate(*counts),
        "recovery_s": {"median": np.percentile(times, 50)} if len(times) else None,
        "undisturbed_error_cm": 100 * calm.mean(),
        "lost": _lost(trials, recovered, tolerance),
    }, list(times)


def _lost(trials: list[Trial], recovered: list[int | None], tolerance: float) -> dict[str, Any]:
    """Shares of frames called lost: of wrong ones until the vehicle is localized again, and of
    undisturbed ones that are right.
    """
    wrong, right = [], []
    for trial, frames in zip(trials, recovered, strict=True):
        until = slice(trial.cut, None if frames is None else trial.cut + frames)
        wrong.append(trial.lost[until][trial.error[until] >= tolerance])
        right.append(trial.lost[trial.calm][trial.error[trial.calm] < tolerance])

    def share(flags: list[np.ndarray]) -> float | None:
        return np.concatenate(flags).mean() if sum(map(len, flags)) else None

    return {"wrong_frames_rate": share(wrong), "right_frames_rate": share(right)}


def finding(record: Record) -> str:
    """What the experiment found, a sentence a filter."""
    parts = []
    for key, (name, *_) in FILTERS.items():
        values = record.values[key]
        rate, after = middle(values["recovered_rate"]), values["recovery_s"]
        text = f"{name} recovers from {'every' if rate == 1 else percent(rate) + ' of the'} "
        text += "kidnapping" if rate == 1 else "kidnappings"
        if after:
            text += f", after {number(after['median'])} s in the median"
        wrong = values["lost"]["wrong_frames_rate"]
        if wrong is not None:
            text += f", and calls {percent(wrong)} of its wrong frames lost"
        parts.append(f"{text}.")
    return " ".join(parts)


def time_to_recover(record: Record) -> Figure:
    """Share of the kidnappings that the filter has recovered from, over time."""
    count, patience = record.values["counts"]["kidnappings"], record.values["patience_s"]
    with canvas(size=(6.4, 3.4)) as (figure, [[plot]]):
        for name, (words, *_, line) in FILTERS.items():
            times = record.series[name]["recovery_s"]
            shares = 100 * np.array([*range(len(times) + 1), len(times)]) / count
            label = words.removesuffix(" it")
            plot.step([0, *times, patience], shares, where="post", label=label, **line)
        plot.set(xlim=(0, patience), ylim=(0, 102))
        plot.set(xlabel="time since the kidnapping (s)", ylabel="recovered (%)")
        legend_above(plot)
    return figure


EXPERIMENT = Experiment(
    "Kidnapped and recovered", Parameters, run, finding, needs=POSITIONS, cost_s=65
)
