"""The evidence of a frame for how the floor looks: the field's likelihood of its histogram, as each
of several states of the appearance corrects it.
"""

from __future__ import annotations

import numpy as np

from trexton.field.field import Field
from trexton.field.likelihood import TileTables
from trexton.localization.estimate import Estimate
from trexton.localization.texton_map import TextonMap
from trexton.vision.correction import corrected_patches
from trexton.vision.histograms import patch_histogram
from trexton.vision.images import sample_positions

__all__ = ["FrameEvidence"]

LOCAL_SHARE = 0.5  # of the evidence that is sought near the last estimate
LOCAL_SIGMA = 0.15  # metres that are added to its deviation


class FrameEvidence:
    """Of frames over a map, each by so many patches that are drawn from it."""

    def __init__(self, texton_map: TextonMap, patches: int, rng: np.random.Generator):
        self._map, self._patches, self._rng = texton_map, patches, rng
        self._field: Field = texton_map.parts["measurement"]
        self._prior: np.ndarray = self._field.prior

    def near(self, estimate: Estimate | None) -> None:
        """Expect the next frame near an estimate; None: anywhere."""
        self._prior = self._field.prior
        if estimate is not None:
            offset = self._field.centers - estimate.position
            precision = np.linalg.inv(estimate.covariance + LOCAL_SIGMA**2 * np.eye(2))
            density = np.exp(-0.5 * np.einsum("ni,ij,nj->n", offset, precision, offset))
            share = density / max(float(density.mean()), 1e-300)
            self._prior = self._prior + np.log(LOCAL_SHARE * share + 1 - LOCAL_SHARE)

    def __call__(
        self, frame: np.ndarray, states: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """``(S,)`` log evidence of the frame as each of the ``(S, 5)`` states corrects it, with the
        tiles' brightnesses `levels` ``(C,)``, and the normalized residual of the tiles ``(S, C)``
        at the likeliest place.
        """
        by_tile, tables, deviations = self._likelihoods(frame, states, levels)
        log_posterior = by_tile.sum(axis=0) + self._prior
        squared = tables.squared_residuals(deviations, log_posterior.argmax(axis=1))
        residuals = squared / float(self._field.residual_scale)
        peak = log_posterior.max(axis=1)
        total = np.exp(log_posterior - peak[:, None]).sum(axis=1)
        return peak + np.log(total), residuals.T

    def best_of_tiles(
        self, frame: np.ndarray, states: np.ndarray, penalties: np.ndarray
    ) -> np.ndarray:
        """``(C,)``: which of the ``(S, 5)`` states each tile supports, given ``(C, S)`` penalties,
        at the place that all together support.
        """
        by_tile, _, _ = self._likelihoods(frame, states, np.zeros(len(penalties)))
        by_tile = by_tile - penalties[..., None]
        place = (by_tile.max(axis=1).sum(axis=0) + self._prior).argmax()
        best: np.ndarray = by_tile[..., place].argmax(axis=1)
        return best

    def _likelihoods(
        self, frame: np.ndarray, states: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, TileTables, np.ndarray]:
        """``(C, S, M)`` log likelihoods of the tiles as each state corrects them, the tables of
        which they are, and the features ``(S, d)``.
        """
        dictionary, parts = self._map.alphabet, self._map.cells
        count = self._patches
        positions = sample_positions(frame.shape, dictionary.patch, count, self._rng)
        patches = (
            corrected_patches(frame, positions, dictionary.patch, state, levels) for state in states
        )
        histograms = np.stack(
            [patch_histogram(each, positions, frame.shape, dictionary, parts) for each in patches]
        )
        tables, deviations = self._field.tables(count), self._field.deviations(histograms)
        return tables.log_likelihoods(deviations), tables, deviations
