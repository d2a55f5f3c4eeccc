"""What an importer reads: frames with their stamps, and a track of positions with its own.

`Recording` and `PoseTrack` hold it, `match` gives each frame its position.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trexton.base.errors import FlightError, ParameterError
from trexton.flights.frames import Forward, ImageFiles
from trexton.flights.tables import TIMES, counted_on
from trexton.flights.tracking import SET_BACK, count_of
from trexton.vision.camera import Camera, wrapped

NANO = TIMES["s"]
SAME_PLACE = 0.05  # metres: rows of one stamp that lie nearer tell the same, rounded


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Where the vehicle was, on the clock of the frames as far as the source knows."""

    time_ns: np.ndarray  # (M,) int64, nanoseconds
    position: np.ndarray  # (M, 3) metres; z is NaN where it was not recorded
    attitude: np.ndarray | None = None  # (M, 3) roll, pitch, yaw: radians, see vision.camera
    origin: tuple[float, float] | None = None  # latitude, longitude of x (east), y (north) 0

    def rows(self, chosen: np.ndarray) -> PoseTrack:
        """The track at these rows: indices or a mask."""
        attitude = None if self.attitude is None else self.attitude[chosen]
        return PoseTrack(self.time_ns[chosen], self.position[chosen], attitude, self.origin)

    def shifted(self, seconds: float) -> PoseTrack:
        """The track with its clock set forward; raises `ParameterError` for centuries."""
        if not abs(seconds) < 2**62 / NANO:
            raise ParameterError(f"offset {seconds:g} s: expected less than a century")
        return replace(self, time_ns=self.time_ns + round(seconds * NANO))

    def located(self) -> PoseTrack:
        """The rows with a place; raises `FlightError` where there are none."""
        rows = ~np.isnan(self.position[:, :2]).any(axis=1)
        if not rows.any():
            raise FlightError(f"{len(rows)} rows of positions, no row has a place: give x and y")
        return self.rows(rows)

    def _refuse_another_unit(self, goes_on: np.ndarray, where: str, lines: Sequence[int]) -> None:
        power = np.diff(np.log10(np.abs(np.where(self.time_ns, self.time_ns, np.nan))))[2:] / 3
        mixed = (np.abs(power) > 0.9) & (np.abs(power - np.rint(power)) < 0.05) & goes_on
        if mixed.any():
            found = "the place goes on, but the stamp is a thousand times the one before"
            row = lines[int(mixed.argmax())]
            raise FlightError(f"{where}, row {row}: {found}, or a thousandth: give all in one unit")

    def ordered(self, where: str, lines: Sequence[int] = ()) -> tuple[PoseTrack, list[str]]:
        """The track in order of its stamps, one row a stamp, and what was done for it.

        Of rows with one stamp the first with a place is kept; where they lie apart, none is. The
        sentences name the source by `where`, and rows by `lines`, from 1 on unless given.
        """
        lines = lines or range(1, len(self.time_ns) + 1)
        moved = np.hypot(*np.diff(self.position[:, :2], axis=0).T)
        goes_on = moved <= 3 * np.nanmedian(moved) if np.isfinite(moved).any() else moved < 0
        self._refuse_another_unit(goes_on[2:], where, lines[3:])
        if (np.diff(self.time_ns) > 0).all():
            return self, []
        order = np.lexsort((np.isnan(self.position[:, :2]).any(axis=1), self.time_ns))
        _, first, group = np.unique(self.time_ns[order], return_index=True, return_inverse=True)
        place = self.position[order, :2]
        apart = np.hypot(*(place - place[first][group]).T)
        steps = np.hypot(*np.diff(place[first], axis=0).T)  # stamps may be rounded
        usual = np.median(steps[np.isfinite(steps)]) if np.isfinite(steps).any() else 0.0
        against = np.flatnonzero(apart > max(SAME_PLACE, 2 * usual))
        wrong = np.isin(group, group[against])
        kept = np.isin(np.arange(len(order)), first) & ~wrong
        if not kept.any():
            found = f"{len(order)} rows of positions, each stamp at several places"
            raise FlightError(f"{where}: {found}: name the column of the stamps")
        said = []
        if back := int((np.diff(self.time_ns) < 0).sum()):
            said.append(f"{where}: {back} rows of positions out of order, sorted by their stamps")
            for row in counted_on(self.time_ns, self.position[:, :2])[1][:1]:
                said[0] += f"; the place goes on at row {lines[row]}: {SET_BACK} mend the stamps"
        if dropped := np.flatnonzero(~kept & ~wrong).tolist():
            said.append(
                f"{where}: {count_of(len(dropped), 'row')} of positions with a repeated stamp "
                f"dropped (first: row {lines[order[dropped[0]]]})"
            )
        said += [
            f"{where}, rows {lines[order[first[group[row]]]]} and {lines[order[row]]}: one stamp, "
            f"but places {apart[row]:.2f} m apart: both left out ({len(against)} such)"
            for row in against[:1]
        ]
        return self.rows(order[kept]), said


@dataclass(frozen=True, eq=False)
class Recording:
    """A flight as its source has it."""

    time_ns: np.ndarray  # (N,) int64 nanoseconds, of the frames
    track: PoseTrack | None = None
    frames: ImageFiles | Forward | None = None
    histograms: np.ndarray | None = None  # (N, K)
    features: str = "textons"  # what they count: others than textons need not sum to one
    names: tuple[str, ...] = ()  # of the features
    camera: Camera | None = None
    source: str = ""
    said: list[str] = field(default_factory=list)  # sentences for the person who imports

    def rows(self, chosen: np.ndarray, *said: str) -> Recording:
        """The recording with these of its frames, and sentences that say so."""
        frames = None if self.frames is None else self.frames.at(chosen)
        histograms = None if self.histograms is None else self.histograms[chosen]
        time_ns, words = self.time_ns[chosen], [*self.said, *said]
        return replace(self, time_ns=time_ns, frames=frames, histograms=histograms, said=words)


def match(time_ns: np.ndarray, track: PoseTrack, tolerance_s: float) -> tuple[PoseTrack, float]:
    """The track at the frames, and the largest gap in seconds that was bridged; raises
    `FlightError` where the track has no place, or no frame is matched.

    Positions are interpolated, angles along the shorter way; NaN where no position is near.

    A frame is matched if it lies on a stamp or between two that are at most twice the tolerance
    apart. Rows of the track without a place do not count.
    """
    track = track.located()
    stamps = track.time_ns
    before = np.clip(np.searchsorted(stamps, time_ns, "right") - 1, 0, None)
    after = np.clip(np.searchsorted(stamps, time_ns), None, len(stamps) - 1)
    step = stamps[after] - stamps[before]
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
    share = np.where(good, (time_ns - stamps[before]) / np.maximum(step, 1), np.nan)[:, None]
    low, high, attitude = track.position[before], track.position[after], None
    position = low + share * (high - low)
    if track.attitude is not None:
        low, high = track.attitude[before], track.attitude[after]
        attitude = wrapped(low + share * wrapped(high - low))
    return PoseTrack(time_ns, position, attitude), float(gap[good].max())


@contextmanager
def reading(path: Path, kind: str, advice: str) -> Iterator[None]:
    """Around what a library is asked for, and nothing else: our own faults keep their traceback. A
    file that is no readable `kind` is refused by a `FlightError`, with the `advice`.
    """
    try:
        yield
    except (FlightError, ImportError):  # the command line says which extra is missing
        raise
    except Exception as error:  # whatever it raises of a damaged file
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise FlightError(f"{path}: not a readable {kind} ({said}): {advice}") from None


@contextmanager
def printed(pattern: re.Pattern[str]) -> Iterator[list[str]]:
    """What libraries print of damage meanwhile, which some do on standard error alone."""
    found: list[str] = []
    with tempfile.TemporaryFile() as stream, os.fdopen(os.dup(2), "w") as kept:
        os.dup2(stream.fileno(), 2)
        try:
            with redirect_stderr(kept):
                yield found
        finally:
            os.dup2(kept.fileno(), 2)
        stream.seek(0)
        found += pattern.findall(stream.read().decode("latin-1"))


def unreadable(images: Sequence[object]) -> list[str]:
    """A sentence on images that are left out, by what is wrong with each; none without any."""
    cut = f"images that cannot be read, left out: {len(images)}"
    return [f"{cut} (first: {images[0]})"] if images else []


def nanoseconds(seconds: np.ndarray) -> np.ndarray:
    """``(N,)`` stamps of seconds, to the nearest nanosecond."""
    return np.rint(seconds * NANO).astype(np.int64)


def spread(stamps: np.ndarray, step: int = NANO) -> np.ndarray:
    """Rounded stamps in nanoseconds, those of a burst, which are equal, spread over a `step`."""
    result = stamps.copy()
    for stamp in np.unique(stamps):
        same = np.flatnonzero(stamps == stamp)
        result[same] += np.arange(len(same)) * step // len(same)
    return result


def beside(folder: Path, name: str) -> Path:
    """A file that a person named: in the source's folder, or else from where they are."""
    inside = folder / name
    return inside if inside.exists() or not Path(name).exists() else Path(name)


def on_globe(degrees: ArrayLike) -> np.ndarray:
    """``(N, 3)`` kilometres from the centre of the Earth, of ``(N, 2)`` latitudes, longitudes."""
    latitude, longitude = np.radians(degrees).T
    across = np.cos(latitude) * np.exp(1j * longitude)
    return 6371 * np.column_stack([across.real, across.imag, np.sin(latitude)])


def together(degrees: ArrayLike) -> np.ndarray:
    """Which of ``(N, 2)`` latitudes, longitudes lie within 100 km of the middle of all: one
    projection serves no places that lie farther away.
    """
    globe = on_globe(degrees)
    return np.asarray(np.linalg.norm(globe - np.median(globe, axis=0), axis=1) < 100)


def local_metres(
    latitude: np.ndarray, longitude: np.ndarray
) -> tuple[np.ndarray, tuple[float, float]]:
    """``(N, 2)`` metres east and north of the south-west corner, and that corner in degrees (WGS
    84): a transverse Mercator projection, true to a millimetre over some kilometres. Raises
    `FlightError` where a latitude or longitude is no angle on Earth.
    """
    from pyproj import Proj

    good = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 180)
    if not good.all():
        row = int(np.argmin(good))
        found = f"position {row + 1} is {latitude[row]}, {longitude[row]}"
        hint = " (exchanged?)" * bool(abs(longitude[row]) <= 90)
        raise FlightError(f"{found}: expected degrees of latitude and longitude{hint}")
    corner = float(latitude.min()), float(longitude.min())
    plane = Proj(proj="tmerc", lat_0=corner[0], lon_0=corner[1], ellps="WGS84")
    return np.column_stack(plane(longitude, latitude)), corner


def heights_over(altitude: np.ndarray, ground: float | None) -> tuple[np.ndarray, list[str]]:
    """``(N,)`` heights above the floor, NaN where its altitude is not known; what to know."""
    if ground is not None or not np.isfinite(altitude).any():
        return altitude - (ground or 0.0), []
    sea = f"altitudes (about {np.nanmedian(altitude):.0f} m) are above the sea, not the floor"
    said = f"{sea}: heights left out; give --ground METRES, the altitude of the floor"
    return np.full(len(altitude), np.nan), [said]
