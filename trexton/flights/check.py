"""Read a flight folder to the last image and report what is there and what is wrong."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trexton.errors import ImageError
from trexton.flights.flight import Flight
from trexton.flights.folder import Reading, load_folder
from trexton.images import read_image
from trexton.progress import progress

__all__ = ["Report", "check_flight"]


@dataclass(frozen=True)
class Report:
    """What `check_flight` found: facts (name, text), faults that forbid the flight's use, and warnings."""

    path: Path
    facts: list[tuple[str, str]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def usable(self) -> bool:
        return not self.faults

    def __str__(self) -> str:
        width = max((len(name) for name, _ in self.facts), default=0)
        lines = [f"{name:<{width}}  {text}" for name, text in self.facts]
        lines += [f"fault    {fault}" for fault in self.faults]
        lines += [f"warning  {warning}" for warning in self.warnings]
        count = f"{_count(len(self.faults), 'fault')}, {_count(len(self.warnings), 'warning')}"
        verdict = "usable" if self.usable else "cannot be used"
        return "\n".join([*lines, f"{self.path}: {verdict} ({count})"])


def check_flight(path: str | os.PathLike) -> Report:
    """Read everything in the folder `path`, every image included; a faulty flight is reported, not raised."""
    reading = load_folder(Path(path))
    sizes = _check_images(reading)
    facts = [] if reading.flight is None else _facts(reading.flight, sizes)
    if reading.flight is not None and reading.flight.floor_file is not None:
        _check_floor(reading)
    return Report(Path(path), facts, reading.faults, reading.warnings)


def _check_images(reading: Reading) -> dict[tuple[int, int], int]:
    """Decode every image; count the sizes (width, height), and add a fault for each odd one out."""
    sizes: dict[tuple[int, int], int] = {}
    places: list[tuple[int, Path, tuple[int, int]]] = []
    for row, file in progress(reading.image_files, "images"):
        try:
            height, width = read_image(file).shape[:2]
        except ImageError as error:
            reading.faults.append(f"frames.csv, row {row}: {error}")
            continue
        sizes[width, height] = sizes.get((width, height), 0) + 1
        places.append((row, file, (width, height)))
    camera = reading.flight.camera if reading.flight else None
    expected = (camera.width, camera.height) if camera else max(sizes, key=sizes.get, default=None)
    whose = "[camera] says" if camera else "most are"
    for row, file, size in places:
        if size != expected:
            reading.faults.append(
                f"frames.csv, row {row}: {file} is {_size(size)} where {whose} {_size(expected)}: "
                "all images of a flight have one size"
            )
    return sizes


def _check_floor(reading: Reading) -> None:
    import cv2

    file = reading.flight.floor_file
    if cv2.imread(str(file), cv2.IMREAD_UNCHANGED) is None:
        reading.faults.append(
            f"{file}: the floor picture cannot be read: restore it or drop [floor] from flight.toml"
        )


def _facts(flight: Flight, sizes: dict[tuple[int, int], int]) -> list[tuple[str, str]]:
    duration = flight.time[-1] - flight.time[0]
    known = np.isfinite(flight.position).all(axis=1)
    facts = [
        ("flight", flight.name),
        ("frames", f"{len(flight)} ({flight.frame[0]} to {flight.frame[-1]})"),
    ]
    if len(flight) > 1:
        gaps = np.diff(flight.time)
        rate = f"{duration:.2f} s, {1 / np.median(gaps):.2f} frames a second, longest gap {gaps.max():.2f} s"
        facts.append(("duration", rate))
    facts.append(("positions", f"{known.sum()} of {len(flight)}"))
    if known.any():
        low, high = flight.position[known].min(axis=0), flight.position[known].max(axis=0)
        flown = f"{high[0] - low[0]:.2f} m x {high[1] - low[1]:.2f} m"
        x_min, x_max, y_min, y_max = flight.area
        facts.append(
            (
                "flown area",
                f"{flown}, x {low[0]:.2f} to {high[0]:.2f}, y {low[1]:.2f} to {high[1]:.2f}",
            )
        )
        facts.append(("area", f"x {x_min:.2f} to {x_max:.2f}, y {y_min:.2f} to {y_max:.2f} m"))
    if flight.has_images:
        facts.append(
            (
                "images",
                ", ".join(f"{count} of {_size(size)}" for size, count in sizes.items())
                or "none readable",
            )
        )
    if flight.has_histograms:
        sums = flight.histograms.sum(axis=1)
        facts.append(
            (
                "histograms",
                f"{len(sums)} of {flight.histograms.shape[1]} textons, sums {sums.min():.4f} to {sums.max():.4f}",
            )
        )
    for name, (first, last) in flight.split.items():
        count = int(((flight.frame >= first) & (flight.frame <= last)).sum())
        facts.append((f"split {name}", f"{first} to {last} ({_count(count, 'frame')})"))
    return facts + [("note", note) for note in flight.notes]


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _count(number: int, what: str) -> str:
    return f"{number or 'no'} {what}{'' if number == 1 else 's'}"
