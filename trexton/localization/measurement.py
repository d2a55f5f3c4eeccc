"""A measurement model says how likely an observation is at each place. Offers the paper's mixture
over nearest neighbours, and covariances by rank."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.defaults import NEIGHBORS
from trexton.base.errors import ParameterError
from trexton.base.options import option
from trexton.localization.base import Part, learned
from trexton.localization.motion import whitener
from trexton.localization.neighbors import Distance
from trexton.localization.observation import Observation
from trexton.localization.training_set import EXCLUDED_SECONDS, Training

_FLOOR_VARIANCE = 1e-4  # square metres: keeps a covariance of identical deviations invertible


class MeasurementModel(Part):
    """Base of all measurement models; those that look at no neighbours need no distance."""

    needs = {"distance": Distance}

    def prepare_frame(self, observation: Observation) -> None:
        """Compute of the observation what `log_likelihood` needs, before the filter moves on."""

    def log_likelihood(self, places: np.ndarray, observation: Observation) -> np.ndarray:
        """``(M,)`` log likelihood of the observation at ``(M, 2)`` places in metres."""
        raise NotImplementedError


@dataclass(eq=False)
class RankMixture(MeasurementModel):
    """Sum over neighbour ranks j of N(z_j; x, Sigma_j) (Alg. 2 of the paper).

    Attributes
    ----------
    covariances : (k, 2, 2) array
        Learned, best rank first, square metres.
    """

    neighbors: int = option(NEIGHBORS, "k, how many ranks", low=1)
    sigma: float | None = option(
        None, "standard deviation in metres of all ranks; learned unless given", above=0
    )
    excluded_s: float = option(
        EXCLUDED_SECONDS, "frames this near in time are no neighbours while it learns", low=0
    )
    covariances: np.ndarray = learned()

    def fit(self, training: Training) -> Self:
        if self.sigma is not None:
            same = np.eye(2) * self.sigma**2
            return self.with_learned(covariances=np.broadcast_to(same, (self.neighbors, 2, 2)))
        rows = training.neighbors(self.neighbors, self.excluded_s)
        return self.with_learned(covariances=rank_covariances(training.positions, rows))

    def prepare(self) -> None:
        if self.covariances.shape != (self.neighbors, 2, 2):
            raise ParameterError(
                f"rank covariances have shape {self.covariances.shape}: "
                f"expected ({self.neighbors}, 2, 2), one for each neighbour"
            )
        ranks = enumerate(self.covariances, 1)
        self._whiten = np.stack([whitener(each, f"rank {j}") for j, each in ranks])
        # Whitens for all ranks at once: first what is x of all, then y.
        self._rows = np.concatenate((self._whiten[:, 0], self._whiten[:, 1]))
        self._log_norm = (np.log(np.abs(np.linalg.det(self._whiten))) - np.log(2 * np.pi))[:, None]

    @property
    def deviations(self) -> np.ndarray:
        """``(k, 2)`` standard deviations of the ranks along the axes, metres."""
        return np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2))

    def prepare_frame(self, observation: Observation) -> None:
        observation.neighbors  # noqa: B018  drawn before the filter draws

    def log_likelihood(self, places: np.ndarray, observation: Observation) -> np.ndarray:
        return self.mixture(places, observation.neighbors.position)

    def mixture(self, places: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """``(M,)`` log density, at each place, of the neighbours' ``(k, 2)`` positions."""
        if positions.shape != (self.neighbors, 2):
            raise ParameterError(
                f"the measurement has shape {positions.shape}: "
                f"expected ({self.neighbors}, 2), one position for each rank"
            )
        deviation = self._rows.dot(places.T)
        deviation -= np.matmul(self._whiten, positions[..., None]).T.reshape(-1, 1)
        deviation *= deviation
        exponent = deviation[: self.neighbors]  # (k, M)
        exponent += deviation[self.neighbors :]
        exponent *= -0.5
        exponent += self._log_norm
        peak = np.maximum.reduce(exponent)
        exponent -= peak
        np.exp(exponent, out=exponent)
        density: np.ndarray = np.add.reduce(exponent)
        np.log(density, out=density)
        density += peak
        return density


def rank_covariances(positions: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """``(k, 2, 2)`` square metres: Sigma^[j] = Var(T - P_j) of neighbour rank j (Filtering)."""
    ranks = (positions[:, None, :] - positions[rows]).transpose(1, 0, 2)
    return np.stack([np.cov(rank.T) + _FLOOR_VARIANCE * np.eye(2) for rank in ranks])
