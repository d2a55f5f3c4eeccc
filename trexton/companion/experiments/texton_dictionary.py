"""The texton dictionary (paper, Methods, "Texton Dictionary Generation"). Its textons are shown,
and how well they fit.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np
from matplotlib.figure import Figure

from trexton.base.defaults import TEXTONS
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import (
    IMAGES,
    Experiment,
    MapParameters,
    SeedParameters,
    option,
)
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.experiments.style import canvas
from trexton.companion.wording import number
from trexton.flights.flight import Flight
from trexton.vision.images import bgr_from_yuv, draw_patches, position_grid
from trexton.vision.textons import TextonDictionary


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2)
    images: int = option(100, "training images that patches are drawn from", low=1)
    patches_per_image: int = option(1000, "patches drawn from each", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Learn the dictionary of a flight, and see how often each texton occurs.

    With images. The dictionary comes from the first alone.
    """
    rng = stream(parameters.seed, "training")  # the stream that maps are trained with
    per_image = parameters.patches_per_image
    patches = draw_patches(islice(train.images(), parameters.images), 6, per_image, rng)
    dictionary = TextonDictionary.learn(patches, parameters.textons, rng=rng)
    trained = MapParameters(parameters.seed, textons=parameters.textons)
    frequency = map_of(train, trained).histograms.mean(axis=0)
    values = {
        "patches": len(patches),
        "patches_per_image": int(np.prod(position_grid(test.image(0).shape, dictionary.patch))),
        "patch": dictionary.patch,
        "frequency": frequency,
        "fit": _fit(dictionary, patches),
    }
    picture = bgr_from_yuv(np.concatenate(list(dictionary.textons), axis=1))  # side by side
    return parameters.record(train, test, values=values, images={"textons": picture})


def _fit(dictionary: TextonDictionary, patches: np.ndarray) -> dict[str, float]:
    """RMS distance of patches to their textons in grey levels; how many textons used equally would
    be as even as these (the exponential of the entropy).
    """
    labels = dictionary.label(patches)
    difference = patches.astype(np.float32) - dictionary.textons[labels]
    share = np.bincount(labels, minlength=dictionary.n_textons) / len(labels)
    used = share[share > 0]
    return {
        "error": float(np.sqrt(np.mean(difference**2, dtype=np.float64))),
        "effective": float(np.exp(-(used * np.log(used)).sum())),
    }


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    fit, count = record.values["fit"], record.parameters["textons"]
    return (
        f"A patch differs from its nearest texton by {number(fit['error'])} grey levels (root mean "
        f"square). Some textons are rare, so the {count} count as {number(fit['effective'])} that "
        "are equally frequent."
    )


def tiles(record: Record) -> list[np.ndarray]:
    """The textons as small RGB pictures, in the order of the dictionary."""
    return np.split(record.images["textons"][..., ::-1], record.parameters["textons"], axis=1)


def textons(record: Record) -> Figure:
    """Every texton and its frequency over the training flight."""
    frequency = 100 * np.array(record.values["frequency"])
    pictures, columns = tiles(record), min(10, len(frequency))
    rows = -(-len(pictures) // columns)
    with canvas(rows, columns, size=(7.2, 0.98 * rows)) as (figure, axes):
        for index, axis in enumerate(axes.flat):
            axis.grid(False)
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
            if index < len(pictures):
                axis.imshow(pictures[index])
                axis.set_xlabel(f"{index}:  {frequency[index]:.1f} %", fontsize=8.5, labelpad=2)
    return figure


EXPERIMENT = Experiment("The texton dictionary", Parameters, run, finding, needs=IMAGES, cost_s=12)
