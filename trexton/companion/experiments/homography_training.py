"""Training on homography positions (paper, Analysis, "Training Set based on Homography-finding
Method"). The map never sees motion capture.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter1d, median_filter

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.experiments.metrics import euclidean, summarize
from trexton.companion.experiments.mocap_training import train_and_fly
from trexton.companion.experiments.mosaic import locate_all, stitched_map
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.wording import lengths, middle
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap

OUTLIER_M = 0.4  # a fix that is this far from the running median was no motion of the vehicle
MEDIAN_FRAMES = 11
SMOOTHING_FRAMES = 2.0


def filtered_positions(position: np.ndarray) -> np.ndarray:
    """The remedy the paper suggests: fixes ``(N, 2)`` without outliers, smoothed over time, gaps
    interpolated.

    A fix counts as an outlier if it is more than 0.4 m from the running median over eleven frames.
    """
    rows = np.arange(len(position))
    kept = np.isfinite(position).all(axis=1)

    def filled(values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(rows, rows[kept], column[kept]) for column in values.T])

    running = median_filter(filled(position), size=(MEDIAN_FRAMES, 1), mode="nearest")
    kept &= euclidean(position, running) <= OUTLIER_M
    return gaussian_filter1d(filled(position), SMOOTHING_FRAMES, axis=0, mode="nearest")


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(10, "independent runs of the filter over the test flight", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """The motion-capture experiment again, its training positions from homographies on the flight's
    own mosaic.
    """
    picture = stitched_map(train).map
    position = locate_all(picture, train)
    sources = {"filter": position, "remedy": filtered_positions(position)}
    rng = stream(parameters.seed, "intervals")
    values: dict[str, Any] = {"mocap_process_std_cm": _process_std_cm(map_of(train, parameters))}
    series: dict[str, Any] = {}
    for name, positions in sources.items():
        texton_map, _, errors, drawn = train_and_fly(train, test, parameters, positions)
        values[name] = errors["filter"]
        values[f"{name}_knn"] = errors["knn"]
        values[f"{name}_process_std_cm"] = _process_std_cm(texton_map)
        values[f"{name}_training"] = summarize([positions], train.position, train.diagonal, rng=rng)
        series = series or drawn
        series[f"{name}_estimate_m"] = drawn["estimate_m"]
    return parameters.record(train, test, values=values, series=series)


def _process_std_cm(texton_map: TextonMap) -> float:
    """Root mean square over the axes of the process noise that the training positions give."""
    covariance = texton_map.parts["motion"].growth(texton_map.period_s)
    return 100 * float(np.sqrt(np.trace(covariance) / 2))


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    noise = [values[f"{name}_process_std_cm"] for name in ROWS]
    errors = [middle(values[name]["mean_cm"]) for name in ROWS]
    first, filtered = map(lengths(min(errors)), errors)
    text = f"Trained on homography positions the filter has an error of {first}, "
    text += f"and of {filtered} where they are filtered first."
    if np.argsort(noise).tolist() == np.argsort(errors)[::-1].tolist():
        text += (
            " Positions that jitter widen its motion noise, and a filter with more follows sooner."
        )
    return text


# place in the record: label and colour; both train the paper's filter, one as the paper does
ROWS = {
    "filter": ("homography positions", COLORS["paper"]),
    "remedy": ("filtered ones", COLORS["other"]),
}


def estimate_errors(record: Record) -> Figure:
    """Absolute error of the localizer over the test flight, trained on either set of positions."""
    series = record.series
    truth = np.array(series["truth_m"])
    with canvas(2, 1, size=(7.2, 4.2), sharex=True, sharey=True) as (figure, axes):
        for axis, (plot, name) in enumerate(zip(axes[:, 0], "xy", strict=True)):
            for key, (label, color) in ROWS.items():
                error = 100 * np.abs(np.array(series[f"{key}_estimate_m"]) - truth)[:, axis]
                line: dict[str, Any] = {"color": color, "linewidth": 1.0}
                plot.plot(series["time_s"], error, label=f"trained on {label}", **line)
                plot.axhline(error.mean(), linestyle="--", **line)
            plot.set_ylabel(f"error in {name} (cm)")
        axes[0, 0].set_ylim(0, None)
        legend_above(axes[0, 0])
        axes[1, 0].set_xlabel("time (s)")
    return figure


EXPERIMENT = Experiment(
    "Training on homography positions",
    Parameters,
    run,
    finding,
    needs=IMAGES,
    after=("mosaic", "homography_baseline", "mocap_training"),
    cost_s=115,
)
