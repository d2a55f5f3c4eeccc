"""Errors are heteroscedastic: some frames deserve a wider covariance. Offers `ErrorScale`, its
scale as a log-linear function of features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["ErrorScale", "independent_after"]

DEGREES = 4.0  # of freedom of the Student distribution: single large errors must not rule
RIDGE = 10.0  # frames' worth of belief that a feature tells nothing
CONFIDENCE = 0.9
CHI2_90 = -2 * np.log(1 - CONFIDENCE)  # of two degrees of freedom
BLENDS = (0.0, 0.5, 1.0)


@dataclass(frozen=True, eq=False)
class ErrorScale:
    """The covariance of an error: a shape that was claimed, and a size that was learned.

    The logarithm of an error's deviation is linear in features; the regions that should hold 90 %
    of the errors hold as much of those it was learned from.

    Attributes
    ----------
    center, width : (F,) arrays
        Of the features as they were learned from; beyond three widths they count as that far.
    weights : (F + 1,) array
        Of the features, and a constant.
    blend : float
        How much of the claimed shape is believed, 0 to 1; the rest is round.
    """

    center: np.ndarray
    width: np.ndarray
    weights: np.ndarray
    blend: float

    @classmethod
    def fit(cls, features: np.ndarray, errors: np.ndarray, claimed: np.ndarray) -> ErrorScale:
        """From ``(N, F)`` features, ``(N, 2)`` errors and ``(N, 2, 2)`` claimed covariances."""
        center, width = features.mean(axis=0), features.std(axis=0) + 1e-6
        best: tuple[float, ErrorScale] | None = None
        for blend in BLENDS:
            shapes = _shapes(claimed, blend)
            squared = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(shapes), errors)
            weights = _regress(_design(features, center, width), squared)
            fitted = cls(center, width, weights, blend)
            ratio = squared / fitted.deviation(features) ** 2
            fit = float(
                (2 * np.log(fitted.deviation(features))).mean()
                + (DEGREES / 2 + 1) * np.log1p(ratio / DEGREES).mean()
            )
            if best is None or fit < best[0]:
                size = 0.5 * np.log(max(np.quantile(ratio, CONFIDENCE), 1e-12) / CHI2_90)
                best = fit, cls(center, width, weights + np.r_[np.zeros(len(center)), size], blend)
        assert best is not None
        return best[1]

    def deviation(self, features: np.ndarray) -> np.ndarray:
        """``(...)`` metres for ``(..., F)`` features."""
        return np.exp(_design(features, self.center, self.width) @ self.weights)

    def covariance(self, features: np.ndarray, claimed: np.ndarray) -> np.ndarray:
        """``(..., 2, 2)`` square metres."""
        size = self.deviation(features)[..., None, None] ** 2
        return size * _shapes(claimed, self.blend)

    def to_array(self) -> np.ndarray:
        """All numbers in a row."""
        return np.concatenate([self.center, self.width, self.weights, [self.blend]])

    @classmethod
    def from_array(cls, array: np.ndarray) -> ErrorScale:
        """The scale that `to_array` wrote.

        Raises
        ------
        ValueError
            It did not.
        """
        count, odd = divmod(array.size - 2, 3)
        if array.ndim != 1 or odd or count < 1 or not np.isfinite(array).all():
            raise ValueError(f"an error scale has 3 F + 2 finite numbers, found {array.shape}")
        center, width, weights, blend = np.split(array, [count, 2 * count, 3 * count + 1])
        return cls(center, width, weights, float(blend[0]))


def _design(features: np.ndarray, center: np.ndarray, width: np.ndarray) -> np.ndarray:
    standard = np.clip((features - center) / width, -3, 3)
    return np.concatenate([standard, np.ones((*standard.shape[:-1], 1))], axis=-1)


def _shapes(claimed: np.ndarray, blend: float) -> np.ndarray:
    """Claimed covariances as shapes of determinant one, blended with a circle."""
    size = np.sqrt(np.maximum(np.linalg.det(claimed), 1e-24))[..., None, None]
    shape = blend * claimed / size + (1 - blend) * np.eye(2)
    return shape / np.sqrt(np.linalg.det(shape))[..., None, None]


def _regress(design: np.ndarray, squared: np.ndarray) -> np.ndarray:
    """``(F + 1,)`` weights of the log deviation of Student errors, by Fisher scoring."""
    weights = np.zeros(design.shape[1])
    weights[-1] = 0.5 * np.log(np.median(squared) / 2 + 1e-12)
    ridge = np.full(len(weights), RIDGE)
    ridge[-1] = 1e-9
    information = 4 * DEGREES / (DEGREES + 4) * (design.T @ design) + np.diag(ridge)
    for _ in range(50):
        ratio = squared * np.exp(-2 * (design @ weights))
        slope = 2 - (DEGREES + 2) * ratio / (DEGREES + ratio)
        penalty = ridge * weights
        penalty[-1] = 0
        step = np.linalg.solve(information, design.T @ slope + penalty)
        weights = weights - step
        if np.abs(step).max() < 1e-9:
            break
    return weights


def independent_after(white: np.ndarray, runs: np.ndarray, most: int = 200) -> float:
    """Frames after which an error is as good as new: 1 + 2 sum of the autocorrelations.

    Parameters
    ----------
    white : (N, 2) array
        Errors over their deviations.
    runs : (N,) array
        Frames that follow each other share a number.

    Notes
    -----
    The sum ends with the first correlation below 0.05 (initial positive sequence; Geyer 1992).
    """
    total, variance = 1.0, float(np.square(white).mean()) + 1e-12
    for lag in range(1, min(most, len(white) - 1)):
        same = runs[lag:] == runs[:-lag]
        if same.sum() < 20:
            break
        correlation = float((white[lag:] * white[:-lag])[same].mean()) / variance
        if correlation < 0.05:
            break
        total += 2 * correlation
    return total
