"""One frame as method `field` locates it: its likelihood over the floor, and the hypotheses.

Offers `watch`, which flies to a frame that looks like several places, and the figure of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import FilterParameters
from trexton.companion.experiments.style import COLORS, canvas, floor_axes
from trexton.companion.experiments.track import HELD
from trexton.field.field import Field
from trexton.field.hypotheses import Hypotheses
from trexton.field.tracks import TrackFilter
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap

SETTLED = 25  # frames, two seconds, before one is chosen
RIGHT_M = 0.3  # an error that still counts as right
FEWEST = 0.01  # weight of a hypothesis that is drawn


def watch(
    texton_map: TextonMap, test: Flight, frames: Sequence[np.ndarray], parameters: FilterParameters
) -> dict[str, Any]:
    """The frame whose likelihood is spread widest among those that end up at the right place.

    Returns
    -------
    dict
        Its ``number``, ``histogram``, ``truth_m`` and ``estimate_m``; its ``likelihood`` over the
        floor, the largest 1, row 0 at the smallest y; hypotheses ``before`` and ``after`` it, each
        with ``weight``, ``mean_m`` and ``covariance_m2``.
    """
    rng = stream(parameters.seed, "flight", 0)  # the run that is quoted
    localizer = Localizer(texton_map, samples=parameters.samples, rng=rng)
    tracks, field = localizer.filter, localizer.parts["measurement"]
    assert isinstance(tracks, TrackFilter) and isinstance(field, Field)
    chosen: dict[str, Any] = {}
    widest = -1.0
    for number, (frame, truth) in enumerate(zip(frames, test.position, strict=True)):
        before, observation = _drawn(tracks.hypotheses), localizer.observation(frame)
        estimate = localizer.advance(observation)
        log_posterior = field.log_posterior(observation)
        share = np.exp(log_posterior - log_posterior.max())
        mean = share @ field.centers / share.sum()
        width = float(share @ np.square(field.centers - mean).sum(axis=1) / share.sum())
        right = number >= SETTLED and np.hypot(*(estimate.position - truth)) < RIGHT_M
        if not chosen or (right and width > widest):
            widest = width if right else -1.0
            chosen = {
                "number": number,
                "histogram": observation.histogram,
                "likelihood": share.reshape(field.shape).T.round(4),
                "before": before,
                "after": _drawn(tracks.hypotheses),
                "truth_m": truth,
                "estimate_m": estimate.position,
            }
    return chosen


def _drawn(hypotheses: Hypotheses) -> list[dict[str, Any]]:
    each = zip(hypotheses.weights, hypotheses.states, hypotheses.covariances, strict=True)
    return [
        {"weight": weight, "mean_m": state[:2].copy(), "covariance_m2": covariance[:2, :2].copy()}
        for weight, state, covariance in each
        if weight >= FEWEST
    ]


def figure_of(record: Record) -> Figure:
    """The histogram; its likelihood over the floor; hypotheses before and after the frame."""
    seen, area = record.series["frame"], record.series["area_m"]
    with canvas(2, 2, size=(6.4, 6.2)) as (figure, axes):
        counts, likely, before, after = axes.flat
        histogram = np.array(seen["histogram"])
        counts.bar(np.arange(len(histogram)), 100 * histogram, color=COLORS["zone"], label="share")
        counts.set(title="1. The histogram", xlabel="texton", ylabel="share of the patches (%)")
        likely.imshow(
            np.array(seen["likelihood"]), extent=area, origin="lower", cmap="Blues", aspect="equal",
            label="likelihood",
        )  # fmt: skip
        for plot, title in (
            (likely, "2. Where the floor looks so"),
            (before, "3. Hypotheses before"),
            (after, "4. and after the frame"),
        ):
            floor_axes(plot, area)
            plot.plot(*seen["truth_m"], "o", color=COLORS["truth"], fillstyle="none",
                      markersize=11, markeredgewidth=2, label="truth")  # fmt: skip
            plot.set_title(title)
        for plot, name in ((before, "before"), (after, "after")):
            for each in seen[name]:
                _ellipse(plot, each)
        after.plot(*seen["estimate_m"], "o", color=COLORS["field"], markersize=4, label="estimate")
    return figure


def _ellipse(plot: Axes, hypothesis: dict[str, Any]) -> None:
    """The 90 % region of a hypothesis, the stronger the more it weighs, and its weight."""
    turn = np.linspace(0, 2 * np.pi, 60)
    root = np.linalg.cholesky(np.array(hypothesis["covariance_m2"]) + 1e-9 * np.eye(2))
    x, y = np.array(hypothesis["mean_m"])
    ring = np.sqrt(HELD) * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ root.T + (x, y)
    weight = hypothesis["weight"]
    plot.plot(
        *ring.T, color=COLORS["field"], linewidth=1 + 1.5 * weight, alpha=0.35 + 0.65 * weight
    )
    plot.annotate(
        f"{100 * weight:.0f} %", ring[7], xytext=(3, 3), textcoords="offset points", fontsize=8.5,
        color=COLORS["field"],
    )  # fmt: skip
