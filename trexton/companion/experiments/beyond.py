"""Beyond the paper: why its filter trails, and what a field of histograms does instead.

`VARIANTS` are the ways to localize that are compared, from the paper's filter to method field
with visual odometry. One frame is drawn on its way to a place.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.files import read_toml
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
from trexton.companion.experiments.figure_files import PHONE_WIDTH, layer
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.style import COLORS, canvas, floor_axes, label_ends
from trexton.companion.experiments.track import HELD, Track, tracks
from trexton.companion.wording import beside, distance, middle, percent
from trexton.field.field import Field
from trexton.field.hypotheses import Hypotheses
from trexton.field.tracks import TrackFilter
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.methods import make
from trexton.localization.training import for_method, with_choices, with_parts

WIDE_M = 0.25  # process noise and rank widths of the ablations
SETTLED = 25  # frames, two seconds, that are flown before a kidnapping
FEWEST = 0.01  # weight of a hypothesis that is drawn
BEFORE, AFTER = 2, 6  # frames that are drawn around a kidnapping


@dataclass(frozen=True)
class Variant:
    """One way to localize: a method, and what of it is changed."""

    label: str
    method: str
    choices: Mapping[str, object]
    whole: bool = False  # whether the field counts in whole images, and not in their parts
    odometry: bool = False  # whether frames tell it a velocity too


VARIANTS: dict[str, Variant] = {
    "paper": Variant("The paper's filter", "paper", {}),
    "agile": Variant("with more process noise", "paper", {"motion.sigma": WIDE_M}),
    "narrow": Variant("with narrower ranks", "paper", {"measurement.sigma": WIDE_M}),
    "both": Variant("with both", "paper", {"motion.sigma": WIDE_M, "measurement.sigma": WIDE_M}),
    "field_whole": Variant("The field of whole images", "field", {}, whole=True),
    "field": Variant("The field", "field", {}),
    "field_camera": Variant("The field with visual odometry", "field", {}, odometry=True),
}


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(4, "independent runs of every filter that draws", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly every variant over the test flight, from a uniform start, and measure its error.

    With images, or with histograms; then `samples` and `textons` do not apply.
    """
    texton_map, located = map_of(train, parameters), train.select(train.located)
    frames, truth = frames_of(test), test.position
    flights, timings = {}, {}
    changed: dict[str, TextonMap] = {}
    for name, variant in VARIANTS.items():
        if variant.odometry and (train.camera is None or train.height is None):
            continue
        if (variant.whole or variant.odometry) and not train.has_images:
            continue
        started = perf_counter()
        base = changed["field"] if variant.odometry else texton_map
        changed[name] = _map_for(variant, base, located)
        timings[name] = {"learn_s": perf_counter() - started}
        if name == variant.method:  # flown once for all pages
            runs = flown(train, test, parameters, name, texton_map=changed[name])
        else:
            how: dict[str, Any] = {"samples": parameters.samples, "repeats": 1}
            if variant.method == "paper":
                how |= {"particles": parameters.particles, "repeats": parameters.repeats}
            runs = tracks(changed[name], frames, seed=parameters.seed, **how)
        flights[name] = runs
        timings[name]["step_s"] = float(np.median(runs[0].step_s))
    values: dict[str, Any] = {
        name: _summary(runs, test, parameters.seed) for name, runs in flights.items()
    }
    values |= {
        "lag": lag(flights["paper"], test),
        "ratio": middle(values["field"]["mean_cm"]) / middle(values["paper"]["mean_cm"]),
        "protocol": _protocol(),
    }
    errors_cm = {
        name: 100 * np.sort(np.concatenate([each.errors(truth) for each in runs]))[::3]
        for name, runs in flights.items()
    }
    stepped = _kidnapped(changed["field"], test, frames, parameters)
    series = {"errors_cm": errors_cm, "area_m": changed["field"].area, "frames": stepped}
    return parameters.record(train, test, values=values, series=series, timings=timings)


def _map_for(variant: Variant, base: TextonMap, located: Flight) -> TextonMap:
    """The map that a variant flies with: the paper's with other parts, or the field's with more."""
    if variant.odometry:
        return with_parts(base, {"odometry": make("odometry", "visual")}, flight=located)
    counted = located if variant.method == "field" and not variant.whole else None
    return with_choices(for_method(base, variant.method, flight=counted), variant.choices)


def _summary(runs: list[Track], test: Flight, seed: int) -> dict[str, Any]:
    """Errors in cm over all runs, and the coverage of the claimed region."""
    errors = errors_of(runs, test, seed)
    return {
        "mean_cm": errors["mean_cm"],
        **{name: middle(errors[name]) for name in ("median_cm", "p95_cm")},
        "held": coverage(runs, test, seed),
    }


def _protocol() -> dict[str, Any]:
    """How the method was chosen, and every test-set evaluation so far."""
    written = read_toml(paper_file("protocol.toml"))
    evaluations = [
        {key: value for key, value in each.items() if key != "date"}
        for each in written["evaluations"]
    ]
    return {"rules": written["rules"], "evaluations": evaluations, "count": len(evaluations)}


def _kidnapped(
    texton_map: TextonMap, test: Flight, frames: Sequence[np.ndarray], parameters: Parameters
) -> list[dict[str, Any]]:
    """Frames around a kidnapping: from where it is farthest to the frame whose likelihood is spread
    widest, so that several hypotheses remain for a while.

    Returns
    -------
    frames : list of dict
        ``number``, ``histogram``, ``truth_m`` and ``estimate_m``; the ``likelihood`` over the
        floor, the largest 1, row 0 at the smallest y; hypotheses ``before`` and ``after``, each
        with ``weight``, ``mean_m`` and ``covariance_m2``.
    """
    rng = stream(parameters.seed, "flight", 0)  # the run that is quoted
    localizer = Localizer(texton_map, samples=parameters.samples, rng=rng)
    tracks, field = localizer.filter, localizer.parts["measurement"]
    assert isinstance(tracks, TrackFilter) and isinstance(field, Field)
    observations = [localizer.observation(frame) for frame in frames]
    posteriors = (field.log_posterior(each) for each in observations)
    likely = np.array([np.exp(each - each.max()) for each in posteriors])
    shares = likely / likely.sum(axis=1, keepdims=True)
    widths = shares @ np.square(field.centers).sum(axis=1)
    widths -= np.square(shares @ field.centers).sum(axis=1)
    begin = int(widths[: len(widths) - AFTER + 1].argmax())
    away = np.nan_to_num(np.hypot(*(test.position - test.position[begin]).T))
    away[: min(SETTLED, len(away) // 2)] = 0
    end = int(away.argmax())
    seen: list[dict[str, Any]] = []
    for number in (*range(max(0, end - SETTLED), end), *range(begin, begin + AFTER)):
        before, observation = _drawn(tracks.hypotheses), observations[number]
        estimate = localizer.advance(observation)
        seen.append(
            {
                "number": number,
                "histogram": observation.histogram,
                "likelihood": likely[number].reshape(field.shape).T.round(3),
                "before": before,
                "after": _drawn(tracks.hypotheses),
                "truth_m": test.position[number],
                "estimate_m": estimate.position,
            }
        )
    return seen[-BEFORE - AFTER :]


def _drawn(hypotheses: Hypotheses) -> list[dict[str, Any]]:
    each = zip(hypotheses.weights, hypotheses.states, hypotheses.covariances, strict=True)
    return [
        {"weight": weight, "mean_m": state[:2].copy(), "covariance_m2": covariance[:2, :2].copy()}
        for weight, state, covariance in each
        if weight >= FEWEST
    ]


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    paper, field = record.values["paper"], record.values["field"]
    return (
        f"The mean error of method field is {distance(field['mean_cm'])}, "
        f"{beside(record.values['ratio'])} that of the paper's filter. Its 90 % region covers "
        f"{percent(middle(field['held']))} of the frames, the paper's "
        f"{percent(middle(paper['held']))}."
    )


# A few lines, each with the words at its end and its colour.
_DRAWN = {
    "paper": ("paper's filter", "paper"),
    "both": ("noise and ranks changed", "particles"),
    "field_whole": ("field of whole images", "neighbors"),
    "field": ("field", "field"),
    "field_camera": ("field with odometry", "fine"),
}


def errors(record: Record) -> Figure:
    """The error below which a share of the frames stays, a line for each of `_DRAWN`."""
    with canvas(size=(7.2, 3.8)) as (figure, [[plot]]):
        for name in filter(record.series["errors_cm"].__contains__, _DRAWN):
            values = record.series["errors_cm"][name]
            share = 100 * (np.arange(len(values)) + 0.5) / len(values)
            label, color = _DRAWN[name]
            plot.plot(share, values, color=COLORS[color], label=label)
        plot.set(xlim=(0, 100), yscale="log", ylim=(1, None))
        plot.set(xlabel="share of the frames (%)", ylabel="error below (cm)")
        plot.yaxis.set_major_formatter("{x:g}")
        label_ends(plot)
    return figure


def one_frame(record: Record) -> Figure:
    """The histogram; its likelihood over the floor; hypotheses before and after the frame.

    The first frame with the most after it is shown; a page steps through the others, hidden.
    """
    frames, area = record.series["frames"], record.series["area_m"]
    still = int(np.argmax([len(each["after"]) for each in frames]))
    with canvas(2, 2, size=(PHONE_WIDTH, 4.4)) as (figure, axes):  # no other for phones
        counts, likely, before, after = axes.flat
        counts.set(title="1. Histogram", xlabel="texton", ylabel="patches (%)")
        titles = "2. Likelihood", "3. Before", "4. After"
        for plot, title in zip((likely, before, after), titles, strict=True):
            floor_axes(plot, area)
            plot.set_title(title)
        for step, seen in enumerate(frames):
            with layer(figure, step, shown=step == still):
                _draw_frame(list(axes.flat), seen, area)
    return figure


def _draw_frame(axes: list[Axes], seen: dict[str, Any], area: Any) -> None:
    """What changes from frame to frame in the four panels."""
    counts, likely, before, after = axes
    histogram, shares = np.array(seen["histogram"]), np.array(seen["likelihood"])
    edges = np.arange(len(histogram) + 1) - 0.5
    counts.stairs(100 * histogram, edges, fill=True, color=COLORS["zone"], label="share")
    picture = likely.imshow(shares, extent=area, origin="lower", cmap="Blues", vmax=1.6)
    # What is unlikely shows the page, light or dark.
    picture.set(alpha=np.sqrt(shares), label="likelihood")
    ring: dict[str, Any] = {"fillstyle": "none", "markersize": 9, "markeredgewidth": 2}
    for plot in (likely, before, after):
        plot.plot(*seen["truth_m"], "o", color=COLORS["truth"], label="truth", **ring)
    for plot, name in ((before, "before"), (after, "after")):
        for each in seen[name]:
            _ellipse(plot, each)
    after.plot(*seen["estimate_m"], "o", color=COLORS["field"], markersize=4, label="estimate")


def _ellipse(plot: Axes, hypothesis: dict[str, Any]) -> None:
    """The 90 % region of a hypothesis, the stronger the more it weighs, and its weight."""
    turn = np.linspace(0, 2 * np.pi, 37)
    root = np.linalg.cholesky(np.array(hypothesis["covariance_m2"]) + 1e-9 * np.eye(2))
    x, y = np.array(hypothesis["mean_m"])
    ring = np.sqrt(HELD) * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ root.T + (x, y)
    weight, color = hypothesis["weight"], COLORS["field"]
    plot.plot(*ring.T, color=color, linewidth=1 + 1.5 * weight, alpha=0.35 + 0.65 * weight)
    words = f"{100 * weight:.0f} %"
    plot.annotate(words, ring[4], (3, 3), textcoords="offset points", fontsize=8.5, color=color)


EXPERIMENT = Experiment(
    "The field beside the paper's filter", Parameters, run, finding, POSITIONS, ("mocap_training",)
)
