"""From a recording to a Flight folder: positions matched, images brought to one size.

`import_flight` writes it whole; an import that was interrupted goes on.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError, ParameterError, TrextonError
from trexton.base.files import (
    check_not_read,
    check_replaceable,
    clean_leftovers,
    digest,
    naming,
    replace_folder,
)
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.flights.flight import Flight
from trexton.flights.folder import load_folder, read_flight
from trexton.flights.frames import ImageFiles, select_frames
from trexton.flights.header import FARTHEST
from trexton.flights.importers import guess_kind, importer
from trexton.flights.importers.images import Change, write_images
from trexton.flights.importers.recording import NANO, PoseTrack, Recording, match
from trexton.flights.writing import write_tables
from trexton.vision.camera import Camera

__all__ = ["Common", "import_flight"]


@dataclass(frozen=True)
class Common(Options):
    """What can be chosen whatever the source."""

    tolerance: float = option(0.1, "seconds between a frame and a position", low=0)
    offset: float = option(0.0, "seconds to add to the stamps of the positions")
    scale: float = option(1.0, "size of the images written, as a share", low=0.01, high=1)
    undistort: str = option("", "calibration to undistort by: a file of OpenCV or EuRoC, or own")
    mask: str = option("", "picture that is black where the vehicle itself is seen")
    split: float = option(
        0.0, "share of the frames for training, the rest for test; 0: no splits", low=0, high=1
    )
    name: str = option("", "name of the flight (default: of the folder written)")


def import_flight(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    kind: str | None = None,
    settings: dict[str, object] | None = None,
    replaced: bool = False,
) -> tuple[Flight, list[str]]:
    """Import a recording as a Flight folder.

    An import that was interrupted leaves its images in a hidden folder beside `out`; the same
    import goes on from there.

    Parameters
    ----------
    source, out : path
    kind : str, optional
        An entry of `IMPORTERS`; guessed unless given.
    settings : dict, optional
        Of `Common` and of the importer, as values or text.
    replaced : bool
        A Flight folder at `out` may be replaced.

    Returns
    -------
    flight : Flight
    said : list of str
        What was matched, and what to know.

    Raises
    ------
    TrextonError
        The source is not of this kind, no frame has a position, or images do not fit together.
    """
    source, out = Path(source), Path(out)
    clean_leftovers(out)
    check_replaceable(out, replaced, ours=False)
    kind = kind or guess_kind(source)
    module = importer(kind)
    given = dict(settings or {})
    names = {each.name for each in Common.declared()}
    # A video has an offset of its own, which may be estimated.
    names -= {each.name for each in module.Settings.declared()}
    common = Common.parse({key: given.pop(key) for key in list(given) if key in names})
    chosen = module.Settings.parse(given, f"import {kind}")
    recording = module.read(source, chosen)
    recording, said = _ordered(recording)
    read = recording.frames.files if isinstance(recording.frames, ImageFiles) else ()
    read += (source,) if source.is_file() else ()
    beside = source.resolve() in out.resolve().parents  # a flight may lie in its source's folder
    check_not_read(out, *read, *(() if beside else (source,)))
    work = out.parent / f".{out.name}.importing"
    # What cannot be right is found before images are written, which may take long.
    split = _split(common.split, len(recording.time_ns))
    placed, words = _placed(recording, common)
    if recording.track is not None and "offset" in names:
        words.append(
            f"{common.offset:g} s added to the stamps of the positions, as given"
            if common.offset
            else "stamps of frames and positions taken as of one clock"
        )
    change = None
    if recording.frames is not None:
        change = Change.of(
            recording, source, undistort=common.undistort, mask=common.mask, scale=common.scale
        )
    states = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in read]
    key = digest(
        kind, str(source.resolve()), chosen.as_dict(), common.as_dict(), recording.time_ns, states,
        *([] if change is None else [change.rectification.table()]),
    )  # fmt: skip
    with naming(out):
        try:
            _prepare(work, key)
            camera, frames = recording.camera, None
            if change is not None:
                frames, camera, written = write_images(recording, change, work / "images")
                said += written
            flight = _flight(recording, split, placed, camera, frames, common.name or out.name)
            if change is not None and change.rectification.changes:
                flight = replace(flight, rectification=change.rectification)
            write_tables(flight, work)
            if faults := load_folder(work).faults:  # what cannot be read replaces nothing
                raise FlightError(faults[0])
        except TrextonError as error:  # and is no use to go on with
            shutil.rmtree(work, ignore_errors=True)
            raise type(error)(str(error).replace(str(work), str(out))) from None
        (work / "key").unlink()
        replace_folder(work, out)
    return read_flight(out), recording.said + said + words


def _prepare(work: Path, key: str) -> None:
    """The folder of an import that goes on, or an empty one."""
    stamp = work / "key"
    if not (stamp.is_file() and stamp.read_text(encoding="utf-8") == key):
        shutil.rmtree(work, ignore_errors=True)
        (work / "images").mkdir(parents=True)
        stamp.write_text(key, encoding="utf-8")
    else:
        (work / "images").mkdir(exist_ok=True)
        if there := len(list((work / "images").iterdir())):
            say(f"going on with {there} images that are there already")


def _ordered(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with its frames in time order, frames of one stamp dropped."""
    stamps = recording.time_ns
    if not len(stamps):
        raise FlightError("the source has no frames: check its path and topics")
    order = np.argsort(stamps, kind="stable")
    order = order[np.diff(stamps[order], prepend=stamps[order[0]] - 1) > 0]
    if np.array_equal(order, np.arange(len(stamps))):
        return recording, []
    dropped = len(stamps) - len(order)
    return replace(
        recording,
        time_ns=stamps[order],
        frames=None if recording.frames is None else select_frames(recording.frames, order),
        histograms=None if recording.histograms is None else recording.histograms[order],
    ), [f"frames put in order of their stamps, {dropped} of repeated stamps dropped"]


def _placed(recording: Recording, common: Common) -> tuple[PoseTrack, list[str]]:
    """Positions and attitudes of the frames, and what matching them gave."""
    stamps = recording.time_ns
    if recording.track is None:
        return PoseTrack(stamps, np.full((len(stamps), 3), np.nan)), ["no positions in the source"]
    track = recording.track.located()
    farthest = np.nanmax(np.abs(track.position))
    if farthest > FARTHEST:
        raise FlightError(
            f"a position is {farthest:g} m from the origin: no such place on Earth, correct it or "
            "name its unit"
        )
    placed, gap_s = match(stamps, track.shifted(common.offset), common.tolerance)
    count = np.isfinite(placed.position[:, 0]).sum()
    return placed, [
        f"{count} of {len(stamps)} frames have a position, "
        f"largest gap between positions used {gap_s:.3f} s"
    ]


def _split(share: float, count: int) -> dict[str, tuple[int, int]]:
    """First and last frame of both parts; none where no share was asked for."""
    if share == 0:
        return {}
    trained = round(share * count)
    if not 0 < trained < count:
        part = "training" if trained == 0 else "test"
        raise ParameterError(
            f"split is {share:g}, which leaves none of {count} frames for {part}: choose another "
            "share, or none, and test on another flight"
        )
    return {"train": (0, trained - 1), "test": (trained, count - 1)}


def _flight(
    recording: Recording,
    split: dict[str, tuple[int, int]],
    placed: PoseTrack,
    camera: Camera | None,
    frames: ImageFiles | None,
    name: str,
) -> Flight:
    count = len(recording.time_ns)
    position = placed.position
    height = position[:, 2] if np.isfinite(position[:, 2]).any() else None
    places = position[np.isfinite(position[:, :2]).all(axis=1), :2]
    low, high = (
        (places.min(axis=0), places.max(axis=0)) if len(places) else (np.zeros(2), np.ones(2))
    )
    margin = 0.02 * (high - low) + 0.01
    (x_min, y_min), (x_max, y_max) = low - margin, high + margin
    first = int(recording.time_ns[0])
    return Flight(
        name=name,
        frame=np.arange(count),
        time=(recording.time_ns - first) / NANO,
        position=position[:, :2],
        area=(float(x_min), float(x_max), float(y_min), float(y_max)),
        height=height,
        attitude=placed.attitude,
        frames=frames,
        histograms=recording.histograms,
        features=recording.features,
        camera=camera,
        split=split,
        origin=None if recording.track is None else recording.track.origin,
        source=recording.source,
        licence=recording.licence,
        notes=(f"time zero is stamp {first} ns of the source", *recording.notes),
    )
