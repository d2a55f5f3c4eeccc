"""A frame as it would look under another light, from another heading and height, and how far a
frame moved since the one before.

A state has `STATES` numbers: log gains of brightness, warmth and tint, the heading in radians, the
log of the height, each relative to what is wanted.
"""

from math import isqrt

import cv2
import numpy as np

from trexton.vision.images import gather_patches, position_grid
from trexton.vision.visual_odometry import followed

HEADING, HEIGHT, STATES = 3, 4, 5  # in a state, after the gains; and how many numbers it has
# Log gains of blue, green and red by brightness, warmth and tint.
GAINS = np.array([[1.0, -1.0, -0.5], [1.0, 0.0, 1.0], [1.0, 1.0, -0.5]])
CHROMA_OFFSET = np.array([0, 128, 128], np.float32)
WIDTH = 160  # pixels of the small frames between which points are followed
POINTS, MIN_SHARE = 60, 0.5  # of a frame; of those that must agree


_UNIT = cv2.cvtColor(np.eye(3, dtype=np.float32)[None], cv2.COLOR_BGR2YUV)[0]
_YUV = np.asarray(_UNIT.T - [[0.0], [0.5], [0.5]], dtype=float)
_BGR = np.linalg.inv(_YUV)


def affine(shape: tuple[int, ...], state: np.ndarray) -> np.ndarray:
    """``(2, 3)``: pixels (x, y) of the frame from those it would have as surveyed."""
    cosine, sine = np.cos(state[HEADING]), np.sin(state[HEADING])
    turn = np.exp(-state[HEIGHT]) * np.array([[cosine, -sine], [sine, cosine]])
    middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
    return np.column_stack([turn, middle - turn @ middle])


def _recolored(pixels: np.ndarray, state: np.ndarray, level: float = 0.0) -> np.ndarray:
    """``(..., 3) uint8`` pixels without the light of a state, in a tile that much brighter."""
    light = state[:HEADING] + [level, 0, 0]
    if not light.any():
        return pixels
    # Takes the light's gains out of Y, U - 128, V - 128.
    matrix = ((_YUV * np.exp(-GAINS @ light)) @ _BGR).astype(np.float32)
    offset = CHROMA_OFFSET - matrix @ CHROMA_OFFSET
    flat = cv2.transform(pixels.reshape(-1, 1, 3), np.column_stack([matrix, offset]))
    return flat.reshape(pixels.shape)


def corrected_patches(
    frame: np.ndarray, positions: np.ndarray, patch: int, state: np.ndarray, levels: np.ndarray
) -> np.ndarray:
    """``(N, P, P, 3) uint8`` patches at ``(N, 2)`` positions of the frame as it would look as
    surveyed; what lies outside is mirrored at its border. The brightness of the tiles is given by
    `levels` ``(C,)``, see `AppearanceFilter`.
    """
    if not state[HEADING:].any():
        taken = gather_patches(frame, positions, patch)
    else:
        inside = np.indices((patch, patch)).reshape(2, -1).T
        pixels = (positions[:, None] + inside)[..., ::-1].reshape(-1, 2)
        matrix = affine(frame.shape, state)
        where = (pixels @ matrix[:, :2].T + matrix[:, 2]).astype(np.float32)
        x, y = (np.ascontiguousarray(each).reshape(len(positions), -1) for each in where.T)
        taken = cv2.remap(frame, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        taken = taken.reshape(len(positions), patch, patch, 3)
    if not levels.any():
        return _recolored(taken, state)
    side = isqrt(len(levels))
    row, column = (positions * side // position_grid(frame.shape, patch)).T
    result = np.empty_like(taken)
    for tile, level in enumerate(levels):
        own = row * side + column == tile
        result[own] = _recolored(taken[own], state, level)
    return result


def corrected_frame(frame: np.ndarray, state: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """``(H, W, 3) uint8``: the frame as it would look as surveyed; see `corrected_patches`."""
    if state[HEADING:].any():
        frame = cv2.warpAffine(
            frame, affine(frame.shape, state), frame.shape[1::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT,
        )  # fmt: skip
    if not levels.any():
        return _recolored(frame, state)
    side = isqrt(len(levels))
    rows = [
        np.hstack([_recolored(np.ascontiguousarray(part), state, level)
                   for part, level in zip(np.array_split(band, side, axis=1), own, strict=True)])
        for band, own in zip(np.array_split(frame, side), levels.reshape(side, side), strict=True)
    ]  # fmt: skip
    return np.vstack(rows)


class FrameMotion:
    """How each frame moved since the one before, by points that are followed."""

    def __init__(self) -> None:
        self._last: np.ndarray | None = None
        self._expected: np.ndarray | None = None  # in pixels, as last seen

    def step(self, frame: np.ndarray) -> np.ndarray | None:
        """``(4,)``: radians and log of the height, which add to those of a state, and how far what
        the middle shows moved to the right and down, as shares of the frame's sides; None where the
        frames do not show it.
        """
        scale = min(1.0, WIDTH / frame.shape[1])
        size = round(frame.shape[1] * scale), round(frame.shape[0] * scale)
        small = cv2.resize(np.ascontiguousarray(frame[..., 0]), size, interpolation=cv2.INTER_AREA)
        last, self._last = self._last, small
        motion = None if last is None else followed(last, small, POINTS, self._expected)
        if motion is None or motion[1] < MIN_SHARE:
            return None
        matrix = self._expected = motion[0]
        moved, middle = complex(matrix[0, 0], matrix[1, 0]), (np.array(size) - 1) / 2
        shift = (matrix[:, :2] @ middle + matrix[:, 2] - middle) / size
        return np.array([np.angle(moved), -np.log(abs(moved)), *shift])
