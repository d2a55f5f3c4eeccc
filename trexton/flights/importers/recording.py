"""What an importer reads: frames with their stamps, and a track of positions with its own.

`Recording` and `PoseTrack` hold it, `TrackColumns` declares a format of tables, `match` gives each
frame its position.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.flights.frames import Frames
from trexton.flights.importers.axes import attitude_from_quaternions, camera_attitude
from trexton.flights.tables import LENGTHS, TIMES, TextTable
from trexton.vision.camera import Camera, wrapped

__all__ = [
    "Recording",
    "PoseTrack",
    "TrackColumns",
    "beside",
    "match",
]

NANO = TIMES["s"]


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Where the vehicle was.

    Attributes
    ----------
    time_ns : (M,) int64 array
        On the clock of the frames, as far as the source knows.
    position : (M, 3) array
        Metres; z is NaN where it was not recorded.
    attitude : (M, 3) array or None
        Roll, pitch, yaw in radians; see `trexton.vision.camera`.
    """

    time_ns: np.ndarray
    position: np.ndarray
    attitude: np.ndarray | None = None

    def shifted(self, seconds: float) -> PoseTrack:
        """The track with its clock set forward; raises `ParameterError` for centuries."""
        if not abs(seconds) < 2**62 / NANO:
            raise ParameterError(f"offset {seconds:g} s: expected less than a century")
        return PoseTrack(self.time_ns + round(seconds * NANO), self.position, self.attitude)

    def located(self) -> PoseTrack:
        """The rows with a place; raises `FlightError` where there are none, or out of order."""
        rows = ~np.isnan(self.position[:, :2]).any(axis=1)
        attitude = None if self.attitude is None else self.attitude[rows]
        track = PoseTrack(self.time_ns[rows], self.position[rows], attitude)
        if not rows.any() or (np.diff(track.time_ns) <= 0).any():
            found = "no row has a place: give x and y"
            if rows.any():
                found = "their stamps do not all increase: sort them and drop repeated rows"
            raise FlightError(f"{len(rows)} rows of positions, {found}")
        return track


@dataclass(frozen=True)
class TrackColumns:
    """Which columns of a table hold a track, and in which units: a format of tables, declared.

    Attributes
    ----------
    time, x, y, z, yaw : str
        Names of columns; without z or yaw (empty) none is known.
    quaternion : (x, y, z, w), optional
        Names of the columns of the attitude, instead of a yaw.
    time_unit, unit : str
        Of `TIMES` and `LENGTHS`.
    degrees : bool
        The yaw is in degrees.
    """

    time: str
    x: str
    y: str
    z: str = ""
    yaw: str = ""
    quaternion: tuple[str, ...] = ()
    time_unit: str = "s"
    unit: str = "m"
    degrees: bool = False

    def read(
        self, table: TextTable, axes: str | np.ndarray = "auto"
    ) -> tuple[PoseTrack, list[str]]:
        """The track, and a sentence that tells how its quaternions were taken, if it has any.

        Parameters
        ----------
        axes : str or (3, 3) array
            An entry of `AXES`, ``auto``, or how the sensor is mounted.

        Raises
        ------
        FlightError
            A column is missing, or holds something else.
        """
        stamps = table.nanoseconds(self.time, self.time_unit)
        unknown = np.full(len(table), np.nan)
        position = LENGTHS[self.unit] * np.column_stack(
            [table.numbers(name) if name else unknown for name in (self.x, self.y, self.z)]
        )
        if self.quaternion:
            turns = np.column_stack([table.numbers(name) for name in self.quaternion])
            if isinstance(axes, str):
                attitude, said = camera_attitude(turns, axes)
            else:
                attitude = attitude_from_quaternions(turns, axes)
                said = "attitude of the camera as T_BS tells"
            return PoseTrack(stamps, position, attitude), [said]
        if not self.yaw:
            return PoseTrack(stamps, position), []
        yaw = table.numbers(self.yaw)
        yaw = np.radians(yaw) if self.degrees else yaw
        level = np.zeros_like(yaw)
        return PoseTrack(stamps, position, np.column_stack([level, level, yaw])), []


@dataclass(frozen=True, eq=False)
class Recording:
    """A flight as its source has it.

    Attributes
    ----------
    time_ns : (N,) int64 array
        Stamps of the frames.
    track : PoseTrack or None
        None where the source has no positions.
    frames : Frames or None
        None without images.
    histograms : (N, K) array or None
    features : str
        What the histograms count: ``textons``, or another word for features whose values need not
        sum to one.
    camera : Camera or None
    distortion : (D,) array or None
        Of the camera, in OpenCV's order.
    origin : (latitude, longitude) or None
        Degrees of the place from which the track counts metres east and north.
    notes : list of str
        What a reader of the flight must know.
    said : list of str
        Sentences for the person who imports.
    """

    time_ns: np.ndarray
    track: PoseTrack | None = None
    frames: Frames | None = None
    histograms: np.ndarray | None = None
    features: str = "textons"
    camera: Camera | None = None
    distortion: np.ndarray | None = None
    origin: tuple[float, float] | None = None
    source: str = ""
    licence: str = ""
    notes: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)


def match(time_ns: np.ndarray, track: PoseTrack, tolerance_s: float) -> tuple[PoseTrack, float]:
    """The track at the frames, and the largest gap in seconds that was bridged.

    Positions are interpolated, angles along the shorter way; NaN where no position is near.

    A frame is matched if it lies on a stamp or between two that are at most twice the tolerance
    apart. Rows of the track without a place do not count.

    Raises
    ------
    FlightError
        The track has no place, its stamps do not increase, or no frame is matched.
    """
    track = track.located()
    stamps = track.time_ns
    before = np.clip(np.searchsorted(stamps, time_ns, "right") - 1, 0, None)
    after = np.clip(np.searchsorted(stamps, time_ns), None, len(stamps) - 1)
    step = stamps[after] - stamps[before]
    share = np.clip((time_ns - stamps[before]) / np.maximum(step, 1), 0, 1)
    gap = step / NANO
    # On a stamp, or beyond the track's ends, where the nearest serves if it is near enough.
    single = (step == 0) & (np.abs(time_ns - stamps[before]) / NANO <= tolerance_s)
    good = single | (step > 0) & (gap <= 2 * tolerance_s)
    if not good.any():
        first, last = ((edge - time_ns[0]) / NANO for edge in (stamps[0], stamps[-1]))
        raise FlightError(
            f"no frame has a position within {tolerance_s:g} s: frames cover 0 to "
            f"{(time_ns[-1] - time_ns[0]) / NANO:.2f} s, positions {first:.2f} to {last:.2f} s: "
            "give the time offset of the positions, or a larger tolerance"
        )
    position = _between(track.position[before], track.position[after], share)
    position[~good] = np.nan
    attitude = None
    if track.attitude is not None:
        low = track.attitude[before]
        turned = wrapped(track.attitude[after] - low)
        attitude = _between(low, low + turned, share)
        attitude[~good] = np.nan
        attitude = wrapped(attitude)
    return PoseTrack(time_ns, position, attitude), float(gap[good].max())


def _between(low: np.ndarray, high: np.ndarray, share: np.ndarray) -> np.ndarray:
    # Not low + share * (high - low): a NaN on the side that does not count must not spread.
    mixed = np.where(share[:, None] > 0, share[:, None] * high, 0.0)
    return np.where(share[:, None] < 1, (1 - share[:, None]) * low, 0.0) + mixed


def beside(folder: Path, name: str) -> Path:
    """A file that a person named: in the source's folder, or else from where they are."""
    inside = folder / name
    return inside if inside.exists() or not Path(name).exists() else Path(name)
