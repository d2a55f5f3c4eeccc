"""Beyond the paper: why its filter trails, and what a field of histograms does instead.

`VARIANTS` are the ways to localize that are compared, from the paper's filter to method field
with visual odometry and aiding.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import (
    coverage,
    errors_of,
    flown,
    frames_of,
    lag,
    map_of,
)
from trexton.companion.experiments.one_frame import figure_of, watch
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.style import COLORS, canvas, label_ends
from trexton.companion.experiments.track import Track, fly
from trexton.companion.wording import beside, interval, middle, percent
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.methods import make
from trexton.localization.training import for_method, with_choices, with_parts

WIDE_M = 0.25  # process noise and rank widths of the ablations
QUOTED = ("paper", "field")  # variants whose runs other pages quote too
ATTITUDE_NOISE = np.radians(0.3)  # of the autopilot's roll, pitch and yaw


@dataclass(frozen=True)
class Variant:
    """One way to localize: a method, and what of it is changed."""

    label: str
    method: str
    choices: Mapping[str, object]
    draws: bool = True  # whether repeats differ by more than the patches
    whole: bool = False  # whether the field counts in whole images, and not in their parts
    odometry: bool = False  # whether frames tell it a velocity too
    aided: bool = False  # whether an autopilot's attitude and height come beside them


VARIANTS: dict[str, Variant] = {
    "paper": Variant("The paper's filter", "paper", {}),
    "agile": Variant("with more process noise", "paper", {"motion.sigma": WIDE_M}),
    "narrow": Variant("with narrower ranks", "paper", {"measurement.sigma": WIDE_M}),
    "both": Variant(
        "with both", "paper", {"motion.sigma": WIDE_M, "measurement.sigma": WIDE_M}
    ),
    "field_particles": Variant(
        "The field, weighing particles", "paper",
        {
            "measurement": "field", "motion": "singer", "estimation": "mean",
            "recovery": "augmented", "filter.particles": 500,
        },
    ),
    "field_whole": Variant("The field of whole images, with its tracks", "field", {}, draws=False,
                           whole=True),
    "field": Variant("The field with its tracks", "field", {}, draws=False),
    "field_camera": Variant("and a velocity from the same frames", "field", {}, draws=False,
                            odometry=True),
    "field_odometry": Variant("and attitude and height beside them", "field", {}, draws=False,
                              odometry=True, aided=True),
}  # fmt: skip


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(3, "independent runs of every filter that draws", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly every variant over the test flight, from a uniform start, and measure its error.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms; then `samples` and `textons` do not apply.
    """
    texton_map, located = map_of(train, parameters), train.select(train.located)
    frames, truth = frames_of(test), test.position
    aiding = _aiding(test, parameters.seed)
    flights, timings = {}, {}
    changed: dict[str, TextonMap] = {}
    for name, variant in VARIANTS.items():
        if not _possible(variant, train, aiding):
            continue
        started = perf_counter()
        base = changed["field"] if variant.odometry else texton_map
        changed[name] = _map_for(variant, base, located)
        timings[name] = {"learn_s": perf_counter() - started}
        if name in QUOTED:
            runs = flown(train, test, parameters, name, texton_map=changed[name])
        else:
            runs = []
            for repeat in range(parameters.repeats if variant.draws else 1):
                rng = stream(parameters.seed, f"beyond {name}", repeat)
                localizer = Localizer(changed[name], samples=parameters.samples, rng=rng)
                runs.append(fly(localizer, frames, aiding=aiding if variant.aided else None))
        flights[name] = runs
        timings[name]["step_s"] = float(np.median(runs[0].step_s))
    values: dict[str, Any] = {
        name: _summary(runs, test, parameters.seed) for name, runs in flights.items()
    }
    values |= {
        "lag": lag(flights["paper"], test),
        "ratio": middle(values["field"]["mean_cm"]) / middle(values["paper"]["mean_cm"]),
        "protocol": _protocol(),
        "frames": len(test),
    }
    errors_cm = {
        name: 100 * np.sort(np.concatenate([each.errors(truth) for each in runs]))[::3]
        for name, runs in flights.items()
    }
    frame = watch(changed["field"], test, frames, parameters)
    series = {"errors_cm": errors_cm, "frame": frame, "area_m": changed["field"].area}
    return parameters.record(train, test, values=values, series=series, timings=timings)


def _possible(variant: Variant, train: Flight, aiding: list[Aiding] | None) -> bool:
    """Whether the flights have what a variant needs."""
    seen = train.camera is not None and train.height is not None
    return (
        (train.has_images or not variant.whole)
        and (not variant.odometry or (seen and train.has_images))
        and (not variant.aided or aiding is not None)
    )


def _map_for(variant: Variant, base: TextonMap, located: Flight) -> TextonMap:
    """The map that a variant flies with: the paper's with other parts, or the field's with more."""
    if variant.odometry:
        return with_parts(base, {"odometry": make("odometry", "visual")}, flight=located)
    counted = located if variant.method == "field" and not variant.whole else None
    return with_choices(for_method(base, variant.method, flight=counted), variant.choices)


def _aiding(flight: Flight, seed: int) -> list[Aiding] | None:
    """Attitude, as an autopilot knows it, and height; None where the flight has none."""
    if flight.attitude is None or flight.height is None:
        return None
    rng = stream(seed, "autopilot")
    noisy = flight.attitude + ATTITUDE_NOISE * rng.standard_normal(flight.attitude.shape)
    known = replace(flight, attitude=noisy)
    return [known.aiding(row) for row in range(len(flight))]


def _summary(runs: list[Track], test: Flight, seed: int) -> dict[str, Any]:
    """Errors in cm over all runs, and the coverage of the claimed region, in quarters too."""
    errors = errors_of(runs, test, seed)
    held = np.stack([each.held(test.position) for each in runs])
    quarters = [part.mean() for part in np.array_split(held, 4, axis=1)]
    return {
        "mean_cm": errors["mean_cm"],
        **{name: middle(errors[name]) for name in ("median_cm", "p95_cm", "relative")},
        "held": coverage(runs, test, seed),
        "held_least": min(quarters),
        "held_most": max(quarters),
    }


def _protocol() -> dict[str, Any]:
    """How the method was chosen, and every test-set evaluation so far."""
    written = tomllib.loads(paper_file("protocol.toml").read_text(encoding="utf-8"))
    evaluations = [
        {key: value for key, value in each.items() if key != "date"}
        for each in written["evaluations"]
    ]
    return {"rules": written["rules"], "evaluations": evaluations, "count": len(evaluations)}


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    paper, field = record.values["paper"], record.values["field"]
    return (
        f"The mean error of method field is {interval(field['mean_cm'], 'cm')}, "
        f"{beside(record.values['ratio'])} that of the paper's filter. Its 90 % region covers "
        f"{percent(middle(field['held']))} of the frames, the paper's "
        f"{percent(middle(paper['held']))}."
    )


# Five lines, each with the words at its end and its colour.
_DRAWN = {
    "paper": ("paper's filter", "paper"),
    "both": ("noise and ranks changed", "particles"),
    "field_whole": ("field of whole images", "neighbors"),
    "field": ("field", "field"),
    "field_odometry": ("field with odometry", "fine"),
}


def errors(record: Record) -> Figure:
    """The error below which a share of the frames stays, a line for each of five variants."""
    with canvas(size=(7.2, 3.8)) as (figure, axes):
        plot = axes[0, 0]
        for name in filter(record.series["errors_cm"].__contains__, _DRAWN):
            values = record.series["errors_cm"][name]
            share = 100 * (np.arange(len(values)) + 0.5) / len(values)
            label, color = _DRAWN[name]
            plot.plot(share, values, color=COLORS[color], label=label)
        plot.set(
            xlim=(0, 100), yscale="log", ylim=(1, None),
            xlabel="share of the frames (%)", ylabel="error below (cm)",
        )  # fmt: skip
        plot.yaxis.set_major_formatter("{x:g}")
        label_ends(plot)
    return figure


def one_frame(record: Record) -> Figure:
    """One frame on its way to a place: histogram, likelihood, hypotheses before and after."""
    return figure_of(record)


EXPERIMENT = Experiment(
    "The field beside the paper's filter", Parameters, run, finding,
    needs=POSITIONS, after=("mocap_training",), cost_s=30,
)  # fmt: skip
