"""The pipeline on one real frame (paper, Introduction): all that Algorithm 1 drew and used.

The record holds patches, histogram, neighbours and particles of that frame; `pipeline` draws them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from trexton.base.progress import progress
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, MapParameters
from trexton.companion.experiments.evaluation import floor_picture, map_of
from trexton.companion.experiments.style import (
    COLORS,
    bare,
    canvas,
    floor_axes,
    legend_below,
    show_floor,
)
from trexton.companion.experiments.texton_dictionary import texton_strip, tiles
from trexton.companion.wording import distance
from trexton.evaluation.metrics import euclidean
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.vision.images import bgr_from_yuv, gather_patches, sample_positions


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Localize all frames of a flight and keep, of the one with the median error, all that a
    picture of the method needs.

    Parameters
    ----------
    train, test : Flight
        With images.
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
    errors = euclidean(np.array([each.position for each in estimates]), test.position)
    row = int(np.argsort(errors, kind="stable")[(len(errors) - 1) // 2])  # the lower median
    image, estimate = test.image(row), estimates[row]
    rng.bit_generator.state = states[row]  # the patches of this frame are drawn once more
    patch = texton_map.alphabet.patch
    patches = sample_positions(image.shape, patch, parameters.samples, rng)
    assert estimate.neighbors is not None  # the paper's method asks for them
    voted = estimate.neighbors.position
    floor, pictures = floor_picture(test)
    return parameters.record(
        train,
        test,
        values={
            "frame": test.frame[row],
            "error_cm": 100 * errors[row],
            "neighbors_error_cm": 100 * euclidean(voted.mean(axis=0), test.position[row]),
            "spread_cm": 100 * estimate.spread,
            "neighbors": {"frame": train.frame[estimate.neighbors.index]},
            "patch": patch,
        },
        series={
            "patches": patches,
            "labels": texton_map.alphabet.label(gather_patches(image, patches, patch)),
            "histogram": estimate.histogram,
            "neighbors_m": voted,
            "particles_m": estimate.particles,
            "weights": estimate.weights,
            "estimate_m": estimate.position,
            "truth_m": test.position[row],
            "area_m": test.area,
            **floor,
        },
        images={
            **pictures,
            "frame": bgr_from_yuv(image),
            "textons": texton_strip(texton_map.alphabet),
        },
    )


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    values = record.values
    count, spread = len(values["neighbors"]["frame"]), np.hypot(*values["spread_cm"])
    voted = "Its nearest training frame" if count == 1 else f"The mean of its {count} neighbours"
    return (
        f"At frame {values['frame']}, that of the median error, the filter is "
        f"{distance(values['error_cm'])} off, and its spread is {distance(spread)}. {voted} is "
        f"{distance(values['neighbors_error_cm'])} off."
    )


_MARK: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.8, "linestyle": "none"}


def pipeline(record: Record) -> Figure:
    """Image and patches, histogram; the places of the neighbours, particles and estimate."""
    series, error_cm = record.series, record.values["error_cm"]
    with canvas(2, 2, size=(7.2, 6.6), height_ratios=(0.8, 1)) as (figure, axes):
        (image, histogram), (neighbors, particles) = axes
        _image(image, record)
        _histogram(histogram, record)
        places = np.transpose(series["neighbors_m"])
        disc: dict[str, Any] = {"color": COLORS["neighbors"], "markersize": 10, **_MARK}
        neighbors.plot(*places, "o", label="neighbours", **disc)
        (x, y), weights = np.array(series["particles_m"]).T, np.array(series["weights"])
        look: dict[str, Any] = {"color": COLORS["particles"], "edgecolors": "white"}
        sizes = 6 + 110 * weights / weights.max()
        particles.scatter(
            x, y, s=sizes, alpha=0.7, linewidths=0.5, label="particles, size by weight", **look
        )
        estimate: dict[str, Any] = {"color": COLORS["paper"], "markersize": 9, "zorder": 3}
        particles.plot(*series["estimate_m"], "o", label="estimate", **estimate, **_MARK)
        for plan in (neighbors, particles):
            floor_axes(plan, series["area_m"])
            show_floor(plan, series.get("floor"), record.images.get("floor"))
            truth: dict[str, Any] = {"color": COLORS["truth"], "markersize": 10, "label": "truth"}
            plan.plot(*series["truth_m"], "X", **truth, **_MARK)
            legend_below(plan, 0.16, columns=3)
        particles.set_ylabel("")
        titles = (
            "Image, {samples} random patches",
            "Texton histogram",
            "Where the {neighbors} neighbours were taken",
            f"{{particles}} particles, estimate {error_cm:.0f} cm off",
        )
        for number, (axis, title) in enumerate(zip(axes.flat, titles, strict=True), start=1):
            axis.set_title(f"{number}  {title.format(**record.parameters)}", fontsize=10)
    return figure


def _colors(record: Record) -> np.ndarray:
    """``(K, 3)``: the mean colour of each texton, 0 to 1."""
    return np.array([tile.mean(axis=(0, 1)) for tile in tiles(record)]) / 255


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
    bare(axes)


def _histogram(axes: Axes, record: Record) -> None:
    histogram = np.array(record.series["histogram"])
    count = len(histogram)
    style: dict[str, Any] = {"color": _colors(record), "edgecolor": "#555555", "linewidth": 0.5}
    axes.bar(np.arange(count), 100 * histogram, width=0.9, **style)
    # The textons themselves stand under their bars.
    pictures = axes.inset_axes((0, -0.1, 1, 0.075))
    for index, tile in enumerate(tiles(record)):
        pictures.imshow(tile, extent=(index - 0.42, index + 0.42, 0, 1), aspect="auto")
    for axis in (axes, pictures):
        axis.set(xlim=(-0.7, count - 0.3), xticks=[])
    pictures.set_ylim(0, 1)
    bare(pictures)
    axes.grid(False, axis="x")
    axes.set(ylabel="frequency (%)")


EXPERIMENT = Experiment(
    "The pipeline in one picture", Parameters, run, finding, needs=IMAGES, cost_s=8
)
