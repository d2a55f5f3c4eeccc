"""The texton dictionary (paper, Methods, "Texton Dictionary Generation"): textons, learning,
places.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.defaults import TEXTONS
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.experiments.evaluation import floor_picture, trained_map
from trexton.companion.experiments.style import SERIES, canvas, legend_below
from trexton.companion.wording import number
from trexton.flights.flight import Flight
from trexton.vision.histograms import label_image
from trexton.vision.images import bgr_from_yuv
from trexton.vision.patches import draw_patches, position_grid
from trexton.vision.textons import METHODS, Learning, TextonDictionary, learn_textons

_BLOCK = 1000  # patches: one point of the convergence
_SHOWN = 320  # pixels: width of the labelled frame


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2)
    images: int = option(100, "training images that patches are drawn from", low=1)
    patches_per_image: int = option(1000, "patches drawn from each", low=1)
    cells: int = option(12, "the floor is looked at in cells x cells squares", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Learn the dictionary of a flight, and see how often and where on the floor each texton
    occurs.

    Parameters
    ----------
    train, test : Flight
        With images. The dictionary comes from the first alone; of the second, one frame is shown
        with its labels.
    """
    learned = {}
    for method in METHODS:
        rng = stream(parameters.seed, "training")  # the stream that maps are trained with
        patches = draw_patches(
            islice(train.images(), parameters.images), 6, parameters.patches_per_image, rng
        )
        learned[method] = learn_textons(
            patches, parameters.textons, rng=rng, method=method, first=parameters.patches_per_image
        )
    dictionary = learned["kohonen"].dictionary
    texton_map = trained_map(train, textons=parameters.textons, seed=parameters.seed)
    frequency = texton_map.histograms.mean(axis=0)
    shown = test.image(len(test) // 2)
    places = place_frequencies(
        texton_map.histograms, texton_map.positions, train.area, parameters.cells
    )
    floor, pictures = floor_picture(train)
    return parameters.record(
        train, test,
        values={
            "patches": len(patches),
            "patches_per_image": int(np.prod(position_grid(shown.shape, dictionary.patch))),
            "patch": dictionary.patch,
            "is_the_map's": np.array_equal(dictionary.textons, texton_map.alphabet.textons),
            "frequency": frequency,
            "methods": {method: _summary(one, patches) for method, one in learned.items()},
            "chroma_share": _chroma_share(dictionary.textons),
        },
        series={
            "convergence": {method: _convergence(one.errors) for method, one in learned.items()},
            "place_frequency": places,
            "area_m": train.area,
            **floor,
        },
        images={
            **pictures,
            **{_strip_name(method): _strip(one.dictionary) for method, one in learned.items()},
            "frame": _small(bgr_from_yuv(shown)),
            "labelled": _small(_painted(shown, dictionary)),
        },
    )  # fmt: skip


def place_frequencies(
    histograms: np.ndarray, positions: np.ndarray, area: Any, cells: int
) -> np.ndarray:
    """``(K, cells, cells)``: mean frequency of each texton over the frames of each square, NaN
    without any.

    Rows go with y, columns with x, from the lower left corner of `area`.
    """
    x_min, x_max, y_min, y_max = area
    scaled = (positions - (x_min, y_min)) / (x_max - x_min, y_max - y_min)
    column, row = np.clip((scaled * cells).astype(int), 0, cells - 1).T
    place = row * cells + column
    count = np.bincount(place, minlength=cells**2)
    total = np.array([np.bincount(place, weights, minlength=cells**2) for weights in histograms.T])
    mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return mean.reshape(-1, cells, cells)


def _summary(learned: Learning, patches: np.ndarray) -> dict[str, Any]:
    """How well a dictionary fits the patches it was learned from."""
    labels = learned.dictionary.label(patches)
    difference = patches.astype(np.float32) - learned.dictionary.textons[labels]
    share = np.bincount(labels, minlength=learned.dictionary.n_textons) / len(labels)
    used = share[share > 0]
    return {
        "error": float(np.sqrt(np.mean(difference**2, dtype=np.float64))),
        "used": len(used),
        "effective": float(np.exp(-(used * np.log(used)).sum())),
    }


def _convergence(errors: np.ndarray) -> np.ndarray:
    """RMS error over blocks of patches, in the order in which they were seen."""
    blocks = np.array_split(errors, max(1, len(errors) // _BLOCK))
    return np.array([np.sqrt(np.mean(block**2)) for block in blocks])


def _chroma_share(textons: np.ndarray) -> float:
    """Share of the variance between textons that lies in U and V; two thirds if all channels vary
    alike.
    """
    variance = textons.astype(float).var(axis=0).sum(axis=(0, 1))
    return float(variance[1:].sum() / max(variance.sum(), 1e-12))


def _strip_name(method: str) -> str:
    return "textons" if method == "kohonen" else "textons-" + method


def _strip(dictionary: TextonDictionary) -> np.ndarray:
    """``(P, K P, 3) uint8`` BGR: all textons side by side."""
    return bgr_from_yuv(np.concatenate(list(dictionary.textons), axis=1))


def _painted(image: np.ndarray, dictionary: TextonDictionary) -> np.ndarray:
    """The image with every patch's middle in the mean colour of its texton, BGR."""
    means = np.rint(dictionary.textons.mean(axis=(1, 2))).astype(np.uint8)
    return bgr_from_yuv(means[label_image(image, dictionary)])


def _small(picture: np.ndarray) -> np.ndarray:
    rows, columns = picture.shape[:2]
    return cv2.resize(
        picture, (_SHOWN, round(_SHOWN * rows / columns)), interpolation=cv2.INTER_AREA
    )


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    kohonen, winner = (record.values["methods"][name] for name in ("kohonen", "winner-take-all"))
    better = "nearer to" if kohonen["error"] < winner["error"] else "no nearer to"
    return (
        f"The network's textons lie {better} the patches than those of winner-take-all "
        f"({number(kohonen['error'])} against {number(winner['error'])} grey levels) and share the "
        f"work more evenly, as if {number(kohonen['effective'])} against "
        f"{number(winner['effective'])} of {record.parameters['textons']} were used equally."
        if kohonen["effective"] > winner["effective"]
        else f"The network's textons lie {better} the patches than those of winner-take-all "
        f"({number(kohonen['error'])} against {number(winner['error'])} grey levels)."
    )


_NAMES = {"kohonen": "Kohonen network", "winner-take-all": "winner-take-all"}


def tiles(record: Record, name: str = "textons") -> list[np.ndarray]:
    """The textons as small RGB pictures, in the order of the dictionary."""
    return np.split(record.images[name][..., ::-1], record.parameters["textons"], axis=1)


def textons(record: Record) -> Figure:
    """Every texton and its frequency over the training flight."""
    frequency = 100 * np.array(record.values["frequency"])
    pictures, columns = tiles(record), min(10, len(frequency))
    rows = -(-len(pictures) // columns)
    with canvas(rows, columns, size=(7.2, 0.98 * rows)) as (figure, axes):
        for index, axis in enumerate(axes.flat):
            _bare(axis)
            if index < len(pictures):
                axis.imshow(pictures[index])
                axis.set_xlabel(f"{index}:  {frequency[index]:.1f} %", fontsize=8.5, labelpad=2)
    return figure


def convergence(record: Record) -> Figure:
    """Distance of patches to their nearest texton while the dictionary is learned."""
    with canvas(size=(6.4, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        for (method, errors), color in zip(
            record.series["convergence"].items(), SERIES, strict=False
        ):
            seen = np.arange(1, len(errors) + 1) * record.values["patches"] / len(errors)
            final = record.values["methods"][method]
            label = f"{_NAMES[method]}: in the end {final['error']:.1f} over all patches"
            plot.plot(seen / 1000, errors, color=color, label=label, linewidth=1.1)
            plot.axhline(final["error"], color=color, linestyle=":", linewidth=1)
        plot.set(xlabel="patches seen (thousands)")
        plot.set(ylabel="RMS distance to the nearest\ntexton (grey levels)")
        plot.set(xlim=(0, record.values["patches"] / 1000), ylim=(0, None))
        legend_below(plot, 0.2)
    return figure


def places(record: Record) -> Figure:
    """Frequency of each texton over the floor, each on its own scale from zero to its largest."""
    maps = np.array(record.series["place_frequency"], dtype=float)
    pictures, columns = tiles(record), min(5, len(maps))
    rows = -(-len(maps) // columns)
    x_min, x_max, y_min, y_max = record.series["area_m"]
    height = 1.62 * rows * (y_max - y_min) / (x_max - x_min)
    with canvas(rows, columns, size=(7.2, min(height, 12)), sharex=True, sharey=True) as (
        figure,
        axes,
    ):
        for index, axis in enumerate(axes.flat):
            if index >= len(maps):
                axis.set_axis_off()
                continue
            top = np.nanmax(maps[index])
            extent = (x_min, x_max, y_min, y_max)
            axis.imshow(
                100 * maps[index],
                origin="lower",
                extent=extent,
                cmap="cividis",
                vmin=0,
                vmax=100 * top or 1,
                label="frequency (%)",
            )
            axis.set_facecolor("#eeeeee")
            axis.grid(False)
            axis.set_title(
                f"{index}   up to {100 * top:.2g} %", fontsize=8, loc="right", weight="normal"
            )
            icon = axis.inset_axes((0, 1.02, 0.16, 0.16))
            icon.imshow(pictures[index])
            _bare(icon)
        for axis in axes[-1]:
            axis.set_xlabel("x (m)")
        for axis in axes[:, 0]:
            axis.set_ylabel("y (m)")
    return figure


def labelled(record: Record) -> Figure:
    """A frame, and the same with every patch in the colour of its texton."""
    with canvas(1, 2, size=(7.2, 2.9)) as (figure, axes):
        for axis, name, title in zip(
            axes[0], ("frame", "labelled"), ("A frame", "Its textons"), strict=True
        ):
            axis.imshow(record.images[name][..., ::-1], interpolation="bilinear")
            axis.set_title(title)
            _bare(axis)
    return figure


def _bare(axes: Axes) -> None:
    axes.grid(False)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)


EXPERIMENT = Experiment("The texton dictionary", Parameters, run, finding, needs=IMAGES, cost_s=12)
