"""A belief over the cells of a floor moves as the view moved. Offers `CellBelief`, which weighs it
by how well a frame fits, and `ViewMotion`: how the middle of the view moves, by fixes and odometry.
"""

import cv2
import numpy as np

from trexton.vision.camera import wrapped

_ANYWHERE = 0.003  # of all belief is spread evenly at each step: no place is ruled out for good
_NEGLIGIBLE = 1e-5  # of the largest belief: a cell below is not searched
_ABOUT = 0.3  # radians: headings so near are one
_SHARP = 0.4  # cells: how well a place is known once a frame was aligned there
SURE = 0.15  # certainty of the odometry from which it is believed
_PLAIN = 0.5  # from which it is taken against the motion before; prints that repeat reach less
_JUMP = 2.0  # cells a frame by which a motion may differ from the one before
KNOWN, _ROUGH, _UNKNOWN = 0.4, 0.5, 2.0  # cells: what a step adds to the belief's width
_STRAYS = 0.6  # cells a frame: the error of going on as before
PATIENCE = 12  # frames after which the last pose, or velocity, is forgotten
_MEMORY = 10.0  # frames over which it is taken how far the view moves
Window = tuple[slice, slice]


class CellBelief:
    """Probability of each cell, for each heading that is still possible (a point-mass filter).

    Parameters
    ----------
    allowed : (rows, columns) bool array
        Cells on which the centre of a frame can lie.
    """

    def __init__(self, allowed: np.ndarray):
        self.allowed = allowed.astype(np.float32)
        self._even = self.allowed / self.allowed.sum()
        self.headings = np.zeros(1)
        self.mass = self._even[None].copy()

    def reset(self, headings: np.ndarray, kept: float = 0.0) -> None:
        """Anywhere under any of these headings (radians), but for a share `kept` as it was."""
        before, self.headings = self.mass.sum(axis=0), np.array(headings, dtype=float)
        even = self._even
        if kept > 0:
            even = (1 - kept) * even + kept / float(before.sum()) * before
        self.mass = np.repeat(even[None] / len(headings), len(headings), axis=0)

    def expect(self, place: np.ndarray, radius: int, heading: float) -> None:
        """Half of the belief goes to within `radius` cells of a place, and to about a heading."""
        near = abs(wrapped(self.headings - heading)) < _ABOUT
        box = (near | ~near.any(), *self._box(place, radius)[1:])
        self.mass /= 2
        self.mass[box] += self.allowed[box[1:]] / (2 * max(1, self.mass[box].size))

    def move(self, cells: np.ndarray, sigma: float) -> None:
        """Shift by ``(K, 2)`` (columns, rows), one row a heading, and widen by `sigma` cells."""
        for index, (right, down) in enumerate(cells):
            shift = np.array([[1, 0, right], [0, 1, down]], dtype=float)
            moved = cv2.warpAffine(self.mass[index], shift, self.mass.shape[:0:-1])
            self.mass[index] = cv2.GaussianBlur(moved, (0, 0), max(sigma, 0.3)) * self.allowed
        self.normalize()
        self.mass *= 1 - _ANYWHERE
        self.mass += (_ANYWHERE / len(self.mass)) * self._even

    def support(self, margin: int) -> Window:
        """The smallest window that holds what is not negligible, with `margin` cells around."""
        peak = self.mass.max(axis=0)
        least = max(_NEGLIGIBLE * float(peak.max()), 3 * _ANYWHERE * float(self._even.max()))

        def spanned(profile: np.ndarray) -> slice:
            above = np.flatnonzero(profile > least)
            first, last = (above[0], above[-1]) if len(above) else (0, len(profile))
            return slice(max(0, int(first) - margin), min(len(profile), int(last) + margin + 1))

        return spanned(peak.max(axis=1)), spanned(peak.max(axis=0))

    def weigh(self, log_likelihood: np.ndarray, window: Window) -> None:
        """Multiply by ``(K, rows, columns)`` likelihoods in `window`; nothing remains outside."""
        inside = self.mass[(slice(None), *window)] * np.exp(log_likelihood - log_likelihood.max())
        self.mass[:] = 0
        self.mass[(slice(None), *window)] = inside
        self.normalize()

    def drop_headings(self, share: float = 1e-4) -> None:
        """Forget headings that hold less than `share` of the belief."""
        held = self.mass.sum(axis=(1, 2))
        keep = held > share * held.sum()
        self.headings, self.mass = self.headings[keep], self.mass[keep]

    def modes(self, count: int, radius: int, share: float) -> list[tuple[int, int, int, float]]:
        """Up to `count` peaks (heading, row, column, belief around), over `radius` cells apart.

        Only those that hold at least `share` of the belief, and the first whatever it holds.
        """
        left = self.mass.sum(axis=0)
        modes: list[tuple[int, int, int, float]] = []
        for _ in range(count):
            row, column = np.unravel_index(int(np.argmax(left)), left.shape)
            box = self._box(np.array([column, row]), radius)
            held = float(left[box[1:]].sum())
            if modes and held < share:
                break
            heading = int(np.argmax(self.mass[box].sum(axis=(1, 2))))
            modes.append((heading, int(row), int(column), held))
            left[box[1:]] = 0
        return modes

    def around(self, place: np.ndarray, radius: int) -> float:
        """The belief within `radius` cells of a place (column, row)."""
        return float(self.mass[self._box(place, radius)].sum())

    def scale(self, place: np.ndarray, radius: int, factor: float) -> None:
        """Multiply what lies within `radius` cells of a place (column, row)."""
        self.mass[self._box(place, radius)] *= factor

    def sharpen(self, place: np.ndarray, peak: np.ndarray, radius: int) -> None:
        """Gather what lies within `radius` cells of `peak` about `place`, now known to a cell."""
        held = self.mass[self._box(peak, radius)].sum(axis=(1, 2))
        self.mass[self._box(peak, radius)] = 0
        box = self._box(place, radius)
        rows, columns = (np.arange(each.start, each.stop) for each in box[1:])
        squared = (columns - place[0]) ** 2 + (rows[:, None] - place[1]) ** 2
        near = np.exp(-squared / (2 * _SHARP**2)) * self.allowed[box[1:]]
        total = float(near.sum())
        if total > 0:
            self.mass[box] += (held / total)[:, None, None] * near.astype(np.float32)

    def _box(self, place: np.ndarray, radius: int) -> tuple[slice, slice, slice]:
        column, row = (int(round(float(each))) for each in place)
        height, width = self.allowed.shape
        top, left = min(max(0, row - radius), height), min(max(0, column - radius), width)
        bottom, right = max(top, row + radius + 1), max(left, column + radius + 1)
        return slice(None), slice(top, min(bottom, height)), slice(left, min(right, width))

    def normalize(self) -> None:
        if (total := float(self.mass.sum())) > 0:
            self.mass /= total
        else:
            self.reset(self.headings)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean ``(2,)`` and covariance ``(2, 2)`` in cells (column, row)."""
        mass = self.mass.sum(axis=0, dtype=np.float64)
        rows, columns = np.indices(mass.shape)
        places = np.stack([columns.ravel(), rows.ravel()])
        mean = places @ mass.ravel() / mass.sum()
        deviation = places - mean[:, None]
        return mean, (deviation * mass.ravel()) @ deviation.T / mass.sum()


class ViewMotion:
    """The floor point in the image centre, and how fast it moves. Where fixes and odometry
    contradict each other, the belief is widened, so that the floor says which is right.

    Parameters
    ----------
    cell : float, metres
    longest : float
        Cells: a longer motion from frame to frame is a jump.

    Attributes
    ----------
    aimed : (2,) array
        That point in the last frame that was found, metres.
    velocity : (2,) array or None
        Cells a frame (column, row), where it is known.
    """

    def __init__(self, cell: float, longest: float):
        self.cell, self.longest = cell, longest
        self.aimed = self._before = np.zeros(2)
        self.velocity: np.ndarray | None = None
        self._fresh = 0  # frames for which the velocity still counts
        self._reach = 0.0  # cells: how far it moves from frame to frame

    def predicted(
        self, shift: np.ndarray, last: np.ndarray | None, sure: float, steps: int
    ) -> tuple[np.ndarray, float]:
        """``(K, 2)`` cells by which the view moved, one row a heading, and their deviation.

        By odometry, which is so `sure`, these were `shift` ``(K, 2)``, and under the heading of the
        last pose, where that is known, `last` ``(2,)``; `steps` frames ago one came.
        """
        self._fresh -= steps
        if self._fresh < 0:
            self.velocity = None
        if self.velocity is not None and last is not None:
            going = steps * self.velocity
            jump = float(np.hypot(*(last - going)))
            if sure < (_PLAIN if jump > _JUMP else SURE):
                return np.tile(going, (len(shift), 1)), _ROUGH * steps**1.5
            # Where one of the two is wrong, the floor says which.
            return shift, jump if jump > _JUMP else KNOWN
        if sure < SURE:
            return np.zeros_like(shift), max(_UNKNOWN, self._reach) * steps
        return shift, KNOWN

    def aim(self, place: np.ndarray) -> None:
        """A frame was found to show this point, metres, in its middle."""
        self._before, self.aimed = self.aimed, place

    def learn(self, frames: int) -> None:
        """Take the velocity from the last two points, so many frames apart."""
        moved = (self.aimed - self._before) / frames
        cells = moved / self.cell * (1, -1)
        length = float(np.hypot(*cells))
        self.velocity = cells if length < self.longest / 4 else None
        self._fresh = PATIENCE
        self._reach += (min(length, self.longest) - self._reach) / _MEMORY

    def ahead(self, frames: int) -> tuple[np.ndarray, float]:
        """``(2,)`` metres that the view moves in so many frames; cells a frame it may be off."""
        if self.velocity is None:
            return np.zeros(2), max(_UNKNOWN, self._reach)
        return frames * self.cell * self.velocity * (1, -1), _STRAYS
