"""A video with a file of positions (a table, motion capture, a log); the offset between their
clocks is given, or found by their motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.options import option
from trexton.base.progress import progress
from trexton.flights.frames import Selected, VideoFrames, announced_frames, stamped_frames
from trexton.flights.importers.recording import NANO, PoseTrack, Recording, beside
from trexton.flights.importers.tracks import TrackColumns, read_track

__all__ = ["Settings", "estimate_offset", "read", "recognises"]

SUFFIXES = (".avi", ".mkv", ".mov", ".mp4", ".m4v", ".webm")
_WIDTH = 160  # pixels of the frames whose motion is measured
_STEP = 0.02  # seconds between the offsets that are tried
_SURE = 0.5  # correlation from which an estimated offset is believed
_WHOLE = 0.98  # of the frames announced: some containers only estimate their number


@dataclass(frozen=True)
class Settings(TrackColumns):
    """What can be chosen."""

    positions: str = option(
        "",
        "table of t, x, y beside the video, export of motion capture, or log of an autopilot "
        "(default: DJI's subtitles beside the video)",
    )
    offset: str = option(
        "estimate", "stamp of the first frame on the table's clock in s, or estimate"
    )
    every: int = option(1, "keep every n-th frame", low=1)


def recognises(source: Path) -> bool:
    return source.is_file() and source.suffix.lower() in SUFFIXES


def read(source: Path, settings: Settings) -> Recording:
    """The recording of a video; frames are decoded again when they are asked for, in order."""
    subtitles = [source.with_suffix(suffix) for suffix in (".srt", ".SRT")]
    path = next((each for each in subtitles if each.is_file()), None)
    own = not settings.positions  # they are stamped by the video itself
    if settings.positions:
        path = beside(source.parent, settings.positions)
    if path is None:
        raise ParameterError(f"{source}: a video has no positions: name a table, --positions FILE")
    track, read_so = read_track(path, settings)
    stamps, motion, cut = _scan(source)
    if own and settings.offset == "estimate":
        offset, said = 0.0, f"positions of {path.name}, on the video's clock"
    elif settings.offset == "estimate":
        offset, correlation = estimate_offset(stamps, motion, track)
        said = (
            f"time offset {offset:.2f} s, estimated from the motion (correlation {correlation:.2f})"
        )
        if correlation < _SURE:
            raise FlightError(
                f"{source}: {said}: not sure enough, the images do not move as the positions do: "
                "give it, --offset SECONDS"
            )
    else:
        try:
            offset = float(settings.offset)
        except ValueError:
            raise ParameterError(
                f"offset {settings.offset!r}: expected seconds, or estimate"
            ) from None
        said = f"time offset {offset:g} s, as given"
    chosen_rows = np.arange(0, len(stamps), settings.every)
    return Recording(
        np.rint(stamps[chosen_rows] * NANO).astype(np.int64),
        track.shifted(-offset),
        Selected(VideoFrames(source, len(stamps)), chosen_rows),
        source=f"video {source.name}",
        said=[said, *read_so, *cut],
    )


def estimate_offset(
    stamps: np.ndarray, motion: np.ndarray, track: PoseTrack
) -> tuple[float, float]:
    """The stamp of the first frame on the track's clock, and the correlation that speaks for it.

    Parameters
    ----------
    stamps : (N,) array
        Of the frames, seconds from the first.
    motion : (N,) array
        Image motion before each frame in pixels a second.
    track : PoseTrack

    Raises
    ------
    FlightError
        The track has no place, is out of order, shorter than two seconds, or does not move.
    """
    track = track.located()
    time = (track.time_ns - track.time_ns[0]) / NANO
    if len(time) < 10 or time[-1] < 2 or len(stamps) < 10:
        raise FlightError(
            f"{len(stamps)} frames and positions over {time[-1]:.1f} s are too few to find the "
            "time offset: give it, --offset SECONDS"
        )
    grid = np.arange(0, time[-1], _STEP)
    path = np.column_stack([np.interp(grid, time, track.position[:, i]) for i in (0, 1)])
    speed = _smooth(np.hypot(*np.gradient(path, _STEP, axis=0).T))
    frames = np.arange(0, stamps[-1], _STEP)
    moved = _smooth(np.interp(frames, stamps, motion))
    if not (np.ptp(speed) > 0 and np.ptp(moved) > 0):
        raise FlightError("nothing moves in the images or in the positions: give --offset SECONDS")
    shorter = min(len(speed), len(moved))
    best = (0.0, -1.0)
    # The clocks may start apart by as much as leaves half of the shorter recording in common.
    for shift in range(shorter // 2 - len(moved), len(speed) - shorter // 2):
        low, high = max(0, shift), min(len(speed), shift + len(moved))
        a, b = speed[low:high], moved[low - shift : high - shift]
        spread = a.std() * b.std()
        value = float(((a - a.mean()) * (b - b.mean())).mean() / spread) if spread > 0 else -1.0
        if value > best[1]:
            best = (shift * _STEP + track.time_ns[0] / NANO, value)
    return best


def _smooth(values: np.ndarray, seconds: float = 0.3) -> np.ndarray:
    width = max(1, round(seconds / _STEP))
    return np.convolve(values, np.full(width, 1 / width), mode="same")


def _scan(source: Path) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Stamps of all frames in seconds from the first, how fast the image moves before each, and a
    sentence where the file announces more frames.
    """
    stamps: list[float] = []
    motion = [0.0]
    before: np.ndarray | None = None
    for stamp, frame in progress(stamped_frames(source), "video"):
        scale = _WIDTH / frame.shape[1]
        small = cv2.resize(frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(np.float32)
        if before is not None:
            (dx, dy), _ = cv2.phaseCorrelate(before, grey)
            motion.append(float(np.hypot(dx, dy)) / scale / max(stamp - stamps[-1], 1e-3))
        stamps.append(stamp)
        before = grey
    if len(stamps) < 3:
        raise FlightError(f"{source}: {len(stamps)} frames could be decoded: expected a video")
    announced, cut = announced_frames(source), []
    if len(stamps) < _WHOLE * announced - 1:
        cut = [
            f"{source}: {len(stamps)} of {announced} frames could be decoded: the file is cut "
            "short, copy it again to have the rest"
        ]
    return np.array(stamps) - stamps[0], np.array(motion), cut
