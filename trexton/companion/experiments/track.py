"""Runs of the localizer over the frames of a flight. What is read off them stands beside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.metrics import euclidean
from trexton.flights.aiding import Aiding
from trexton.localization.estimate import Estimate
from trexton.localization.localizer import Localizer, TextonMap

Frames = Sequence[np.ndarray] | np.ndarray
ARRAYS = ("position", "covariance", "lost", "knn", "step_s")  # of a track, in its order
HELD = -2 * np.log(1 - 0.9)  # squared deviations that hold 90 % of a Gaussian in the plane


@dataclass(frozen=True, eq=False)
class Track:
    """One run of the localizer over N frames.

    Attributes
    ----------
    position : (N, 2) array
        Estimates in metres.
    covariance : (N, 2, 2) array, square metres
    lost : (N,) bool array
        Whether it said that it was lost.
    knn : (N, 2) array
        Plain means of the k neighbours in metres: the paper's method without its filter. NaN for a
        method that asks for none.
    step_s : (N,) array
        Seconds that each frame took.
    estimates : list of Estimate
        All that was estimated; empty for a run that comes from the cache.
    """

    position: np.ndarray
    covariance: np.ndarray
    lost: np.ndarray
    knn: np.ndarray
    step_s: np.ndarray
    estimates: list[Estimate] = field(default_factory=list)

    @classmethod
    def of(cls, estimates: list[Estimate], step_s: np.ndarray) -> Track:
        """The run that gave these estimates."""

        def neighbors(estimate: Estimate) -> np.ndarray:
            near = estimate.neighbors
            return np.full(2, np.nan) if near is None else near.position.mean(axis=0)

        return cls(
            np.array([each.position for each in estimates]),
            np.array([each.covariance for each in estimates]),
            np.array([each.lost for each in estimates]),
            np.array([neighbors(each) for each in estimates]),
            step_s,
            estimates,
        )

    @property
    def spread(self) -> np.ndarray:
        """``(N, 2)`` standard deviations in metres."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def errors(self, truth: np.ndarray) -> np.ndarray:
        """``(N,)`` distances to the truth in metres."""
        return euclidean(self.position, truth)

    def held(self, truth: np.ndarray) -> np.ndarray:
        """``(N,)`` whether the region that should hold 90 % held the truth."""
        offset = (truth - self.position)[..., None]
        covariance = self.covariance + 1e-12 * np.eye(2)
        squared = (offset * np.linalg.solve(covariance, offset)).sum(axis=(1, 2))
        return squared < HELD


def fly(
    localizer: Localizer,
    frames: Iterable[np.ndarray],
    *,
    aiding: Sequence[Aiding] | None = None,
    times: np.ndarray | None = None,
    counted: int | None = None,
) -> Track:
    """Step the localizer through all frames, aided by what an autopilot measures at each.

    Without ``(N,)`` `times` in seconds they are a period of the survey apart. Where frames are
    histograms, `counted` patches are behind each; None: all, or nobody knows.
    """
    estimates, step_s = [], []
    # The products of a frame are so small that threads of the BLAS mostly wait for each other.
    with threadpool_limits(1, user_api="blas"):
        for row, frame in enumerate(frames):
            aided = None if aiding is None else aiding[row]
            time = None if times is None else float(times[row])
            start = perf_counter()
            estimates.append(localizer.step(frame, aiding=aided, time=time, samples=counted))
            step_s.append(perf_counter() - start)
    return Track.of(estimates, np.array(step_s))


def tracks(
    texton_map: TextonMap,
    frames: Frames,
    *,
    repeats: int,
    seed: int,
    times: np.ndarray | None = None,
    counted: int | None = None,
    label: str = "runs of the filter",
    **options: Any,
) -> list[Track]:
    """`repeats` independent runs; run i draws from stream ``"flight", i``."""
    run = partial(_run, texton_map, frames, seed, times, counted, options)
    return spread(run, range(repeats), label)


def _run(
    texton_map: TextonMap,
    frames: Frames,
    seed: int,
    times: np.ndarray | None,
    counted: int | None,
    options: dict[str, Any],
    number: int,
) -> Track:
    localizer = Localizer(texton_map, rng=stream(seed, "flight", number), **options)
    return fly(localizer, frames, times=times, counted=counted)
