"""The likelihood of features over the cells of a floor, and where a vehicle is expected before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Basis", "Table", "bumps", "relative"]

DEGREES = 6.0  # of freedom of the Student distribution
UNFLOWN = 0.1  # share of the prior that does not expect the vehicle where it was in training


@dataclass(frozen=True, eq=False)
class Basis:
    """Axes of the features in which noise is white and the signal's covariance diagonal.

    Attributes
    ----------
    whiten : (d, d) array
        Features times this are in the basis.
    strength : (d,) array
        Variances of the signal along the axes, of the noise 1.
    """

    whiten: np.ndarray
    strength: np.ndarray

    @classmethod
    def of(cls, signal: np.ndarray, noise: np.ndarray, samples: int | None) -> Basis:
        counted = 0.0 if samples is None else 0.25 / samples  # variance of the root of a frequency
        lengths, axes = np.linalg.eigh(noise + counted * np.eye(len(noise)))
        white = axes / np.sqrt(np.maximum(lengths, lengths[-1] * 1e-9 + 1e-12))
        strength, turn = np.linalg.eigh(white.T @ (signal[:, None] * white))
        return cls(white @ turn, np.maximum(strength, 0))


@dataclass(frozen=True, eq=False)
class Table:
    """The field's likelihood at every cell, arranged so that a frame costs one product.

    In the basis the squared distance at a cell is the sum over features of (y - m)^2 / (1 + v s),
    which is linear in y^2 and y.
    """

    weights: np.ndarray
    constant: np.ndarray
    log_norm: np.ndarray

    @classmethod
    def of(cls, mean: np.ndarray, variance: np.ndarray, strength: np.ndarray) -> Table:
        total = 1 + variance[:, None] * strength
        weights = np.hstack([1 / total, -2 * mean / total]).astype(np.float32)
        constant = (np.square(mean) / total).sum(axis=1)
        return cls(weights, constant, -0.5 * np.log(total).sum(axis=1))

    def misfit(self, found: np.ndarray, cells: np.ndarray | int) -> np.ndarray:
        """Squared deviations a feature from which `log_likelihood` made `found` at `cells`."""
        d = self.weights.shape[1] // 2
        squared = np.expm1((self.log_norm[cells] - found) / (0.5 * (DEGREES + d)))
        result: np.ndarray = DEGREES / d * squared
        return result

    def log_likelihood(self, features: np.ndarray) -> np.ndarray:
        """``(M,)`` for features ``(d,)``, or ``(n, M)`` for ``(n, d)``, up to a constant."""
        both = np.concatenate([features * features, features], axis=-1).astype(np.float32)
        squared = np.maximum(both @ self.weights.T + self.constant, 0)
        half = 0.5 * (DEGREES + features.shape[-1])
        found: np.ndarray = self.log_norm - half * np.log1p(squared / DEGREES)
        return found


def bumps(centers: np.ndarray, places: np.ndarray, length: float) -> np.ndarray:
    """``(M, N)`` Gaussian bumps around the places, a third of the length wide."""
    squared = np.square(centers).sum(axis=1)[:, None] + np.square(places).sum(axis=1)
    bumps: np.ndarray = np.exp(-4.5 / length**2 * (squared - 2 * centers @ places.T))
    return bumps


def relative(density: np.ndarray) -> np.ndarray:
    """``(M,)`` log of a density over the uniform one, part of which is mixed in; 0 where there is
    none anywhere.
    """
    mean = density.mean()
    if mean == 0:
        return np.zeros_like(density)
    relative: np.ndarray = np.log((1 - UNFLOWN) * density / mean + UNFLOWN)
    return relative
