"""The pipeline on one real frame (paper, Introduction): all that Algorithm 1 drew and used.

The record holds patches, histogram, neighbours and particles of that frame; `pipeline` draws them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, PathPatch
from matplotlib.path import Path as Outline

from trexton.base.errors import FlightError
from trexton.base.progress import progress
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import floor_picture, map_of
from trexton.companion.experiments.style import COLORS, canvas, floor_axes, show_floor
from trexton.companion.wording import distance
from trexton.evaluation.metrics import euclidean
from trexton.flights.flight import Flight
from trexton.localization.localizer import Estimate, Localizer
from trexton.vision.images import bgr_from_yuv
from trexton.vision.patches import gather_patches, sample_positions
from trexton.vision.textons import TextonDictionary

_THUMBNAIL = 200  # pixels wide
_TRAIL_S = 4.0


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    frame: int | None = option(None, "number of the frame shown; None: that of the median error")


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Localize all frames of a flight and keep, of one, all that a picture of the method needs.

    Parameters
    ----------
    train, test : Flight
        With images.

    Raises
    ------
    FlightError
        The flight has no such frame, or no images.
    """
    texton_map = map_of(train, parameters)
    rng = stream(parameters.seed, "flight", 0)
    localizer = Localizer(
        texton_map, samples=parameters.samples, particles=parameters.particles, rng=rng
    )
    states, estimates = [], []
    for image in progress(test.images(), "localizing", len(test)):
        states.append(rng.bit_generator.state)
        estimates.append(localizer.step(image))
    track = np.array([estimate.position for estimate in estimates])
    errors = euclidean(track, test.position)
    row = _typical(errors) if parameters.frame is None else _row(test, parameters.frame)
    image, estimate = test.image(row), estimates[row]
    rng.bit_generator.state = states[row]
    drawn, labels = sampled_patches(image, texton_map.alphabet, parameters.samples, rng=rng)
    trail = np.flatnonzero((test.time <= test.time[row]) & (test.time >= test.time[row] - _TRAIL_S))
    floor, pictures = floor_picture(test)
    assert estimate.neighbors is not None  # the paper's method asks for them
    similar = estimate.neighbors.index
    offset = estimate.neighbors.position.mean(axis=0) - test.position[row]
    return parameters.record(
        train,
        test,
        values={
            "frame": test.frame[row],
            "time_s": test.time[row] - test.time[0],
            "error_cm": 100 * errors[row],
            "median_error_cm": 100 * np.median(errors),
            "neighbors_error_cm": 100 * np.hypot(*offset),
            "spread_cm": 100 * estimate.spread,
            "neighbors": {"frame": train.frame[similar], "distance": estimate.neighbors.distance},
            "image_shape": image.shape[:2],
            "patch": texton_map.alphabet.patch,
        },
        series={
            "patches": drawn,
            "labels": labels,
            "area_m": test.area,
            "truth_m": test.position[row],
            "truth_trail_m": test.position[trail],
            "estimate_trail_m": track[trail],
            **_belief(estimate),
            **floor,
        },
        images={
            **pictures,
            "frame": bgr_from_yuv(image),
            "textons": _texton_strip(texton_map.alphabet),
            "similar": np.concatenate(
                [_thumbnail(train.image(index)) for index in similar], axis=1
            ),
        },
    )


def sampled_patches(
    image: np.ndarray, dictionary: TextonDictionary, samples: int, *, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Where `trexton.vision.histograms.sampled_histogram` looks with this `rng`, and what it finds.

    Returns
    -------
    positions : (n, 2) int array
        Row and column of each patch.
    labels : (n,) int array
        Nearest textons.
    """
    positions = sample_positions(image.shape, dictionary.patch, samples, rng)
    return positions, dictionary.label(gather_patches(image, positions, dictionary.patch))


def _belief(estimate: Estimate) -> dict[str, Any]:
    assert estimate.neighbors is not None
    return {
        "histogram": estimate.histogram,
        "neighbors_m": estimate.neighbors.position,
        "particles_m": estimate.particles,
        "weights": estimate.weights,
        "estimate_m": estimate.position,
        "covariance_m2": estimate.covariance,
    }


def _typical(errors: np.ndarray) -> int:
    """The row of the lower median error."""
    return int(np.argsort(errors, kind="stable")[(len(errors) - 1) // 2])


def _row(flight: Flight, frame: int) -> int:
    rows = np.flatnonzero(flight.frame == frame)
    if not len(rows):
        raise FlightError(
            f"flight {flight.name!r} has no frame {frame}: "
            f"choose one from {flight.frame[0]} to {flight.frame[-1]}, or None"
        )
    return int(rows[0])


def _texton_strip(dictionary: TextonDictionary) -> np.ndarray:
    """``(P, K P, 3) uint8`` BGR: all textons side by side."""
    return bgr_from_yuv(np.concatenate(list(dictionary.textons), axis=1))


def _thumbnail(image: np.ndarray) -> np.ndarray:
    rows, columns = image.shape[:2]
    size = (_THUMBNAIL, max(1, round(_THUMBNAIL * rows / columns)))
    return cv2.resize(bgr_from_yuv(image), size, interpolation=cv2.INTER_AREA)


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    typical = ", that of the median error," if record.parameters["frame"] is None else ""
    count = len(values["neighbors"]["frame"])
    voted = "its nearest training frame" if count == 1 else f"the mean of its {count} neighbours"
    off, voted_off = values["error_cm"], values["neighbors_error_cm"]
    if distance(off) == distance(voted_off):  # no more is told apart than is said
        than = "as far as"
    else:
        than = "farther than" if off > voted_off else "nearer than"
    return (
        f"At frame {values['frame']}{typical} the filter is {distance(off)} off, {than} {voted} "
        f"({distance(voted_off)}), and claims a deviation of "
        f"{distance(np.hypot(*values['spread_cm']))}."
    )


_MARK: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.8, "linestyle": "none"}
_ON_NEIGHBORS = "#111111"  # on their colour, in either theme


def pipeline(record: Record) -> Figure:
    """Image and patches, histogram, nearest training images; their places, particles, position."""
    steps = (
        ("Image, {samples} random patches", _image),
        ("Texton histogram", _histogram),
        ("{neighbors} nearest training images", _similar),
        ("Where those were taken", _neighbors),
        ("{particles} weighted particles", _particles),
        ("Position, {error_cm:.0f} cm off", _position),
    )
    with canvas(2, 3, size=(9, 5.9), height_ratios=(0.8, 1)) as (figure, axes):
        for number, (axis, (title, draw)) in enumerate(zip(axes.flat, steps, strict=True), start=1):
            draw(axis, record)
            title = title.format(**record.parameters | {"error_cm": record.values["error_cm"]})
            axis.set_title(f"{number}  {title}", fontsize=10)
        for plan in axes[1, 1:]:
            plan.set_ylabel("")
    return figure


def _colors(record: Record) -> np.ndarray:
    """``(K, 3)``: the mean colour of each texton, 0 to 1."""
    strip, patch = record.images["textons"], record.values["patch"]
    return np.asarray(strip[..., ::-1].reshape(patch, -1, patch, 3).mean(axis=(0, 2)) / 255)


def _bare(axes: Axes) -> None:
    axes.grid(False)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)


def _image(axes: Axes, record: Record) -> None:
    picture, patch = record.images["frame"][..., ::-1], record.values["patch"]
    rows, columns = picture.shape[:2]
    pale = 255 - (255 - picture.astype(float)) * 0.55
    axes.imshow(pale.astype(np.uint8), extent=(0, columns, rows, 0), interpolation="bilinear")
    square = patch * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    corners = np.array(record.series["patches"])[:, None, ::-1] + square
    colors = _colors(record)[record.series["labels"]]
    # A bright edge with a dark rim stands out from any floor; no theme turns these two round.
    rims = Outline.make_compound_path_from_polys(corners)
    axes.add_patch(PathPatch(rims, facecolor="none", edgecolor="#111111", linewidth=1.3))
    axes.add_collection(
        PolyCollection(corners, facecolors=colors, edgecolors="#fafafa", linewidths=0.45)
    )
    _bare(axes)


def _histogram(axes: Axes, record: Record) -> None:
    histogram, strip = np.array(record.series["histogram"]), record.images["textons"][..., ::-1]
    count = len(histogram)
    style: dict[str, Any] = {"color": _colors(record), "edgecolor": "#555555", "linewidth": 0.5}
    axes.bar(np.arange(count), 100 * histogram, width=0.9, **style)
    # The textons themselves stand under their bars.
    pictures = axes.inset_axes((0, -0.1, 1, 0.075))
    for index, texton in enumerate(np.split(strip, count, axis=1)):
        pictures.imshow(texton, extent=(index - 0.42, index + 0.42, 0, 1), aspect="auto")
    for axis in (axes, pictures):
        axis.set(xlim=(-0.7, count - 0.3), xticks=[])
    pictures.set_ylim(0, 1)
    _bare(pictures)
    axes.grid(False, axis="x")
    axes.set(ylabel="frequency (%)")
    axes.set_xlabel("texton", labelpad=17)


def _similar(axes: Axes, record: Record) -> None:
    """The most similar image large, the others in a column beside it, all of one shape."""
    pictures = np.split(record.images["similar"][..., ::-1], record.parameters["neighbors"], axis=1)
    shape = pictures[0].shape[1] / pictures[0].shape[0]
    others = len(pictures) - 1
    gap, height = 0.02, 1 / max(others, 1)
    axes.imshow(pictures[0], extent=(0, shape, 0, 1), interpolation="bilinear")
    _number(axes, 1, (0.03, 0.97))
    for index, picture in enumerate(pictures[1:]):
        top, left = 1 - index * height, shape + gap
        bottom = top - height + (gap if index < others - 1 else 0)
        extent = (left, left + (top - bottom) * shape, bottom, top)
        axes.imshow(picture, extent=extent, interpolation="bilinear")
        if others <= 6:
            _number(axes, index + 2, (left + 0.015, top - 0.015), size=7.5)
    axes.set(xlim=(0, shape + (gap + height * shape if others else 0)), ylim=(0, 1), aspect="equal")
    _bare(axes)


def _number(axes: Axes, number: int, at: tuple[float, float], size: float = 10) -> None:
    box: dict[str, Any] = {
        "boxstyle": "circle,pad=0.2",
        "facecolor": COLORS["neighbors"],
        "edgecolor": "white",
        "linewidth": 0.6,
    }
    style: dict[str, Any] = {
        "color": _ON_NEIGHBORS,
        "fontsize": size,
        "fontweight": "bold",
        "ha": "left",
        "va": "top",
    }
    axes.text(*at, str(number), bbox=box, **style)


def _plan(axes: Axes, record: Record) -> None:
    floor_axes(axes, record.series["area_m"])
    show_floor(axes, record.series.get("floor"), record.images.get("floor"))


def _truth(axes: Axes, record: Record) -> None:
    axes.plot(
        *record.series["truth_m"], "X", color=COLORS["truth"], markersize=10, label="truth", **_MARK
    )


def _legend(axes: Axes, columns: int = 2) -> None:
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncols=columns,
        handletextpad=0.3,
        columnspacing=1.2,
    )


def _neighbors(axes: Axes, record: Record) -> None:
    _plan(axes, record)
    _truth(axes, record)
    places = record.series["neighbors_m"]
    # The nearest on top, each number with its own disc.
    for rank, place in enumerate(places, start=1):
        label = "neighbours" if rank == 1 else None
        axes.plot(
            *place,
            "o",
            color=COLORS["neighbors"],
            markersize=10,
            label=label,
            zorder=4 - rank / 100,
            **_MARK,
        )
        if len(places) <= 9:
            style: dict[str, Any] = {
                "color": _ON_NEIGHBORS,
                "fontsize": 7.5,
                "ha": "center",
                "va": "center_baseline",
            }
            axes.annotate(str(rank), place, fontweight="bold", zorder=4.005 - rank / 100, **style)
    _legend(axes)


def _particles(axes: Axes, record: Record) -> None:
    _plan(axes, record)
    places, weights = np.array(record.series["particles_m"]), np.array(record.series["weights"])
    look: dict[str, Any] = {
        "color": COLORS["particles"],
        "alpha": 0.7,
        "edgecolors": "white",
        "linewidths": 0.5,
    }
    x, y = places.T
    sizes = 6 + 110 * weights / weights.max()
    axes.scatter(x, y, s=sizes, label="particles, size by weight", **look)
    _truth(axes, record)
    _legend(axes)


def _position(axes: Axes, record: Record) -> None:
    _plan(axes, record)
    series = record.series
    axes.plot(*np.array(series["truth_trail_m"]).T, color=COLORS["truth"], linewidth=1.6)
    axes.plot(
        *np.array(series["estimate_trail_m"]).T, color=COLORS["paper"], linewidth=0.9, alpha=0.8
    )
    _truth(axes, record)
    axes.plot(
        *series["estimate_m"],
        "o",
        color=COLORS["paper"],
        markersize=9,
        label="estimate",
        **_MARK,
    )
    variances, directions = np.linalg.eigh(np.array(series["covariance_m2"]))
    center = np.array(series["weights"]) @ np.array(series["particles_m"])
    width, height = 2 * np.sqrt(np.maximum(variances, 0))
    angle = np.degrees(np.arctan2(directions[1, 0], directions[0, 0]))
    axes.add_patch(
        Ellipse(
            center,
            width,
            height,
            angle=angle,
            fill=False,
            edgecolor=COLORS["paper"],
            linestyle="--",
        )
    )
    _legend(axes)


EXPERIMENT = Experiment(
    "The pipeline in one picture", Parameters, run, finding, needs=IMAGES, cost_s=8
)
