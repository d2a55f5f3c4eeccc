"""Plausibility checks of a flight that can be read; `warnings` runs all of them, and each gives a
`Doubt` for what is probably not as meant, with what to do about it."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np

from trexton.base.errors import TrextonError
from trexton.flights import motion
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.flights.importers import axes
from trexton.flights.jumps import feature_doubts, jump_doubts
from trexton.flights.tracking import SET_BACK, Doubt, count_of, lost_rows, tracking_doubts
from trexton.vision.camera import wrapped
from trexton.vision.threads import ahead
from trexton.vision.time_offset import read_small, small, time_offset

MAX_MEDIAN_SPEED = 60.0  # metres a second
FAST, MAX_TURN = 15.0, 6.0  # m/s, or heights a second, from where turns of so many m/s^2 are none
PACE, MOVES = 0.5, 0.1  # seconds of a step; share of a fast one from where a vehicle moves
MAX_MEDIAN_INTERVAL, SHORTEST = 30.0, 1e-4  # seconds between frames
USUAL = 0.7, 4.0  # metres a second, and metres from wall to wall
SLOW = 3.0, 0.02  # seconds between frames and metres a second that hardly come together
_SMALLER = (("millimetres", 1e-3), ("centimetres", 1e-2))
_STAMPS = (("nanoseconds", 1e-9, 1e6), ("microseconds", 1e-6, 1e4), ("milliseconds", 1e-3, 0.0))
LONGEST_GAP = 1800.0  # seconds between frames of one flight; clocks may be an hour apart
MIN_EXTENT = 0.05  # metres: less is a hover, or another unit
MAX_HEIGHT_RATIO, FLOOR_RATIO = 5.0, 20.0  # heights, and the floor's picture, by the diagonal
AREA_RATIO = 20.0  # the diagonal, by what the positions span
OFFSET_FRAMES = 400  # frames whose turning is measured
MAX_MEDIAN_TURN, SHORT_INTERVAL = 3.0, 0.5  # radians a second, over up to so many seconds
TURNED, MAX_TILT = 0.5, 0.35  # radians: of yaw, to know axes by; half of a flight is more level


def _scaled(factor: float | np.ndarray, *columns: str) -> Callable[[Flight], Flight]:
    """Multiplies columns, and the area with the positions where it is their own."""

    def mend(flight: Flight) -> Flight:
        changes: dict[str, Any] = {key: factor * np.array(getattr(flight, key)) for key in columns}
        return replace(flight, **changes)

    return mend


def warnings(flight: Flight) -> list[Doubt]:
    """What the checks say, in their order."""
    places = (_outside, tracking_doubts, _speed, _heights, _angles, _view, _motion, _extent)
    others = (jump_doubts, _stamps, _splits, _floor, feature_doubts)
    said = (each for check in (*places, *others) for each in check(flight))
    return [each if isinstance(each, Doubt) else Doubt(each) for each in said]


def _outside(flight: Flight) -> Iterator[str]:
    rows = np.flatnonzero(flight.located)
    place = flight.position[rows]
    low, high = np.reshape(flight.area, (2, 2)).T
    slack = 0.01 * flight.diagonal

    def beyond(place: np.ndarray) -> np.ndarray:
        return np.any((place < low - slack) | (place > high + slack), axis=1)

    out = beyond(place)
    if not out.any():
        return
    first = _first(flight, rows, out)
    found = f"{out.sum()} of {len(rows)} positions lie outside area_m (first: frame {first})"
    if out.mean() > 0.05 and beyond(place[:, ::-1]).sum() < 0.2 * out.sum():
        yield Doubt(
            f"{found}, but inside when x and y are exchanged: exchange the columns, or area_m",
            "x and y exchanged",
            lambda flight: replace(flight, position=flight.position[:, ::-1]),
        )
        return
    for unit, factor in _SMALLER:
        wide = factor * np.ptp(place, axis=0).max() > 0.2 * (high - low).min()
        if out.mean() > 0.5 and wide and beyond(factor * place).mean() < 0.1:
            said = f"{found}, but inside when read as {unit}: write metres"
            yield Doubt(said, f"positions read as {unit}", _scaled(factor, "position"))
            return
    yield f"{found}: correct them, or widen area_m"


def _median_speed(flight: Flight) -> float:
    """Metres a second while the vehicle moves; NaN where too few places are known, or stamps are of
    another unit. A hover adds the noise of its positions, which counts for little over `PACE`.
    """
    flown = flight.located
    for _, rows, sure in lost_rows(flight.time, flight.position):
        flown[rows] &= not sure
    place, time = flight.position[flown], flight.time[flown]
    if len(time) < 3 or (gap := np.median(np.diff(time))) < SHORTEST:
        return np.nan
    every = int(np.clip(PACE / gap, 1, (len(time) - 1) // 2))
    steps = np.hypot(*(place[every:] - place[:-every]).T) / (time[every:] - time[:-every])
    return float(np.median(steps[steps >= MOVES * np.quantile(steps, 0.7)]))


def _speed(flight: Flight) -> Iterator[str]:
    speed = _median_speed(flight)
    extent = np.ptp(flight.position[flight.located], axis=0).max() if speed > 0 else 0.0
    height = MAX_MEDIAN_SPEED if flight.height is None else np.nanmedian(np.abs(flight.height))
    known = flight.origin is not None or speed <= FAST  # metres of GPS are metres
    turning = not known and speed * np.ptp(flight.time) > 2 * extent  # to and fro
    turning &= speed**2 > MAX_TURN * extent / 2 or speed > FAST * height
    if speed > MAX_MEDIAN_SPEED or turning:
        # What leaves about a walk in about a room.
        usual = np.array((speed / USUAL[0], extent / USUAL[1]))
        unit, factor = min(_SMALLER, key=lambda each: np.abs(np.log(usual * each[1])).sum())
        moves = f"the vehicle moves at {speed:.4g} m/s"
        said = f"{moves}: positions in {unit}? write metres and seconds"
        yield Doubt(said, f"positions and area read as {unit}", _scaled(factor, "position", "area"))


def _heights(flight: Flight) -> Iterator[str]:
    if flight.height is None or not (known := np.isfinite(flight.height)).any():
        return
    height, rows = flight.height[known], np.flatnonzero(known)
    usual, below = float(np.median(height)), height < 0
    if not height.any():
        said = f"all {len(rows)} heights are 0: write metres above the floor, or leave z_m out"
        yield Doubt(said, "heights left out, all 0", lambda flight: replace(flight, height=None))
    elif below.mean() > 0.5:
        first = _first(flight, rows, below)
        said = f"{below.sum()} of {len(rows)} heights are negative (first: frame {first})"
        said += ": does z point down? write metres above the floor"
        yield Doubt(said, "heights turned, z pointed down", _scaled(-1.0, "height"))
    elif flight.origin is None and usual > max(MAX_HEIGHT_RATIO * flight.diagonal, 30):
        unit, factor = _SMALLER[usual <= 300]
        likely = usual > min(300, 3 * MAX_HEIGHT_RATIO * flight.diagonal)  # else it may fly so
        yield Doubt(
            f"the camera is {usual:.4g} m high in half of the frames, over an area of "
            f"{flight.diagonal:.3g} m from corner to corner: heights in {unit}? write metres",
            f"heights read as {unit}",
            _scaled(factor, "height") if likely and flight.diagonal > 1 else None,
        )


def _angles(flight: Flight) -> Iterator[str]:
    if flight.attitude is None:
        return
    rows = np.flatnonzero(np.isfinite(flight.attitude[:, 2]))
    angles = np.abs(np.nan_to_num(flight.attitude[rows]))  # the yaw may be known without the tilt
    largest = angles.max(axis=1, initial=0)
    far = largest > axes.MAX_ANGLE
    if far.any():
        # In radians half of a flight is near to level: else roll and pitch are in degrees, too.
        tilted = np.median(angles[:, :2].max(axis=1)) > MAX_TILT
        factors = np.where((tilted, tilted, True), np.pi / 180, 1.0)
        # Some rows may be in radians, none of which is above 3.2; or all in hundredths of degrees.
        sure = far.mean() > 0.7 or (largest[~far] > 3.2).mean() > 0.2
        yaw = flight.attitude[rows, 2]  # counted on through turns it comes from within two
        sure &= np.ptp(yaw) <= axes.MAX_ANGLE or far[0] or bool((np.abs(np.diff(yaw)) > 5).any())
        yield Doubt(
            f"{far.sum()} of {len(rows)} attitudes hold an angle of up to {largest.max():.4g} rad "
            f"(first: frame {_first(flight, rows, far)}): degrees? write radians",
            f"{'angles' if tilted else 'yaw'} read as degrees",
            _scaled(factors, "attitude") if sure and largest.max() <= 720 else None,
        )
        return
    gaps = np.diff(flight.time[rows])
    short = gaps < SHORT_INTERVAL
    rates = np.abs(wrapped(np.diff(flight.attitude[rows, 2])))[short] / gaps[short]
    if len(rates) > 2 and (rate := np.median(rates)) > MAX_MEDIAN_TURN:
        yield f"the yaw turns at {rate:.3g} rad/s in half of the frames: degrees? write radians"


def _view(flight: Flight) -> Iterator[str]:
    """A camera that does not look down in half of the frames."""
    photographs = flight.source.startswith(axes.PHOTOGRAPHS)
    if flight.attitude is None or not (doubt := axes.looks_away(flight.attitude, photographs)):
        return
    # As the import that wrote them took them; else they are taken for what they should be.
    noted = (note.removeprefix(axes.TAKEN) for note in flight.notes if note.startswith(axes.TAKEN))
    taken = axes.AXES.get(next(noted, ""), axes.AXES["rfu"])
    given = axes.quaternions_from_attitude(flight.attitude, taken)
    words, better = next(axes.readings(given), ("", None))
    if better is None or photographs:
        yield doubt
        return
    # Of a vehicle that does not turn, another order of its numbers looks down by chance.
    sure = "order" not in words or np.ptp(np.unwrap(better[np.isfinite(better[:, 2]), 2])) > TURNED
    yield Doubt(
        f"{doubt} ({words} would look down)",
        f"attitudes read as of {words} (where the nose then points aside, import with --axes)",
        (lambda flight: replace(flight, attitude=better)) if sure else None,
    )


def _motion(flight: Flight) -> Iterator[str]:
    """Pictures that move or turn otherwise than the positions and the yaw beside them."""
    yaw = np.full(len(flight), np.nan) if flight.attitude is None else flight.attitude[:, 2]
    moving = motion.followed_rows(flight) if flight.located.any() else np.arange(0)
    rows = np.union1d(moving, np.flatnonzero(np.isfinite(yaw))[:OFFSET_FRAMES])
    try:
        chosen = flight.select(rows)
        files = chosen.frames.files if type(chosen.frames) is ImageFiles else ()
        pictures = list(ahead(read_small, files) if files else map(small, chosen.images()))
    except TrextonError:
        return  # no images, or said already
    if len({each.shape for each in pictures}) > 1:
        return
    seen, part = motion.seen_motion(pictures), np.isin(rows, moving)
    if len(moving) and not any(sure for *_, sure in lost_rows(flight.time, flight.position)):
        doubts = list(motion.motion_doubts(flight, moving, tuple(each[part] for each in seen)))
        # Over tiles one is taken for the next.
        if doubts and np.mean([motion.repeats(each) for each in compress(pictures, part)]) <= 0.5:
            yield from doubts
    turned, time, known = motion.turns(seen), flight.time[rows], np.isfinite(yaw[rows])
    if len(set(yaw[rows][known])) == 1 and np.abs(np.nancumsum(turned)).max() > TURNED:
        yield "the pictures turn, the yaw never changes: was it recorded? leave the attitude out"
    found = time_offset(time, turned, time[known], yaw[rows][known])
    if found is None or not found.sure:
        return
    if found.mirrored:
        said = "the pictures turn against the yaw: counted clockwise, or mirrored? negate it"
        yield Doubt(said, "yaw counted the other way", _scaled(np.array((1, 1, -1)), "attitude"))
    elif found.noticeable:
        late = f"{abs(found.seconds):.2f} s {'after' if found.seconds > 0 else 'before'}"
        yield f"the pictures turn {late} the yaw does: import again, --offset {found.seconds:.2f}"


def _extent(flight: Flight) -> Iterator[str]:
    place = flight.position[flight.located]
    extent = np.ptp(place, axis=0) if len(place) > 1 else np.full(2, np.inf)
    span = f"the {len(place)} positions span {extent[0]:.2g} m x {extent[1]:.2g} m"
    if extent.max() < MIN_EXTENT:
        yield f"{span}: another unit than metres, or a vehicle that stood still"
    elif extent.max() * AREA_RATIO < flight.diagonal:
        yield f"{span}, area_m {flight.diagonal:.3g} m from corner to corner: write both in metres"


def _stamps(flight: Flight) -> Iterator[str]:
    yield from (note for note in flight.notes if SET_BACK in note and "repaired" not in note)
    if len(flight) < 3:
        return
    gaps = np.diff(flight.time)
    gap, after = float(np.median(gaps)), int(gaps.argmax()) + 1
    parted = flight.frame[after] in [first for first, _ in flight.split.values()]
    if gaps.max() > LONGEST_GAP and gap <= MAX_MEDIAN_INTERVAL and not parted:
        yield (
            f"frames {flight.frame[after - 1]} and {flight.frame[after]} lie "
            f"{gaps.max() / 3600:.3g} hours apart: two flights? import each for itself, or with "
            f"--split {after / len(flight):.2g} to train on the first and test on the second"
        )
    if gap > MAX_MEDIAN_INTERVAL:
        unit, factor = next((u, f) for u, f, least in _STAMPS if gap > least)
        said = f"frames come {gap:.4g} s apart: stamps in {unit}? write seconds"
        yield Doubt(said, f"stamps read as {unit}", _scaled(factor, "time"))
    elif gap > SLOW[0] and 0 < (speed := _median_speed(flight)) < SLOW[1]:
        slow = f"frames come {gap:.3g} s apart and the vehicle moves at {speed:.2g} m/s"
        yield f"{slow}: stamps in milliseconds? write seconds"
    elif gap < SHORTEST:
        said = f"frames come {gap:.2g} s apart: stamps in days? write seconds"
        yield Doubt(said, "stamps read as days", _scaled(86400.0, "time"))


def _splits(flight: Flight) -> Iterator[str]:
    if {"train", "test"} <= set(flight.split):
        (first, last), (begin, end) = flight.split["train"], flight.split["test"]
        if (common := min(last, end) - max(first, begin) + 1) > 0:
            found = f"splits train and test share {count_of(common, 'frame')}"
            yield f"{found}, which prove nothing: part them"
    elif "test" in flight.split and len(flight.split) > 1:
        yield "no split is named train beside test: all frames would train, those of the test too"


def _floor(flight: Flight) -> Iterator[str]:
    """A picture of the floor that lies beside the positions, or is placed in another unit."""
    rows = flight.located
    try:
        floor = flight.floor
    except TrextonError:  # a fault of its own
        return
    if floor is None or not rows.any():
        return
    height, width = floor.image.shape[:2]
    corners = floor.corners
    pixel = floor.to_pixels(flight.position[rows])
    on = ((pixel >= -0.5) & (pixel <= (width - 0.5, height - 0.5))).all(axis=1).mean()
    spanned = np.ptp(corners, axis=0)
    if on < 0.5 or spanned.max() > FLOOR_RATIO * max(flight.diagonal, 1e-3):
        yield (
            f"the picture of the floor spans {spanned[0]:.4g} m x {spanned[1]:.4g} m from "
            f"x {corners[:, 0].min():.3g}, y {corners[:, 1].min():.3g}, and {on:.0%} of the "
            "positions lie on it: write world_from_pixel in metres"
        )


def _first(flight: Flight, rows: np.ndarray, chosen: np.ndarray) -> int:
    return int(flight.frame[rows[int(chosen.argmax())]])
