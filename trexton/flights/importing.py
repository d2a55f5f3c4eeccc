"""From a recording to a Flight folder: positions matched, images brought to one size.

`import_flight` writes it whole or not at all; `preview_import` tells what it would take for what.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.files import atomic_folder, check_not_read, check_replaceable, clean_leftovers
from trexton.base.options import Options, option
from trexton.flights.check import facts
from trexton.flights.flight import Flight, area_around
from trexton.flights.folder import load_folder, read_flight
from trexton.flights.frames import ImageFiles
from trexton.flights.header import FARTHEST
from trexton.flights.importers import guess_kind, importer
from trexton.flights.importers.axes import TAKEN
from trexton.flights.importers.images import of_one_size, rectification_of, write_images
from trexton.flights.importers.recording import NANO, PoseTrack, Recording, match
from trexton.flights.tracking import SET_BACK, count_of, lost_rows
from trexton.flights.writing import write_tables
from trexton.vision.camera import Rectification
from trexton.vision.images import natural_order


@dataclass(frozen=True)
class Common(Options):
    """What can be chosen whatever the source."""

    tolerance: float = option(0.1, "seconds between a frame and a position", low=0)
    offset: float = option(0.0, "seconds to add to the stamps of the positions")
    scale: float = option(1.0, "size of the images written, as a share", low=0.01, high=1)
    undistort: str = option("", "calibration to undistort by: file of OpenCV, EuRoC or Kalibr")
    crop: str = option("", "part of the images to keep, x,y,width,height in pixels")
    split: float = option(0.0, "share of frames that train, others test (0: none)", low=0, high=1)
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
    check_replaceable(out, replaced)
    kind = kind or guess_kind(source)
    recording, flight, done, _ = _planned(source, kind, settings or {}, out.name)
    read = recording.frames.files if isinstance(recording.frames, ImageFiles) else ()
    beside = source.resolve() in out.resolve().parents  # a flight may lie in its source's folder
    check_not_read(out, *read, *(() if beside else (source,)))
    with atomic_folder(out, replaced) as work:
        if recording.frames is not None and done is not None:
            (work / "images").mkdir()
            frames = write_images(recording.frames, done, work / "images")
            flight = replace(flight, frames=frames)
            recording.said.append(f"{len(frames)} images of {done.size[0]}x{done.size[1]}")
        write_tables(flight, work)
        if faults := load_folder(work).faults:  # what cannot be read replaces nothing
            raise FlightError(faults[0].replace(str(work), str(out)))
    return read_flight(out), recording.said


def _planned(
    source: Path, kind: str, settings: Mapping[str, object], name: str
) -> tuple[Recording, Flight, Rectification | None, dict[str, object]]:
    """What an import will write, but its images: what cannot be right is found before they are
    written, which may take long. Also what is done to them, and all options as they are taken.
    """
    module = importer(kind)
    given = dict(settings)
    names = {each.name for each in Common.declared()}
    # A video has an offset of its own, which may be estimated.
    names -= {each.name for each in module.Settings.declared()}
    common = Common.parse({key: given.pop(key) for key in list(given) if key in names})
    chosen = module.Settings.parse(given, f"import {kind}")
    recording = of_one_size(_ordered(module.read(source, chosen)))
    split = _split(common.split, len(recording.time_ns))
    clocks = [each for each in recording.said if "--offset" in each]
    if common.offset:  # it is as given
        kept = [each for each in recording.said if each not in clocks]
        recording, clocks = replace(recording, said=kept), []
    try:
        placed, words = _placed(recording, common)
    except FlightError as error:
        raise FlightError("; ".join([str(error), *clocks])) from None
    if recording.track is not None and "offset" in names and not common.offset:
        words.append("stamps of frames and positions taken as of one clock")
    done = None
    if (frames := recording.frames) is not None:
        words += _order_of_text([*getattr(frames, "files", ())])
        done = rectification_of(frames, common.undistort, common.crop, common.scale)
    flight = _flight(recording, placed, done, common.name or name or source.stem)
    recording = replace(recording, said=recording.said + words)
    return recording, replace(flight, split=split), done, {**chosen.as_dict(), **common.as_dict()}


def preview_import(
    source: str | os.PathLike[str],
    *,
    kind: str | None = None,
    settings: Mapping[str, object] | None = None,
) -> list[tuple[str, str]]:
    """What an import would take for what, as rows of a name and a text; nothing is written. Raises
    as `import_flight`.
    """
    given, known = settings or {}, kind or guess_kind(Path(source))
    recording, flight, done, options = _planned(Path(source), known, given, "")
    rows = [("kind", f"{known} ({'as given' if kind else 'guessed'})")]
    rows += [
        (name.replace("_", "-"), f"{value} ({'as given' if name in given else 'default'})")
        for name, value in options.items()
        if value not in ("", None)
    ]
    if (track := recording.track) is not None:
        begin, end = (track.time_ns[[0, -1]] - recording.time_ns[0]) / NANO
        count = len(track.time_ns)
        rows.append(("clock", f"{count} positions from {begin:.3f} to {end:.3f} s of the frames'"))
    rows += facts(flight)
    if done is not None:
        rows.append(("images", "x".join(map(str, done.size)) + " pixels"))
    return rows + [("note", line) for line in recording.said]


def _ordered(recording: Recording) -> Recording:
    """The recording with its frames in time order, frames of one stamp dropped."""
    stamps = recording.time_ns
    if not len(stamps):
        raise FlightError("the source has no frames: check its path and topics")
    order = np.unique(stamps, return_index=True)[1]
    if np.array_equal(order, np.arange(len(stamps))):
        return recording
    dropped = len(stamps) - len(order)
    said = f"frames put in order of their stamps, {dropped} of repeated stamps dropped"
    return recording.rows(order, said)


def _placed(recording: Recording, common: Common) -> tuple[PoseTrack, list[str]]:
    """Positions and attitudes of the frames, and what matching them gave."""
    stamps = recording.time_ns
    if recording.track is None:
        return PoseTrack(stamps, np.full((len(stamps), 3), np.nan)), ["no positions in the source"]
    farthest = np.nanmax(np.abs(recording.track.position), initial=0)
    if farthest > FARTHEST:
        far = f"a position is {farthest:g} m from the origin: no such place on Earth"
        raise FlightError(f"{recording.source}: {far}, correct it or name its unit")
    track, held = _between_fixes(recording.track.shifted(common.offset))
    track, lost = _without_lost(stamps, track)
    placed, gap_s = match(stamps, track, common.tolerance)
    count = np.isfinite(placed.position[:, 0]).sum()
    found = f"{count} of {len(stamps)} frames have a position"
    said = [*held, *lost, f"{found}, largest gap between positions used {gap_s:.3f} s"]
    step = float(np.median(np.diff(track.time_ns, prepend=track.time_ns[0]))) / NANO
    if count < len(stamps) / 2 and step > 2 * common.tolerance:
        apart = f"positions come {step:.3g} s apart"
        said.append(f"{apart}: give --tolerance {step / 2:.2g}, or --time-unit")
    return placed, said


def _between_fixes(track: PoseTrack) -> tuple[PoseTrack, list[str]]:
    """The track on its way from fix to fix, where rows repeat the last, as subtitles do of a slow
    receiver. Longer stops stay; nothing is known after the last fix.
    """
    place, time = track.position[:, :2], track.time_ns / NANO
    fixes = np.flatnonzero((np.diff(place, axis=0, prepend=np.nan) != 0).any(axis=1))
    held = np.diff(fixes)
    usual = int(np.median(held)) if len(held) > 10 else 1
    if usual < 2 or (np.abs(held - usual) > 1 + usual / 10).mean() > 0.1:
        return track, []
    known = np.union1d(fixes, fixes[1:][held > 1.5 * usual] - usual)  # where it goes on from a stop
    way = [np.interp(time, time[known], each, right=np.nan) for each in place[known].T]
    said = f"positions are new every {usual} rows and repeat between: taken on the way instead"
    return replace(track, position=np.column_stack([*way, track.position[:, 2]])), [said]


def _without_lost(stamps: np.ndarray, track: PoseTrack) -> tuple[PoseTrack, list[str]]:
    """The track without the rows where it was lost, which would be mixed into frames between; a
    frame that lies on one has its place, for the check to name.
    """
    pose = [track.position] + ([] if track.attitude is None else [track.attitude])
    kept, said = np.ones(len(track.time_ns), dtype=bool), []
    for how, rows, sure in lost_rows(track.time_ns / NANO, np.hstack(pose)):
        rows = rows[~np.isin(track.time_ns[rows], stamps)]
        if sure and len(rows):
            kept[rows] = False
            first = (track.time_ns[rows[0]] - stamps[0]) / NANO
            lost = f"{count_of(len(rows), 'position')} {how}, the first at {first:.2f} s"
            said.append(f"{lost}: tracking was lost there, left out")
    return track.rows(kept), said


def _order_of_text(files: list[Path]) -> list[str]:
    """A sentence where they come as text, 1, 10, 2, by names that hold one number each."""
    counted = sorted(files, key=natural_order)
    numbered = all(re.fullmatch(r"\D*\d+\D*", file.stem) for file in files)
    if not numbered or files == counted or files != sorted(files):
        return []
    early, late = next(pair for pair in zip(files, counted, strict=True) if len({*pair}) > 1)
    order = f"images come in the order of names as text, {early.name} before {late.name}"
    return [f"{order}: are they those of their rows? pair them by their numbers"]


def _split(share: float, count: int) -> dict[str, tuple[int, int]]:
    """First and last frame of both parts; none where no share was asked for."""
    if share == 0:
        return {}
    trained = round(share * count)
    if not 0 < trained < count:
        raise ParameterError(f"split {share:g} of {count} frames leaves a part none: give another")
    return {"train": (0, trained - 1), "test": (trained, count - 1)}


def _flight(recording: Recording, pose: PoseTrack, done: Rectification | None, name: str) -> Flight:
    place, height = pose.position[:, :2], pose.position[:, 2]
    located = np.isfinite(place).all(axis=1).any()
    first = int(recording.time_ns[0])
    names = tuple(re.sub(r'[\s;"]+', " ", name).strip() for name in recording.names)
    if len({*names, "frame"}) <= len(names):
        raise FlightError(
            f"{recording.source}: two features are called alike, or one 'frame', among "
            f"{', '.join(names)}: rename them, or choose some with --names"
        )
    counted = names == tuple(f"t{column}" for column in range(len(names)))  # as without names
    noted = [line for line in recording.said if line.startswith(TAKEN) or SET_BACK in line]
    return Flight(
        name=name,
        frame=np.arange(len(place)),
        time=(recording.time_ns - first) / NANO,
        position=place,
        area=area_around(place if located else np.array([[0.0, 0], [1, 1]]), 0.02, 0.01),
        height=height if np.isfinite(height).any() else None,
        attitude=pose.attitude,
        histograms=recording.histograms,
        features=recording.features,
        feature_names=() if counted else names,
        rectification=done if done and done.changes else None,
        camera=done.camera(recording.camera) if done else recording.camera,
        origin=None if recording.track is None else recording.track.origin,
        source=recording.source,
        notes=(f"time zero is stamp {first} ns of the source", *noted),
    )
