"""A video with a file of positions (a table, motion capture, a log). The offset between their
clocks is given, or found by their motion.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.options import option
from trexton.base.pictures import damage
from trexton.base.progress import progress
from trexton.flights.frames import Forward
from trexton.flights.importers.recording import (
    NANO,
    PoseTrack,
    Recording,
    beside,
    nanoseconds,
    printed,
)
from trexton.flights.importers.tracks import TrackColumns, read_track
from trexton.vision.images import check_capture
from trexton.vision.time_offset import small

SUFFIXES = (".avi", ".mkv", ".mov", ".mp4", ".m4v", ".webm")
_GRID, _AROUND = 0.02, 0.3  # seconds between the offsets that are tried, and smoothed over
_SURE = 0.5  # correlation from which an estimated offset is believed
# Of JPEGs `_damaged` tells, and their decoder calls what cameras add to them invalid.
_ERRORS = re.compile(r"(?im)^\[(?!mjpeg).*?\] (.*(?:error|conceal|corrupt|damaged|invalid).*)")
_WHOLE = 0.98  # of the frames announced: some containers only estimate their number


@dataclass(frozen=True)
class Settings(TrackColumns):
    """What can be chosen."""

    positions: str = option(
        "", "table of t, x, y, motion capture or autopilot's log (default: DJI's subtitles beside)"
    )
    offset: float | None = option(None, "the table's clock in s at the first frame (estimated)")
    every: int = option(1, "keep every n-th frame", low=1)


def recognises(source: Path) -> bool:
    return source.is_file() and source.suffix.lower() in SUFFIXES


def read(source: Path, settings: Settings) -> Recording:
    """The recording of a video; frames are decoded again when they are asked for, in order."""
    if settings.positions:
        path = beside(source.parent, settings.positions)
    else:  # subtitles are stamped by the video itself
        subtitles = [source.with_suffix(suffix) for suffix in (".srt", ".SRT")]
        path = next((each for each in subtitles if each.is_file()), source)
    if path == source:
        raise ParameterError(f"{source}: a video has no positions: name a table, --positions FILE")
    track, read_so = read_track(path, settings)
    stamps, motion, cut = _scan(source)
    stamps, start = stamps - stamps[0], float(stamps[0])
    if settings.offset is not None:
        offset, said = settings.offset, f"time offset {settings.offset:g} s, as given"
    elif not settings.positions:
        offset, said = start, f"positions of {path.name}, on the video's clock"
    else:
        offset, alike = estimate_offset(stamps, motion, track)
        said = f"time offset {offset:.2f} s, estimated from the motion (correlation {alike:.2f})"
        if alike < _SURE:
            advice = "the images do not move as the positions do: give it, --offset SECONDS"
            raise FlightError(f"{source}: {said}: {advice}")
    if damaged := _damaged(source):
        first = f"number {damaged[0] + 1}, at {stamps[damaged[0]]:.2f} s"
        cut.append(f"{source}: damaged frames, left out: {len(damaged)} (first: {first})")
    rows = np.setdiff1d(np.arange(len(stamps)), damaged)[:: settings.every]
    frames = Forward(source, rows, lambda: _stamped(source), lambda item: item[1])
    name, words = f"video {source.name}", [said, *read_so, *cut]
    time_ns, track = nanoseconds(stamps[rows]), track.shifted(-offset)
    return Recording(time_ns, track, frames, source=name, said=words)


def estimate_offset(stamps: np.ndarray, flow: np.ndarray, track: PoseTrack) -> tuple[float, float]:
    """The stamp of the first frame on the track's clock, and the correlation that speaks for it;
    raises `FlightError` where the track is shorter than two seconds, or nothing moves.

    The clocks may start apart by as much as leaves half of the shorter recording in common. Of the
    frames, `stamps` ``(N,)`` are seconds from the first, `flow` ``(N,)`` the image motion before
    each in pixels a second.
    """
    track = track.located()
    time = (track.time_ns - track.time_ns[0]) / NANO
    if len(time) < 10 or time[-1] < 2 or len(stamps) < 10:
        few = f"{len(stamps)} frames and {time[-1]:.1f} s of positions are too few"
        raise FlightError(f"{few} to find the time offset: give it, --offset SECONDS")
    stamps = stamps - np.diff(stamps, prepend=stamps[0]) / 2  # in the middle of each motion
    grid, frames = np.arange(time[0], time[-1], _GRID), np.arange(stamps[0], stamps[-1], _GRID)
    path = np.column_stack([np.interp(grid, time, column) for column in track.position[:, :2].T])
    speed = np.hypot(*np.gradient(path, _GRID, axis=0).T)
    moved = np.interp(frames, stamps, flow)
    width = round(_AROUND / _GRID)
    window = np.full(width, 1 / width)
    speed, moved = (np.convolve(values, window, mode="same") for values in (speed, moved))
    half = min(len(speed), len(moved)) // 2
    shifts = np.arange(half - len(moved), len(speed) - half)
    correlations = np.full(len(shifts), -1.0)
    for row, shift in enumerate(shifts.tolist()):
        low, high = max(0, shift), min(len(speed), shift + len(moved))
        a, b = speed[low:high], moved[low - shift : high - shift]
        if a.std() * b.std() > 0:
            correlations[row] = np.corrcoef(a, b)[0, 1]
    best = int(correlations.argmax())
    if correlations[best] == -1:
        raise FlightError("nothing moves in the images or in the positions: give --offset SECONDS")
    offset = float(shifts[best] * _GRID + (grid[0] - frames[0]))
    return offset + track.time_ns[0] / NANO, float(correlations[best])


def _scan(source: Path) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Stamps of all frames in seconds from the first, how fast the image moves before each, and
    sentences where the file announces more frames, or its decoder tells of damage.
    """
    seen: list[float] = []
    moved: list[float] = []
    capture = cv2.VideoCapture(str(source))
    announced, rate = map(capture.get, (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FPS))
    before = None
    with printed(_ERRORS) as errors:
        for stamp, frame in progress(_stamped(source), "video"):
            luma = small(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)[..., None]).astype(np.float32)
            across, down = (0.0, 0.0) if before is None else cv2.phaseCorrelate(before, luma)[0]
            seen.append(stamp)
            moved.append(float(np.hypot(across, down)))
            before = luma
    stamps = np.array(seen)
    if len(stamps) < 3:
        raise FlightError(f"{source}: {len(stamps)} frames could be decoded: copy it again")
    cut = []
    lasted = 1 + np.ptp(stamps) * rate  # in frames: of a variable rate there are fewer
    if max(len(stamps), lasted) < _WHOLE * announced - 1 < 1e9:  # some containers name any number
        why = "the file is cut short, or damaged and what follows is stamped too early"
        cut = [f"{source}: {len(stamps)} of {announced:.0f} frames could be decoded: {why}"]
    if errors:
        words = f"{source}: its decoder tells of {len(errors)} errors: frames are made up in part"
        cut.append(f"{words}: copy it again (first: {errors[0]})")
    motion = np.array(moved) / np.maximum(np.diff(stamps, prepend=stamps[0] - 1), 1e-3)
    return stamps, motion, cut


def _damaged(video: Path) -> list[int]:
    """The frames of a video of JPEGs that are damaged, of which decoders fill the rest with grey;
    other codecs do not tell.
    """
    capture = cv2.VideoCapture(str(video))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    damaged: list[bool] = []
    if code.to_bytes(4, "little").upper() in (b"MJPG", b"JPEG"):
        capture.set(cv2.CAP_PROP_FORMAT, -1)  # bytes as they are
        while (got := capture.read())[0]:
            damaged.append(damage(got[1].tobytes()) != "")
    return np.flatnonzero(damaged).tolist()


def _stamped(video: Path) -> Iterator[tuple[float, np.ndarray]]:
    """Stamp in seconds and BGR of each frame; where stamps are missing, by the stated rate."""
    capture = cv2.VideoCapture(str(video))
    check_capture(capture, video)
    rate = capture.get(cv2.CAP_PROP_FPS) or 25.0
    last, number = -1.0, 0
    while (got := capture.read())[0]:
        stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        stamp = stamp if stamp > last else last + 1 / rate if number else 0.0
        yield stamp, got[1]
        last, number = stamp, number + 1
