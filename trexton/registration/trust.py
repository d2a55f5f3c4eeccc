"""How far a frame's fit can be trusted. Offers `Trust`: what is assumed, and how it is learned from
a flight."""

from dataclasses import dataclass, replace

import numpy as np

from trexton.base.errors import MapError

PHOTOGRAPHS_S = 0.5  # from frame to frame: so far apart, none follows from the one before
_REGION, _QUANTILE = 0.9, 4.605  # the region that must hold, and its chi-squared bound in the plane
_RIGHT = 0.25  # of the height: a fix further off is a wrong place and says nothing about precision
_YAW_SIGMA = 0.006  # radians: a rolling shutter under way shears the frame, which turns it
# Frames that were located: of 9 errors the largest holds 9 of 10 times; of many, their quantile.
_FEWEST, _MANY = 9, 30
_SCALES = np.geomspace(0.25, 400, 40)
_FLOORS = np.concatenate([[0.0], np.geomspace(1e-7, 1e-2, 30)])  # of the height, squared


@dataclass(frozen=True)
class Trust:
    """How much a frame's fit says: how many independent pixels a correlation of the `coarse` and of
    the `fine` images is worth, and below which fine correlation a frame is not where it seems to be
    (`least`). Variances are the alignment's times `scale` plus `floor` square metres.
    """

    coarse: float = 8.0
    fine: float = 15.0
    least: float = 0.4
    scale: float = 2.0
    floor: float = 4e-6

    def gain(self, correlation: np.ndarray, pixels: np.ndarray | float) -> np.ndarray:
        """Log likelihood of a frame that correlates so, against one that does not at all.

        The noise is Gaussian, the image's gain, offset and noise have their most likely values, and
        `pixels` is the number of independent ones.
        """
        squared = np.square(np.clip(correlation, 0, 0.995))
        return np.asarray(-0.5 * pixels * np.log1p(-squared))

    def covariance(self, aligned: np.ndarray) -> np.ndarray:
        """``(2, 2)`` of an alignment's position, from its ``(6, 6)`` covariance."""
        return np.asarray(self.scale * aligned[:2, :2] + self.floor * np.eye(2))

    def heading_sigma(self, aligned: np.ndarray, height: float) -> float:
        """Standard deviation in radians of the yaw of an alignment at such a height, in metres."""
        return float(np.sqrt(self.scale * aligned[5, 5] + self.floor / height**2 + _YAW_SIGMA**2))


@dataclass(frozen=True, eq=False)
class FloorFix:
    """What one frame gives. Its `pose` ``(6,)`` is x, y, z in metres, roll, pitch, yaw in radians;
    with it go the ``(2, 2)`` covariance of x and y, and the correlation with the floor as `score`.

    It is `lost` where the pose must not be trusted, and not `observed` where no frame came. The
    `heading_sigma` in radians is NaN where no frame shows the yaw by itself.
    """

    pose: np.ndarray
    covariance: np.ndarray
    score: float
    lost: bool
    observed: bool
    heading_sigma: float = np.nan

    @property
    def position(self) -> np.ndarray:
        """``(2,)`` x, y in metres."""
        return self.pose[:2]


def learn_trust(fixes: list[FloorFix], truth: np.ndarray, height: float, trust: Trust) -> Trust:
    """The trust under which the 90 % regions of a flight's fixes hold 90 % of its true positions.

    Scale and floor are the most likely ones of Gaussian errors, then scaled to hold the region.

    Parameters
    ----------
    fixes : list of FloorFix
        Made with the scale and floor of `trust`.
    truth : (N, 2) array
    height : float
        Usual height in metres.

    Raises
    ------
    MapError
        Too few frames were located.
    """
    error = np.array([fix.position for fix in fixes]) - truth
    right = np.array([not fix.lost for fix in fixes]) & (np.hypot(*error.T) < _RIGHT * height)
    if right.sum() < _FEWEST:
        advice = "check the map image, the camera and the positions"
        if len(fixes) < _MANY:  # of which a few are not found, however good they are
            advice = "train with more frames, or with another method"
        raise MapError(
            f"{right.sum()} of {len(fixes)} training frames were found on the map image, "
            f"{_FEWEST} are needed to learn how far to trust it: {advice}"
        )
    given = np.array([fix.covariance for fix in fixes])[right] - trust.floor * np.eye(2)
    raw, error = given / trust.scale, error[right]
    floors = _FLOORS * height**2
    total = _SCALES[:, None, None, None, None] * raw + floors[:, None, None, None] * np.eye(2)
    cost = (np.log(_determinant(total)) + _distance(total, error)).mean(axis=-1)
    row, column = np.unravel_index(int(np.argmin(cost)), cost.shape)
    count = len(error)
    level = _REGION if count >= _MANY else np.ceil(_REGION * (count + 1)) / count
    held = np.quantile(_distance(total[row, column], error), level) / _QUANTILE
    scores = np.array([fix.score for fix in fixes])[right]
    return replace(
        trust,
        scale=float(_SCALES[row] * held),
        floor=float(floors[column] * held),
        least=float(0.6 * np.quantile(scores, 0.01)),
    )


def _determinant(matrices: np.ndarray) -> np.ndarray:
    return np.asarray(matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] ** 2)


def _distance(matrices: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Squared Mahalanobis distances of ``(N, 2)`` errors under ``(..., N, 2, 2)`` covariances."""
    x, y = error.T
    a, b, c = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    return np.asarray((c * x**2 - 2 * b * x * y + a * y**2) / _determinant(matrices))
