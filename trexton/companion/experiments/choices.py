"""What the choices cost that the paper leaves open: one at a time is changed.

Some become what the authors' flight code of 2016 did, which is public; the paper wins where the two
differ. Others become a way that neither took. The record says which (`flight_code`).
"""

from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import errors_of, flown, frames_of, map_of
from trexton.companion.experiments.style import COLORS, canvas, label_rows, with_intervals
from trexton.companion.experiments.track import tracks
from trexton.companion.wording import apart, distance
from trexton.flights.flight import Flight
from trexton.localization.training import train_map
from trexton.vision.textons import TextonDictionary

# Ways that the flight code did not take, and all but the first not the paper; it had the others.
OTHERS = {"paper", "near_in_time", "systematic", "mean", "highest_weight"}
# key: (how it reads in a table, options of the localizer)
_CHANGES: dict[str, tuple[str, dict[str, Any]]] = {
    "paper": ("as the paper says", {}),
    "sigma_70": ("one hand-set sigma of 70 cm for all ranks", {"measurement.sigma": 0.7}),
    "sigma_200": ("one hand-set sigma of 200 cm for all ranks", {"measurement.sigma": 2.0}),
    "near_in_time": (
        "ranks learned with all other frames allowed as neighbours",
        {"measurement.excluded_s": 0.0},
    ),
    "motion_8": ("hand-set motion noise of 8 cm a frame", {"motion.sigma": 0.08}),
    "motion_25": ("hand-set motion noise of 25 cm a frame", {"motion.sigma": 0.25}),
    "particles_140": ("140 particles", {"particles": 140}),
    "particles_1000": ("1000 particles", {"particles": 1000}),
    "systematic": ("systematic resampling", {"resampling": "systematic"}),
    "mean": ("weighted mean as the estimate", {"estimation": "mean"}),
    "highest_weight": ("heaviest particle as the estimate", {"estimation": "highest-weight"}),
}


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(4, "independent runs of the filter, of all but the paper's", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Change one open choice at a time and localize the test flight again.

    ``values["variants"]`` holds the label of each, whether the flight code had it, and the mean
    Euclidean error in cm with its interval; ``paper`` is the method as it stands.
    """
    texton_map, frames = map_of(train, parameters), frames_of(test)
    names = ("repeats", "seed", "samples", "particles")
    common = {name: getattr(parameters, name) for name in names}
    changes = {key: (label, texton_map, options) for key, (label, options) in _CHANGES.items()}
    if test.has_images and train.has_images:
        rng = stream(parameters.seed, "training")  # learned as the flight code did
        dictionary = TextonDictionary.learn(train, rng=rng, method="winner-take-all")
        learned = train_map(train, neighbors=parameters.neighbors, rng=rng, dictionary=dictionary)
        changes["winner"] = ("winner-take-all dictionary", learned, {})
    variants = {}
    for key, (label, changed, options) in changes.items():
        if key == "paper":
            runs = flown(train, test, parameters, texton_map=texton_map)
        else:
            runs = tracks(changed, frames, **common | options)
        variants[key] = {
            "label": label,
            "flight_code": key not in OTHERS,
            "mean_cm": errors_of(runs, test, parameters.seed)["mean_cm"],
        }
    values = {"variants": variants, "order": list(variants)}
    return parameters.record(train, test, values=values)


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    variants = record.values["variants"]
    paper = variants["paper"]["mean_cm"]
    others = [each for key, each in variants.items() if key != "paper"]
    differing = [each for each in others if apart(each["mean_cm"], paper)]
    best = min(others, key=lambda each: each["mean_cm"]["value"])
    return (
        f"Of {len(others)} choices {len(differing)} differ beyond chance from the paper's on this "
        f"flight. The smallest error, in hindsight, has {best['label']}, with "
        f"{distance(best['mean_cm'])}."
    )


def costs(record: Record) -> Figure:
    """Mean error of every variant with its 95 % interval; the line is the paper's method."""
    variants = [record.values["variants"][key] for key in record.values["order"]]
    with canvas(size=(7.2, 0.7 + 0.4 * len(variants))) as (figure, [[plot]]):
        for row, (key, variant) in enumerate(zip(record.values["order"], variants, strict=True)):
            color = COLORS["paper" if key == "paper" else "zone"]
            face = color if key == "paper" or variant["flight_code"] else "white"
            mark: dict[str, Any] = {"fmt": "o", "color": color, "markersize": 5, "elinewidth": 2}
            place, mean = np.array([row]), variant["mean_cm"]
            with_intervals(plot, place, [mean], across=True, markerfacecolor=face, **mark)
        paper = variants[0]["mean_cm"]["value"]
        plot.axvline(paper, color=COLORS["paper"], linewidth=0.9, linestyle="--")
        labels = [fill(variant["label"], 32) for variant in variants]
        label_rows(plot, labels, "mean distance to the truth (cm)")
    return figure


EXPERIMENT = Experiment(
    "What the open choices cost",
    Parameters,
    run,
    finding,
    needs=POSITIONS,
    after=("mocap_training",),
    cost_s=40,
)
