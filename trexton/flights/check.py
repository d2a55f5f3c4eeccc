"""Read a flight folder to the last image: `check_flight` reports what is there and what is wrong,
`repair_flight` does what the warnings advise and writes the result beside the original.
"""

import os
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError, ImageError
from trexton.base.files import check_not_read
from trexton.base.progress import progress
from trexton.flights import plausibility
from trexton.flights.flight import Flight
from trexton.flights.folder import Reading, load_folder
from trexton.flights.tracking import count_of, ranges
from trexton.flights.writing import write_flight
from trexton.vision.images import read_image
from trexton.vision.threads import ahead

MOST_ROUNDS = 10  # a repair may uncover what another repairs
BLANK = 4  # of 255: what shows anything differs by more, and by noise alone where a lens is capped
DARK = 24  # of 255: nearly all of a picture of 12 bits is below, read as one of 16


@dataclass(frozen=True)
class Report:
    """What `check_flight` found: facts (name, text), faults that forbid its use, and warnings."""

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
        count = f"{count_of(len(self.faults), 'fault')}, {count_of(len(self.warnings), 'warning')}"
        verdict = "usable" if self.usable else "cannot be used"
        lines.append(f"{self.path}: {verdict} ({count})")
        return "\n".join(line.replace("\n", "\\n") for line in lines)  # of names and notes


def check_flight(path: str | os.PathLike[str]) -> Report:
    """Read everything in the folder `path`, every image included; a faulty flight is reported, not
    raised.
    """
    reading = load_folder(Path(path))
    sizes, unusable, frozen, dark = _images(reading)
    found = [] if reading.flight is None else facts(reading.flight)
    if reading.image_files:
        counts = (f"{count} of {'x'.join(map(str, size))}" for size, count in sizes.items())
        found.append(("images", ", ".join(counts) or "none readable"))
    faults, warnings = reading.faults + list(unusable.values()), reading.warnings
    if frozen:
        said = f"{count_of(len(frozen), 'picture')} like the one before to the byte, or blank"
        advice = "where the camera was frozen or capped, leave the frames out"
        warnings.append(f"{path}: {said} (first: frames.csv, row {frozen[0]}): {advice}")
    if dark > sizes.total() / 2:
        pictures = f"{count_of(dark, 'picture')} of {sizes.total()} darker than {DARK} of 255"
        warnings.append(f"{path}: {pictures}: 12 bits in 16? stretch them, or expose longer")
    if reading.flight is not None:
        try:
            reading.flight.floor  # noqa: B018 - reads the picture
        except (FlightError, ImageError) as error:
            faults.append(str(error))
        warnings += [f"{path}: {said}" for said in plausibility.warnings(reading.flight)]
    return Report(Path(path), found, faults, warnings)


def _images(reading: Reading) -> tuple[Counter[tuple[int, int]], dict[int, str], list[int], int]:
    """What decoding every image shows: how many are of each size; by rows of frames.csv, what keeps
    one from use; the rows whose picture is the one before, or blank; dark ones.
    """
    places: dict[int, tuple[Path, tuple[int, int]]] = {}
    unusable, frozen, before, dark = {}, [], np.empty(0), 0
    images = progress(ahead(_read, reading.image_files), "images", len(reading.image_files))
    for (row, file), image in zip(reading.image_files, images, strict=True):
        if isinstance(image, ImageError):
            unusable[row] = f"frames.csv, row {row}: {image}"
            continue
        if np.array_equal(image, before) or np.ptp(image[::4, ::4, 0]) < BLANK:
            frozen.append(row)
        before = image
        dark += bool(np.quantile(image[::4, ::4, 0], 0.99) < DARK)
        places[row] = file, (image.shape[1], image.shape[0])
    sizes = Counter(size for _, size in places.values())
    camera = reading.flight.camera if reading.flight else None
    usual = sizes.most_common(1)[0][0] if places else (0, 0)
    expected = (camera.width, camera.height) if camera else usual
    whose = "[camera] says" if camera else "most are"
    for row, (file, size) in places.items():
        if size != expected:
            odd = f"{file} is {size[0]}x{size[1]} where {whose} {expected[0]}x{expected[1]}"
            unusable[row] = f"frames.csv, row {row}: {odd}: all images of a flight have one size"
    return sizes, unusable, frozen, dark


def _read(named: tuple[int, Path]) -> np.ndarray | ImageError:
    try:
        return read_image(named[1])
    except ImageError as error:
        return error


def facts(flight: Flight) -> list[tuple[str, str]]:
    """What a flight holds, as rows of a name and a text."""
    located, time = flight.located, flight.time
    rows = {
        "flight": flight.name,
        "frames": f"{len(flight)} ({flight.frame[0]} to {flight.frame[-1]})",
        "positions": f"{located.sum()} of {len(flight)}",
    }
    if len(flight) > 1:
        gaps = np.diff(time)
        rate = f"{1 / np.median(gaps):.2f} frames a second, longest gap {gaps.max():.2f} s"
        rows["duration"] = f"{time[-1] - time[0]:.2f} s, {rate}"
    if located.any():
        width, depth = np.ptp(flight.position[located], axis=0)
        (x, y), (x_min, x_max, y_min, y_max) = flight.position.T, flight.area
        rows["flown area"] = f"{width:.2f} m x {depth:.2f} m, x {_span(x)}, y {_span(y)}"
        rows["area"] = f"x {x_min:.2f} to {x_max:.2f}, y {y_min:.2f} to {y_max:.2f} m"
    if flight.height is not None:
        rows["height"] = f"{_span(flight.height)} m"
    if flight.attitude is not None:
        angles = zip(("roll", "pitch", "yaw"), flight.attitude.T, strict=True)
        rows["attitude"] = ", ".join(f"{name} {_span(angle)}" for name, angle in angles) + " rad"
    if flight.histograms is not None:
        rows["histograms"] = "{} of {} ".format(*flight.histograms.shape) + flight.features
    for name, (first, last) in flight.split.items():
        count = int(((flight.frame >= first) & (flight.frame <= last)).sum())
        rows[f"split {name}"] = f"{first} to {last} ({count_of(count, 'frame')})"
    return [*rows.items(), *(("note", note) for note in flight.notes)]


def _span(values: np.ndarray) -> str:
    if not np.isfinite(values).any():
        return "unknown"
    return f"{np.nanmin(values):.2f} to {np.nanmax(values):.2f}"


def repair_flight(
    path: str | os.PathLike[str], out: str | os.PathLike[str], replaced: bool = False
) -> list[str]:
    """Write the flight in the folder `path`, repaired, as the folder `out`; the original is kept.

    Says what was done, with counts, and what was not; raises `FlightError` where a fault of the
    folder is of no kind that is repaired here.
    """
    check_not_read(Path(out), Path(path))
    done: list[str] = []
    reading = load_folder(Path(path), done)
    if reading.flight is None:
        raise FlightError(reading.faults[0])
    flight, (_, unusable, frozen, _) = reading.flight, _images(reading)
    if left_out := {*unusable, *frozen}:
        if len(left_out) == len(flight):
            why = next(iter(unusable.values()), "frames.csv: all are blank")
            raise FlightError(f"{path}/{why}")
        unread, same = "cannot be read or has another size", "is the one before, or blank"
        for rows, why in ((unusable, unread), (frozen, same)):
            if rows:
                named = f"frames.csv, row {ranges(np.array(sorted(rows)))}"
                done.append(f"{count_of(len(rows), 'frame')} left out whose image {why} ({named})")
        flight = flight.select(np.array([row not in left_out for row, _ in reading.image_files]))
    for rounds in range(MOST_ROUNDS + 1):
        doubts = plausibility.warnings(flight)
        doubt = next((each for each in doubts if each.mend), None)
        if doubt is None or doubt.mend is None or rounds == MOST_ROUNDS:
            break
        flight = doubt.mend(flight)
        done.append(doubt.done)
    done += [f"not repaired: {each}" for each in doubts]
    write_flight(replace(flight, notes=(*flight.notes, *done)), out, replaced)
    return done or ["nothing to repair"]
