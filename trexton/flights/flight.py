"""`Flight`: images, stamps and positions of one flight, the only form of data that methods take.

It checks its columns when it is made, and gives parts, images and a hash of all it holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import digest
from trexton.flights.aiding import Aiding
from trexton.flights.frames import ImageFiles
from trexton.vision.camera import Camera, MapImage, Rectification
from trexton.vision.histograms import SUM_TOLERANCE
from trexton.vision.images import read_picture
from trexton.vision.threads import ahead

Area = tuple[float, float, float, float]

NARROW = 1e-3  # metres: a side that is no area
_COLUMNS = {"position": "2", "attitude": "3", "histograms": "K"}
_PER_FRAME = ("frame", "time", "position", "height", "attitude", "histograms")


@dataclass(frozen=True, eq=False)
class Flight:
    """Frames in time order, with what was recorded beside each.

    Raises `FlightError` where a column has another length or shape, or stamps do not increase.

    Attributes
    ----------
    name : str
    frame : (N,) int64 array
        Frame numbers as the source counts them, strictly increasing.
    time : (N,) float64 array
        Stamps in seconds, strictly increasing.
    position : (N, 2) float64 array
        Ground truth x, y in metres; NaN where it was not recorded.
    height : (N,) array or None, metres above the floor
    attitude : (N, 3) array or None
        Roll, pitch, yaw in radians; see `trexton.vision.camera`.
    frames : ImageFiles or None
        The images, read when asked for.
    histograms : (N, K) float64 array or None
        Texton histograms where the source gives them, or values of other features.
    features : str
        What they count: ``textons``, relative frequencies that sum to one, or another word for
        values that need not.
    feature_names : tuple of str
        Names of their columns, where the source gives some: those of a map are compared to them.
    area : (x_min, x_max, y_min, y_max), metres
        Where the vehicle can be.
    split : dict of str to (first, last)
        Named ranges of frame numbers, both ends included.
    floor_file, floor_from_pixel
        A picture of the true floor, if known, and the ``(3, 3)`` homography to metres.
    rectification : Rectification or None, of the camera's images
    origin : (latitude, longitude), degrees (WGS 84), optional
        From where x counts metres east and y metres north.
    """

    name: str
    frame: np.ndarray
    time: np.ndarray
    position: np.ndarray
    area: tuple[float, float, float, float]
    height: np.ndarray | None = None
    attitude: np.ndarray | None = None
    frames: ImageFiles | None = None
    histograms: np.ndarray | None = None
    features: str = "textons"
    feature_names: tuple[str, ...] = ()
    camera: Camera | None = None
    split: dict[str, tuple[int, int]] = field(default_factory=dict)
    floor_file: Path | None = None
    floor_from_pixel: np.ndarray | None = None
    rectification: Rectification | None = None
    origin: tuple[float, float] | None = None
    source: str = ""
    licence: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for key in (*_PER_FRAME, "frames"):
            if (value := getattr(self, key)) is None:
                continue
            if key != "frames":
                value = self._numbers(key, value)
                object.__setattr__(self, key, value)
            elif not isinstance(value, ImageFiles):
                raise FlightError(
                    f"flight {self.name!r} has {type(value).__name__} as frames: expected "
                    "trexton.flights.frames.ImageFiles"
                )
            if len(value) != len(self.frame):
                raise FlightError(
                    f"flight {self.name!r} has {len(self.frame)} frame numbers and {len(value)} of "
                    f"{key}: give one for each frame"
                )
        count = 0 if self.histograms is None else self.histograms.shape[1]
        names = self.feature_names
        if names and not len({*names, "frame"}) - 1 == len(names) == count:
            found = f"flight {self.name!r} has {len(names)} names of {count} features"
            raise FlightError(f"{found}: give one for each, all different, or none")
        if self.features == "textons" and self.histograms is not None:
            sums = self.histograms.sum(axis=1)
            wrong = ~(np.abs(sums - 1) <= SUM_TOLERANCE) & self.histograms.any(axis=1)
            wrong |= (self.histograms < 0).any(axis=1)
            if wrong.any():  # rows in which nothing was counted are let pass
                raise FlightError(
                    f"flight {self.name!r} has a histogram that sums to {sums[wrong][0]:.4g}: "
                    "expected relative frequencies that sum to 1, divide counts by their sum, or "
                    "name other features"
                )
        for key in ("time", "frame"):
            self._check_order(key, getattr(self, key))
        area = np.asarray(self.area, dtype=float)
        ordered = area.shape == (4,) and area[0] <= area[1] and area[2] <= area[3]
        if not (ordered and np.isfinite(area).all()):
            raise FlightError(
                f"flight {self.name!r} has the area {self.area}: expected x_min, x_max, y_min, "
                "y_max, the smaller of each first"
            )
        object.__setattr__(self, "area", tuple(area.tolist()))

    def _numbers(self, key: str, value: Any) -> np.ndarray:
        """A column as an array, NaN where it is masked; dates would be counted in nanoseconds."""
        numbers = np.asarray(value)
        if numbers.dtype.kind not in "iuf":
            unit = " of seconds" if key == "time" else ""
            raise FlightError(
                f"flight {self.name!r} has {key} of type {numbers.dtype}: expected numbers{unit}"
            )
        if key != "frame" or np.ma.is_masked(value):
            numbers = np.ma.filled(np.ma.asarray(value, dtype=float), np.nan)
        if key == "histograms" and not np.isfinite(numbers).all():
            found = f"flight {self.name!r} has histograms that are not finite: leave those "
            raise FlightError(f"{found}frames or features out")
        columns = _COLUMNS.get(key, "")
        fitting = ("", "K", *map(str, numbers.shape[1:]))
        if numbers.ndim != 1 + bool(columns) or columns not in fitting:
            raise FlightError(
                f"flight {self.name!r} has {key} of shape {numbers.shape}: expected "
                f"(N,{' ' * bool(columns)}{columns})"
            )
        return numbers

    def _check_order(self, key: str, value: np.ndarray) -> None:
        """Speeds, motion models and intervals are taken from one frame to the next."""
        wrong = ~np.isfinite(value)
        wrong[1:] |= value[1:] <= value[:-1]
        if wrong.any():
            row = int(wrong.argmax())
            after = f" after {value[row - 1]}" if row else ""
            raise FlightError(
                f"flight {self.name!r} has {key} {value[row]}{after} in row {row}: they must "
                "increase, sort the frames and drop those that come twice"
            )

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def has_images(self) -> bool:
        return self.frames is not None

    @property
    def located(self) -> np.ndarray:
        """``(N,) bool``: the frames with a position."""
        return np.isfinite(self.position).all(axis=1)

    @property
    def has_positions(self) -> bool:
        return bool(self.located.all())

    @property
    def diagonal(self) -> float:
        """Length of the area's diagonal in metres, the scale of errors relative to the area."""
        x_min, x_max, y_min, y_max = self.area
        return float(np.hypot(x_max - x_min, y_max - y_min))

    def image(self, index: int) -> np.ndarray:
        """The image at row `index` as ``(H, W, 3) uint8`` Y, U, V; raises `FlightError` where there
        are none, or it has another size than others, `ImageError` where it cannot be read.
        """
        if self.frames is None:
            raise FlightError(
                f"flight {self.name!r} has no images, but this step needs them: use a flight that "
                "was recorded with images"
            )
        image = self.frames[index]
        usual = self.__dict__.setdefault("_size", image.shape[1::-1])
        if image.shape[1::-1] != usual:
            raise FlightError(
                f"flight {self.name!r}: the image of frame {self.frame[index]} is "
                f"{image.shape[1]}x{image.shape[0]} where another is {usual[0]}x{usual[1]}: all "
                "images of a flight have one size, drop or scale those of another"
            )
        return image

    def images(self) -> Iterator[np.ndarray]:
        """All images in time order, decoded ahead on every processor."""
        rows = range(len(self))
        yield from map(self.image, rows[:1])  # with whose size the others are compared
        yield from ahead(self.image, rows[1:])

    def aiding(self, row: int) -> Aiding:
        """Attitude and height as they were recorded beside the frame at `row`."""
        stamp = float(self.time[row])
        roll, pitch, yaw = (np.nan,) * 3 if self.attitude is None else self.attitude[row].tolist()
        return Aiding(
            roll, pitch, yaw, None if self.height is None else float(self.height[row]),
            attitude_time=stamp, height_time=stamp,
        ).at(stamp)  # fmt: skip

    def select(self, rows: np.ndarray | slice, name: str | None = None) -> Flight:
        """The flight at these rows only: a slice, rising indices or a mask."""
        rows = np.arange(len(self))[rows]
        changes: dict[str, Any] = {
            key: value[rows] for key in _PER_FRAME if (value := getattr(self, key)) is not None
        }
        if self.frames is not None:
            changes["frames"] = self.frames.at(rows)
        return replace(self, name=name or self.name, **changes)

    def part_or_all(self, name: str) -> Flight:
        """The frames of the split `name`; all of them where there is none of that name."""
        return self.part(name) if name in self.split else self

    def part(self, name: str) -> Flight:
        """The frames of the split `name`; raises `FlightError` where there is none."""
        if name not in self.split:
            known = ", ".join(self.split) or "none"
            raise FlightError(
                f"flight {self.name!r} has no split {name!r} (known: {known}): name it in "
                "flight.toml"
            )
        first, last = self.split[name]
        return self.select((self.frame >= first) & (self.frame <= last))

    @cached_property
    def floor(self) -> MapImage | None:
        """The true floor as a map image, if the flight carries one; raises `FlightError` where it
        cannot be read.
        """
        if self.floor_file is None or self.floor_from_pixel is None:
            return None
        picture = read_picture(self.floor_file)
        if picture is None:
            raise FlightError(
                f"{self.floor_file}: the floor picture cannot be read: restore it or drop [floor] "
                "from flight.toml"
            )
        image, mask = picture
        return MapImage(image, self.floor_from_pixel, mask)

    @cached_property
    def data_hash(self) -> str:
        """SHA-256 over everything an experiment can read from this flight, images included."""
        arrays = [value for key in _PER_FRAME if (value := getattr(self, key)) is not None]
        scalars = [
            self.name,
            list(self.area),
            {key: list(value) for key, value in self.split.items()},
        ]
        floor = [self.floor_file, np.asarray(self.floor_from_pixel)] if self.floor_file else []
        camera = None
        if (lens := self.camera) is not None:
            camera = [lens.width, lens.height, lens.focal, *lens.principal_point]
        if self.features != "textons":
            scalars.append(self.features)
        scalars += self.feature_names
        if self.origin is not None:
            scalars.append(["origin", *map(float, self.origin)])
        if self.rectification is not None:
            scalars.append(["rectification", self.rectification.table()])
        images = [] if self.frames is None else [self.frames.digest]
        return digest(scalars, camera, *arrays, *floor, *images)


def area_around(position: np.ndarray, share: float = 0.0, least: float = 0.0) -> Area:
    """x_min, x_max, y_min, y_max of the places among ``(N, 2)`` positions, with a margin on each
    side: a share of the extent, and so many metres, at least 0.01 across a path along one axis.
    Where there is no place, all are 0.
    """
    places = position[np.isfinite(position).all(axis=1)]
    if not len(places):
        return 0.0, 0.0, 0.0, 0.0
    low, high = places.min(axis=0), places.max(axis=0)
    margin = share * (high - low) + np.where(high - low < NARROW, max(least, 0.01), least)
    (x_min, y_min), (x_max, y_max) = (low - margin).tolist(), (high + margin).tolist()
    return x_min, x_max, y_min, y_max
