"""Pictures of the floor move as the camera does. `seen_motion` follows them, and `motion_doubts`
names positions that go another way or at another time, and yaws and heights of another kind.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise

import cv2
import numpy as np

from trexton.flights.flight import Flight
from trexton.vision.visual_odometry import STILL, followed

CORNERS = 120  # that are followed from frame to frame
MOST, AGREE = 200, 0.5  # frames that are followed; share of points that agree, and scale, at least
RUN, FAR = 30, 0.4  # frames, and widths of the picture, over which tilts count for little
KNOWN, ALIKE, NEAR = 0.4, 0.85, 10  # share of places; correlation of tiles; pixels of the same one
FITS, SURELY, APART = 0.05, 0.01, 0.5  # shares of the variance of places that pictures leave
BETTER, ASIDE, RATIO = 5.0, 0.45, 1.7  # times less of it; radians; ratio of heights: more is said
LAGS, STEP, LATE = 30.0, 0.1, 0.35  # seconds between clocks: tried, to the next, more is said
UNLIKE = "the pictures do not move as the positions do: {}? import again"


def followed_rows(flight: Flight) -> np.ndarray:
    """``(N,)`` rows in sequence, up to `MOST`, over which the vehicle moves most."""
    moved = np.nan_to_num(np.hypot(*np.diff(flight.position, axis=0, append=np.nan).T))
    first = np.convolve(moved, np.ones(min(MOST, len(moved))), "valid").argmax()
    return np.arange(len(moved))[first : first + MOST]


def seen_motion(frames: Iterable[np.ndarray]) -> tuple[np.ndarray, ...]:
    """``(N,)`` each of ``(N, H, W) uint8`` luma frames: numbers that change where two in sequence
    have little in common; complex, where their middle is, to the right and ahead in the first, in
    its widths; complex views, turned anticlockwise, as large as the width.
    """
    piece, way, view = 0, 0j, 1 + 0j
    rows = [(piece, way, view)]
    for before, frame in pairwise(frames):
        matrix, agreed = followed(before, frame, CORNERS) or (STILL, 0.0)
        if agreed < AGREE or np.hypot(*matrix[:, 0]) < AGREE:
            matrix, piece = STILL, piece + 1
        scale, shift = matrix[0, ::2] + 1j * matrix[1, ::2]
        middle = complex(frame.shape[1] - 1, frame.shape[0] - 1) / 2
        way += view * np.conj((middle - shift) / scale - middle) / frame.shape[1]
        view /= np.conj(scale)
        rows.append((piece, way, view))
    return tuple(map(np.array, zip(*rows, strict=True)))


def turns(seen: tuple[np.ndarray, ...]) -> np.ndarray:
    """``(N,)`` radians, anticlockwise, by which the camera turned before each frame of a
    `seen_motion`; NaN for the first, and where two have little in common."""
    piece, _, view = seen
    turned = np.angle(view[1:] / view[:-1])
    return np.append(np.nan, np.where(np.diff(piece) == 0, turned, np.nan))


def repeats(frame: np.ndarray) -> bool:
    """Whether the middle of a luma frame is elsewhere in it too, as a tile is."""
    top, left = frame.shape[0] // 3, frame.shape[1] // 3
    middle = frame[top : 2 * top + 1, left : 2 * left + 1]
    like = cv2.matchTemplate(frame, middle, cv2.TM_CCOEFF_NORMED)
    like[max(0, top - NEAR) : top + NEAR + 1, max(0, left - NEAR) : left + NEAR + 1] = 0
    return bool(like.max() > ALIKE)


def motion_doubts(flight: Flight, rows: np.ndarray, seen: tuple[np.ndarray, ...]) -> Iterator[str]:
    """What the `seen_motion` of rows of a flight contradicts of its positions, yaws and heights."""
    piece, way, view = seen
    run = (piece == np.bincount(piece).argmax()) & flight.located[rows]
    way, view, rows = way[run], view[run], rows[run]
    if len(rows) < RUN or way.std() < FAR * abs(view[0]):
        return  # too little
    place = flight.position @ (1, 1j)

    def at(late: float) -> np.ndarray:
        return np.interp(flight.time[rows] + late, flight.time, place, np.nan, np.nan)

    def fit(to: np.ndarray) -> tuple[float, complex]:
        """The share of the variance of places that the way turned and scaled leaves, and these."""
        known = np.isfinite(to)
        if known.mean() < KNOWN:
            return np.inf, 1 + 0j
        to, gone = to[known] - to[known].mean(), way[known] - way[known].mean()
        common, moved = np.vdot(gone, to), max(np.vdot(gone, gone).real, 1e-12)
        return 1 - abs(common) ** 2 / moved / max(np.vdot(to, to).real, 1e-12), common / moved

    (share, scale), (mirrored, _) = fit(place[rows]), fit(place[rows].conj())
    good, most = min(FITS, share / BETTER), min(LAGS, np.ptp(flight.time) / 4)
    late = min(STEP * np.arange(-most // STEP, most // STEP), key=lambda each: fit(at(each))[0])
    now = np.where(np.isfinite(at(late)), place[rows], np.nan)  # of the rows that are compared then
    if abs(late) > LATE and fit(at(late))[0] < min(SURELY, good, fit(now)[0] / BETTER, mirrored):
        yield UNLIKE.format(f"is one clock ahead of the other, --offset {-late:.1f}")
    elif share > FITS and mirrored < good:
        yield UNLIKE.format("is x exchanged with y, or one of them counted the other way")
    elif share > APART and flight.origin is None:
        yield UNLIKE.format("are they of another flight, order or clock")
    if share > FITS:
        return
    if flight.attitude is not None:
        aside = scale * view / np.abs(scale * view) * np.exp(-1j * flight.attitude[rows, 2])
        angle = np.angle(np.nansum(aside))
        if abs(angle) > ASIDE and abs(np.nansum(aside)) > 0.9 * len(rows):
            turn = f"{10 * round(np.degrees(angle) / 10)} degrees anticlockwise of the yaw"
            why = "is it counted from x" + ", x exchanged with y" * bool(mirrored < 2 * FITS)
            yield f"the pictures move {turn}: {why}, or the camera mounted turned? import again"
    if flight.height is not None and flight.camera is not None:
        high = np.median(np.abs(scale * view)) * flight.camera.focal / flight.camera.width
        height = np.median(flight.height[rows])  # NaN, of which nothing is said, if one is
        if high > RATIO * height > 0 or RATIO * high < height:
            words = f"the pictures move as if taken {high:.1f} m above the floor, not {height:.1f}"
            yield f"{words}: heights in another unit, or a focal length of another size?"
