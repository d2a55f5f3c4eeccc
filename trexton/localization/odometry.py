"""Visual odometry as velocity aiding: what the frames themselves say, for filters that use it.

Phase correlation of each frame with the one before (`trexton.vision.visual_odometry`). It needs the
camera and the height at which it flies, no map and no autopilot; attitude and height make it more
accurate. What it tells apart are places that look alike: nobody jumps from one mat to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import option
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.base import Part, learned
from trexton.localization.lens import camera_of, check_lens, learned_lens
from trexton.localization.training_set import Training
from trexton.vision.visual_odometry import VisualOdometry

SIGMA_FLOOR = 0.1  # m/s along an axis; attitude errors in flight allow no less
WIDTH = 160  # pixels of a downscaled frame, about; smaller frames stay as they are
MAX_INTERVAL_S = 0.5  # between two frames; beyond, they hardly overlap
TRAINING_FRAMES = 400  # of the training flight, from which the error is learned
MAX_CORRELATION = 0.95  # of the errors of successive frames
DEFAULT_SIGMA = 0.2  # m/s, where the training flight has too few frames in a row
STEEPEST = 0.7  # radians of tilt; beyond, the picture holds little of what lies below
FARTHEST = 3.0  # times the usual height, or a part of it: beyond, it is another picture


class Odometry(Part):
    """Base of all that make a velocity of frames."""

    def open(self) -> RunningVisual:
        """For one flight."""
        raise NotImplementedError


@dataclass(eq=False)
class Visual(Odometry):
    """How far the picture moved from one frame to the next.

    The heading is that of the training flight unless a yaw comes with the frame; without roll and
    pitch, tilting looks like motion, and without a height the usual one is taken. How far its
    velocities are off is learned from the training flight, with the attitude and without. An
    autopilot's velocity is taken where the frame shows none.
    """

    sure: float = option(
        0.1, "peak of the correlation below which two frames show no motion", low=0, high=1
    )
    camera: Any = learned()  # see `learned_lens`
    sigma: Any = learned()  # (2,) metres a second along an axis, with the attitude and without

    def prepare(self) -> None:
        check_lens(self.camera, "an odometry's")
        if self.sigma.shape != (2,) or not (np.isfinite(self.sigma) & (self.sigma > 0)).all():
            raise MapError(
                f"an odometry's deviations are {self.sigma.tolist()}: expected two above 0, train "
                "the map again"
            )

    def fit(self, training: Training) -> Self:
        """Learn the camera, the usual height, and how far velocities are off.

        Raises
        ------
        MapError
            There is no flight, or it lacks images, heights or its camera.
        """
        flight = training.flight
        if flight is None:
            raise MapError(
                "odometry learns from the frames of a flight: choose it when training, as in "
                "trexton train FLIGHT --set odometry=visual"
            )
        lens = learned_lens(flight, "train without odometry")
        seeing = self.with_learned(camera=lens, sigma=np.full(2, DEFAULT_SIGMA))
        aidings = [flight.aiding(row) for row in range(min(TRAINING_FRAMES, len(flight)))]
        places = training.positions
        sigma = [
            _deviation(seeing.open(), flight, places, each)
            for each in (aidings, [None] * len(aidings))
        ]
        return seeing.with_learned(sigma=np.array(sigma))

    def open(self) -> RunningVisual:
        return RunningVisual(self)


class RunningVisual:
    """`Visual` in flight."""

    def __init__(self, part: Visual):
        camera, self._height = camera_of(part.camera)  # where nothing tells how high it flies
        self._odometry = VisualOdometry(camera, WIDTH)
        self._part = part
        self.reset()

    def reset(self) -> None:
        """Forget the frame before."""
        self._odometry.reset()
        self._time = -np.inf

    def aid(self, frame: np.ndarray, aiding: Aiding | None, now: float) -> Aiding | None:
        """What is known beside a frame of `now`, in seconds, with its velocity if it shows one."""
        given = Aiding() if aiding is None else aiding
        if not 0 < now - self._time <= MAX_INTERVAL_S:
            self._odometry.reset()
        self._time = now
        height = _known_or(given.height, self._height)
        roll, pitch, yaw = (_known_or(each, 0.0) for each in (given.roll, given.pitch, given.yaw))
        steep = max(abs(roll), abs(pitch)) > STEEPEST
        if steep or not 1 / FARTHEST < height / self._height < FARTHEST:
            height, roll, pitch = self._height, 0.0, 0.0
        motion = self._odometry.step(frame, now, height=height, attitude=[roll, pitch, yaw])
        if motion is None or motion[1] < self._part.sure:
            return aiding
        with_attitude, without = self._part.sigma.tolist()
        sigma = without if given.roll is None or given.pitch is None else with_attitude
        return replace(given, velocity=motion[0], velocity_time=now, velocity_sigma=sigma)


def _known_or(value: float | None, usual: float) -> float:
    """A measured number, or the usual one: OpenCV never returns from a homography of NaN."""
    return usual if value is None or not np.isfinite(value) else value


def _deviation(
    running: RunningVisual, flight: Flight, places: np.ndarray, aidings: Sequence[Aiding | None]
) -> float:
    """Metres a second by which velocities are off along an axis, as if each were new.

    Correlated errors count for more: 1 + 2 r / (1 - r) times their variance, with the correlation r
    of successive frames.
    """
    errors = []
    for row, aiding in enumerate(aidings):
        seen = running.aid(flight.image(row), aiding, float(flight.time[row]))
        if seen is not None and seen.velocity is not None and row:
            moved = places[row] - places[row - 1]
            errors.append(seen.velocity - moved / (flight.time[row] - flight.time[row - 1]))
    if len(errors) < 3:
        return DEFAULT_SIGMA
    off = np.array(errors)
    variance = max(float(np.square(off).mean()), SIGMA_FLOOR**2)
    correlation = float(np.clip((off[1:] * off[:-1]).mean() / variance, 0, MAX_CORRELATION))
    return float(np.sqrt(variance * (1 + 2 * correlation / (1 - correlation))))
