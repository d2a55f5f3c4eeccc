"""How late frames are: their turning on the spot held against a yaw measured beside them.

A camera that looks down sees the floor turn by what the vehicle yaws, whatever the floor, its
height and how the vehicle moves. The lag at which the two agree best is the time offset between
camera and autopilot (as Kelly and Sukhatme, "A general framework for temporal calibration of
multiple proprioceptive and exteroceptive sensors", 2014, by their turns). No map is needed.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trexton.base.pictures import damage, declared_size, decode
from trexton.vision.images import checked_bytes, read_image
from trexton.vision.visual_odometry import FEWEST, shrink

EARLIEST_S, LONGEST_S, STEP_S = -0.2, 0.8, 0.01  # the offsets that are tried
AGREE, SURE_S = 0.8, 0.025  # correlation from which the two turn alike, and deviation up to which
HARMLESS_S = 0.05  # seconds; between them a vehicle goes and turns by little
MIRRORED = 0.1  # by which the other way round must fit better: who turns to and fro does both
BEND = 5  # steps on both sides over which it is looked at how sharp the best offset is
WINDOW_S = 0.3  # over which turns are added up: the noise of the yaw stays, what is turned grows
LONGEST_FLIGHT_S = 1e5  # stamps of another unit may reach further
SMOOTHED_S = 0.2  # of the yaw: its noise must weigh the same on its stamps and between them
WIDTH = 160  # pixels of the frames that turns are read off, about


@dataclass(frozen=True)
class TimeOffset:
    """By how many `seconds` frames are late, from what one shows to its stamp on the clock of the
    yaw, with the standard deviation; negative where they are early.

    The `correlation` is that of the two turns at that offset: negative where the picture turns the
    other way, as one that is mirrored does.
    """

    seconds: float
    sigma: float
    correlation: float

    @property
    def sure(self) -> bool:
        """Whether the vehicle turned enough to tell."""
        return abs(self.correlation) >= AGREE and self.sigma <= SURE_S

    @property
    def mirrored(self) -> bool:
        """Whether the picture turns the other way."""
        return self.correlation < 0

    @property
    def noticeable(self) -> bool:
        """Whether it is more than nothing, and more than matters."""
        return abs(self.seconds) > max(HARMLESS_S, 3 * self.sigma)


def small(image: np.ndarray) -> np.ndarray:
    """``(h, w) uint8`` luma of an ``(H, W, 3) uint8`` Y, U, V image, about `WIDTH` pixels wide."""
    luma = np.ascontiguousarray(image[..., 0])
    return shrink(luma, max(1, round(luma.shape[1] / WIDTH)))


def read_small(file: Path) -> np.ndarray:
    """`small` of a file that `read_image` can read; a JPEG is decoded no larger than it takes."""
    data = checked_bytes(file)
    wide = (declared_size(data) or (0,))[0]
    part = next((each for each in (8, 4, 2) if each * WIDTH <= wide), 0)
    whole = not part or data[:2] != b"\xff\xd8" or damage(data)
    luma = None if whole else decode(data, getattr(cv2, f"IMREAD_REDUCED_GRAYSCALE_{part}"))
    return small(read_image(file) if luma is None else luma[..., None])


def time_offset(
    stamps: ArrayLike, turned: ArrayLike, yaw_s: ArrayLike, yaw_rad: ArrayLike
) -> TimeOffset | None:
    """By how much frames are late; None where too few of them lie among the yaw's stamps.

    Parameters
    ----------
    stamps, turned : (N,) arrays
        Of the frames: seconds, and radians anticlockwise that the camera turned before each.
    yaw_s, yaw_rad : (M,) arrays
        Seconds on the same clock, increasing, and the yaw then: radians, anticlockwise.
    """
    time, seen = np.asarray(stamps, dtype=float), np.asarray(turned, dtype=float)
    yaw_s, yaw = np.asarray(yaw_s, dtype=float), np.unwrap(np.asarray(yaw_rad, dtype=float))
    if len(time) < FEWEST or len(yaw_s) < 2:
        return None
    if not 2 * SMOOTHED_S <= np.ptp(yaw_s) <= LONGEST_FLIGHT_S:
        return None
    yaw_s, yaw = _smoothed(yaw_s, yaw)
    several = max(1, round(WINDOW_S / max(float(np.median(np.diff(time))), 1e-3)))
    if len(time) - several < FEWEST:
        return None
    began, ended = time[:-several], time[several:]
    turn = np.convolve(seen[1:], np.ones(several), "valid")
    # The same frames at every offset, or those that are left over would choose it.
    within = (began - LONGEST_S >= yaw_s[0]) & (ended - EARLIEST_S <= yaw_s[-1])
    within &= np.isfinite(turn)
    if within.sum() < FEWEST:
        return None
    began, ended, turn = began[within], ended[within], turn[within]
    offsets = np.arange(EARLIEST_S, LONGEST_S + STEP_S / 2, STEP_S)
    late = offsets[:, None]
    by_yaw = np.interp(ended - late, yaw_s, yaw) - np.interp(began - late, yaw_s, yaw)
    # Who turns steadily turns alike at every offset: only what changes can tell.
    by_yaw, turn = by_yaw - by_yaw.mean(axis=1, keepdims=True), turn - turn.mean()
    common = (by_yaw * turn).mean(axis=1)
    correlation = common / np.maximum(by_yaw.std(axis=1) * turn.std(), 1e-12)
    flipped = -correlation.min() > correlation.max() + MIRRORED
    if flipped:
        by_yaw, common = -by_yaw, -common
    best = int(np.argmin(correlation) if flipped else np.argmax(correlation))
    slope = np.sqrt(np.square(np.gradient(by_yaw, STEP_S, axis=0)[best]).mean())
    # Noise makes the yaw's turns steeper, but not what the picture has in common with them.
    middle = min(max(best, BEND), len(offsets) - 1 - BEND)
    bend = 2 * common[middle] - common[middle - BEND] - common[middle + BEND]
    steepness = max(bend / (BEND * STEP_S) ** 2, 1e-12) / max(slope, 1e-9)
    sigma = float(np.std(turn - by_yaw[best]) / steepness / np.sqrt(within.sum() / several))
    return TimeOffset(float(offsets[best]), max(sigma, STEP_S / 2), float(correlation[best]))


def _smoothed(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every `STEP_S`, the mean of `SMOOTHED_S` around."""
    width = round(SMOOTHED_S / STEP_S) + 1
    grid = np.arange(time[0], time[-1], STEP_S)
    mean = np.convolve(np.interp(grid, time, values), np.full(width, 1 / width), "valid")
    return grid[width // 2 : width // 2 + len(mean)], mean
