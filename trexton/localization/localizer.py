"""Algorithm 1 of the paper over the trained parts of a map. Offers `Localizer`, frame in, estimate
out: the same in flight as in a notebook."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.base.errors import ImageError, MapError, ParameterError
from trexton.base.options import number, whole
from trexton.base.streams import generator
from trexton.flights.aiding import Aiding
from trexton.localization.alike import are_shares
from trexton.localization.estimate import Estimate
from trexton.localization.filters import RunningFilter
from trexton.localization.neighbors import NearestHistograms, Neighbors
from trexton.localization.observation import Observation
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import for_method, with_choices
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.images import MOST_SAMPLES, check_image

__all__ = ["Estimate", "Localizer", "TextonMap"]

MAX_CATCH_UP = 25  # predictions for missed frames; more would only spread the particles further
STEADY_S = 1e-6  # stamps that differ from a period by less are equal to it
QUICK = 0.5  # of a period: frames that follow each other sooner advance a filter by less than one
LEAST = 0.01  # of a period, by which each frame advances a filter


class Localizer:
    """Composes the parts of a method: the same object is evaluated in the notebooks and flown on
    board.

    Parameters
    ----------
    texton_map : TextonMap
    method : str, optional
        Another than the map was trained for; its parts then learn from the map's training set.
    samples : int or None
        Patches drawn a frame; None labels every patch (full sampling).
    particles, neighbors : int, optional
        Short for the choices ``filter.particles``, ``measurement.neighbors``.
    nearest : NearestHistograms, optional
        Another search than over the map's own histograms.
    mark : callable, optional
        Called with "histogram", "neighbors", "filter" and "estimate" as each is done.
    rng : numpy.random.Generator
    **choices
        ``role``: a part, or its name; ``role.option``: a value. See `trexton.localization.methods`.

    Attributes
    ----------
    time : float or None
        Up to where the filter has been advanced, in seconds; None before the first frame.

    Raises
    ------
    ParameterError, MapError
        A part or option is unknown or out of range, `rng` is no generator; the map lacks what
        another method learns from.
    """

    def __init__(
        self,
        texton_map: TextonMap,
        method: str | None = None,
        *,
        samples: int | None = SAMPLES,
        particles: int | None = None,
        neighbors: int | None = None,
        nearest: NearestHistograms | None = None,
        mark: Callable[[str], object] | None = None,
        rng: np.random.Generator,
        **choices: object,
    ):
        rng = generator(rng)
        if not isinstance(texton_map, TextonMap):
            raise ParameterError(
                f"texton_map is a {type(texton_map).__name__}: expected a TextonMap, as load_map "
                "or train_map makes it"
            )
        short = {"filter.particles": particles, "measurement.neighbors": neighbors}
        choices |= {key: count for key, count in short.items() if count is not None}
        texton_map = with_choices(for_method(texton_map, method), choices)
        if samples is not None:  # every patch
            samples = whole(samples, "samples", 1, MOST_SAMPLES)
        parts: dict[str, Any] = texton_map.parts
        self.map, self.parts, self.samples, self.rng = texton_map, parts, samples, rng
        self._nearest, self._mark = nearest, mark or str
        self.filter: RunningFilter = parts["filter"].open(parts, texton_map, rng)
        appearance = parts.get("appearance")
        self._appearance = None if appearance is None else appearance.open(texton_map, rng)
        odometry = parts.get("odometry")
        self._odometry = None if odometry is None else odometry.open()
        self.time: float | None = None
        self._last = self._before = -np.inf  # times of the last frame, and of that advanced to

    @cached_property
    def nearest(self) -> NearestHistograms:
        """The search for the most similar training histograms."""
        if self._nearest is not None:
            return self._nearest
        own = self.map
        most = min(own.neighbors, len(own.histograms))
        return NearestHistograms(own.histograms, own.positions, most, distance=own.distance)

    @cached_property
    def _shares(self) -> bool:
        """Whether the map holds relative frequencies, not values of other features."""
        return are_shares(self.map.histograms)

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.filter.reset()
        self.time, self._last, self._before = None, -np.inf, -np.inf
        for part in (self._appearance, self._odometry):
            if part is not None:
                part.reset()

    def observe(self, frame: np.ndarray, *, aiding: Aiding | None = None) -> np.ndarray:
        """``(K,)`` histogram of a frame, which is an ``(H, W, 3) uint8`` image or already a
        histogram.

        Raises
        ------
        ImageError, MapError
            The frame does not fit the map.
        """
        self._check(frame)
        return self._histogram(frame, aiding)

    def step(
        self,
        frame: np.ndarray | None,
        *,
        aiding: Aiding | None = None,
        time: float | None = None,
        samples: int | None = None,
    ) -> Estimate:
        """Localize one frame; None stands for a frame that did not come, and only predicts.

        Parameters
        ----------
        frame : array or None
            An ``(H, W, 3) uint8`` image, or a ``(K,)`` histogram.
        aiding : Aiding, optional
            What the autopilot knows at this frame.
        time : float, optional
            Seconds, of the frame; without, frames are a period of the survey apart.
        samples : int, optional
            Patches behind a histogram that is given; None if all were counted or nobody knows.

        Raises
        ------
        ImageError, MapError, ParameterError
            The frame, `samples` or `time` does not fit; the filter is left as it was.
        """
        if frame is None:
            return self.advance(None, time)
        if np.ndim(frame) != 1:
            samples = self.samples
        elif samples is not None:
            samples = whole(samples, "samples")
        return self.advance(self.observation(frame, aiding=aiding, time=time, samples=samples))

    def advance(self, observation: Observation | None, time: float | None = None) -> Estimate:
        """As `step`, with an observation that was made by `observation` and knows its time."""
        due = self._catch_up(observation, time if observation is None else observation.time)
        if self._appearance is not None and observation is not None:
            observation.histogram  # noqa: B018  the appearance takes the frame first
            observation.familiar = self._appearance.settled
        if due:
            self.filter.step(observation)
        self._mark("filter")
        estimate = self.filter.estimate()
        if self._appearance is not None:
            estimate = replace(estimate, lost=estimate.lost or not self._appearance.settled)
            self._appearance.locate(estimate)
        self._mark("estimate")
        if observation is None:
            return replace(estimate, observed=False, measurement=None)
        asked = vars(observation)  # as far as anything asked for them
        histogram, neighbors = asked.get("histogram"), asked.get("neighbors")
        return replace(estimate, observed=True, histogram=histogram, neighbors=neighbors)

    def _now(self, time: float | None) -> float:
        if time is None:
            return (self.time or 0.0) + self.map.period_s
        return number(time.item() if isinstance(time, np.ndarray | np.generic) else time, "time")

    def _catch_up(self, observation: Observation | None, time: float | None) -> bool:
        """Advance the filter over frames that did not come, by whole periods; what is left over is
        kept for the next frame. Returns whether a step is due.
        """
        period, now = self.map.period_s, self._now(time)
        later = now > self._before
        self._before = self._before if observation is None else now
        if self.time is None:
            self.time = None if observation is None else now
            return True
        missed = max(0, round((now - self.time) / period) - 1)
        for _ in range(min(missed, MAX_CATCH_UP)):
            self.filter.step(None)
        self.time += missed * period
        quick = later and now - self.time < QUICK * period
        if quick and observation is not None:
            observation.since_s = max(now - self.time, LEAST * period)
            self.time = max(self.time, now)
        elif not quick:
            self.time = min(self.time, now - QUICK * period) + period  # no quick frame is a debt
        return observation is not None or not quick

    def observation(
        self,
        frame: np.ndarray,
        *,
        aiding: Aiding | None = None,
        time: float | None = None,
        samples: int | None = None,
    ) -> Observation:
        """What a frame brings; `samples` were counted for it, None if all were or nobody knows.

        Give frames in order, as odometry needs them. Errors are those of `step`.
        """
        self._check(frame)
        now = self._now(time)
        since, self._last = now - self._last, now
        if abs(since - self.map.period_s) < STEADY_S:
            since = self.map.period_s
        if self._odometry is not None and frame.ndim > 1:
            aiding = self._odometry.aid(frame, aiding, now)
        observation = Observation(
            None if frame.ndim == 1 else frame,
            aiding=aiding,
            time=None if time is None else now,
            samples=samples,
            histogram=lambda: self._histogram(frame, aiding),
            neighbors=self._neighbors,
        )
        if self._appearance is not None and frame.ndim > 1:
            observation.velocity_seen = self._appearance.velocity(frame, since)
        return observation

    def _check(self, frame: np.ndarray) -> None:
        width = self.map.histograms.shape[1]
        if isinstance(frame, np.ndarray) and frame.ndim == 1:
            numbers = frame.dtype.kind in "fiu" and np.isfinite(frame).all()
            if frame.shape != (width,) or not numbers or np.ma.is_masked(frame):
                raise MapError(
                    f"a histogram of {frame.dtype} of shape {frame.shape} was given: "
                    f"this map takes {width} finite frequencies"
                )
            # Counts, that is: shares to which a trace of the last frame was added are let pass, and
            # so is a frame in which nothing was found to count.
            if self._shares and frame.any() and not 0.5 <= frame.sum() <= 2:
                raise MapError(
                    f"a histogram that sums to {frame.sum():.4g} was given: this map takes "
                    "relative frequencies, which sum to 1, divide counts by their sum"
                )
            return
        if self.map.dictionary is None or self.map.image_shape is None:
            shape = f" of shape {frame.shape}" if hasattr(frame, "shape") else ""
            raise MapError(
                f"a {type(frame).__name__}{shape} was given: this map takes an array of {width} "
                "finite frequencies, for it was trained on histograms and holds no textons"
            )
        check_image(frame)
        if frame.shape[:2] != self.map.image_shape:
            rows, columns = self.map.image_shape
            raise ImageError(
                f"the frame is {frame.shape[1]}x{frame.shape[0]}, but the map was trained on "
                f"{columns}x{rows}: set the camera to that size, or apply the map's rectification"
            )

    def _histogram(self, frame: np.ndarray, aiding: Aiding | None) -> np.ndarray:
        dictionary, cells = self.map.dictionary, self.map.cells
        if dictionary is None or frame.ndim == 1:
            return frame
        if self._appearance is not None:
            self._appearance.update(frame, None if aiding is None else aiding.yaw)
            frame = self._appearance.corrected(frame)
        if self.samples is None:
            histogram = texton_histogram(frame, dictionary, cells=cells)
        else:
            histogram = sampled_histogram(
                frame, dictionary, self.samples, rng=self.rng, cells=cells
            )
        self._mark("histogram")
        return histogram

    def _neighbors(self, histogram: np.ndarray) -> Neighbors:
        neighbors = self.nearest.query(histogram)
        self._mark("neighbors")
        return neighbors
