"""Measurement by a field: at which places a histogram would be observed, and how certain the field
is there.

The residual of a frame at a place follows a Student distribution, so that one odd feature rules out
no place for good.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import option
from trexton.field.features import Features, is_counted
from trexton.field.likelihood import (
    ErrorModel,
    TileTables,
    better_half,
    bilinear,
    error_terms,
    grid_cells,
    log_prior,
    posterior_mean,
    rbf_kernel,
    tile_bases,
)
from trexton.localization.base import learned
from trexton.localization.estimate import Estimate, ignorance
from trexton.localization.measurement import MeasurementModel
from trexton.localization.observation import Observation
from trexton.localization.texton_map import TextonMap
from trexton.localization.training_set import Training
from trexton.vision.correction import corrected_patches
from trexton.vision.histograms import patch_histogram
from trexton.vision.images import sample_positions

MAX_TABLE = 600_000  # cells times features: what a frame may cost, of time and cache
MIN_VARIANCE = 1e-3  # share of the signal: no place is taken to be known better
MEAN_DISTANCE = 1.28  # of two places drawn from a square, over that of one's deviation
MOST_TABLES = 8  # by the number of samples, that are kept
LOCAL_SHARE = 0.5  # of a frame's evidence that is sought near the last estimate
LOCAL_SIGMA = 0.15  # metres that are added to its deviation
MAX_DEVIATION = 1e6  # standard deviations of a feature: beyond, squares would overflow


@dataclass(eq=False)
class Field(MeasurementModel):
    """The likelihood of a histogram over the whole floor, from processes of the training flight."""

    needs = {}
    cells: int = option(
        4800,
        "squares of the floor, about; fewer where there are many features",
        low=16,
        high=1_000_000,
    )
    axes: np.ndarray = learned()  # (K, d) of `Features`, and
    signed: np.ndarray = learned()  # () whether they are those of values
    center: np.ndarray = learned()  # (d,) their means
    signal: np.ndarray = learned()  # (d,) their variances over the floor
    noise: np.ndarray = learned()  # (d, d) their covariance from frame to frame
    process: np.ndarray = learned()  # (N, 2 + d / C) metres and weights of what makes the mean
    length: np.ndarray = learned()  # () metres, of its kernel
    variance: np.ndarray = learned()  # (M,) its variance there, as a share of the signal
    prior: np.ndarray = learned()  # (M,) log density of the training flight over the cells
    area: np.ndarray = learned()  # (4,)
    errors: np.ndarray = learned()  # (3,) an ErrorModel
    training_variance: np.ndarray = learned()  # () the field's where its errors were learned
    revisit_inflation: np.ndarray = learned()  # () see `correlated_inflation`
    residual_scale: np.ndarray = learned()  # () see `normalized_residual`
    offsets: np.ndarray = learned()  # (C, 2) metres to the footprints of the `Tiles`
    error_coefficients: np.ndarray = learned()  # (3,) metres, see `predicted_error`

    def fit(self, training: Training) -> Self:
        """Learn field, noise and errors.

        Raises
        ------
        MapError
            All histograms are alike, or all places.
        """
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, user_api="blas"):  # sums are rounded alike on any machine
            return self._fit(training)

    def _fit(self, training: Training) -> Self:
        # What learning alone needs; the flight that follows does without SciPy.
        from trexton.field.cross_validation import cross_validate, select_features
        from trexton.field.process import Process, merge_places
        from trexton.field.tiles import Tiles

        parts, histograms = training.cells**2, training.histograms
        counted = is_counted(histograms, parts)
        candidates = Features.candidates(histograms, parts)
        if not candidates[0].axes.shape[1]:
            raise MapError("all training histograms are alike: fly over a floor with some pattern")
        # Far from where x and y are zero distances would be rounded: that moves by kilometres.
        origin = training.positions.mean(axis=0).round(-3)
        places = training.positions - origin
        x_min, x_max, y_min, y_max = (np.array(training.area) - origin.repeat(2)).tolist()
        area = x_min, x_max, y_min, y_max
        if not np.ptp(places, axis=0).any():
            raise MapError("all training positions are one place: fly over the floor")
        taken = select_features(candidates, histograms, places, training.time, area)
        features = np.asfortranarray(taken(histograms))  # for sums of columns
        centers, _ = grid_cells(area, min(self.cells, max(16, MAX_TABLE // features.shape[1])))
        if self.offsets is not None and len(self.offsets) in (1, parts):
            tiles = Tiles(self.offsets)  # of a field of the same camera
        else:
            by_tile, flight = features.reshape(len(features), parts, -1), training.flight
            shape = flight.image(0).shape if flight is not None and flight.has_images else None
            ratio = None if shape is None else shape[0] / shape[1]
            tiles = Tiles.of(places, by_tile, training.time, ratio)
        parts = len(tiles.offsets)
        values = features.reshape(len(features) * parts, -1)
        middle = values.mean(axis=0)
        values = values - middle
        centred = values.reshape(len(features), -1)
        chosen, judged, _ = cross_validate(places, centred, training.time, area, tiles, counted)
        merged, values, counts = merge_places(tiles.places(places), values)
        process = Process(merged, values, chosen.length, counts, noise=chosen.noise)
        variance = tiles.variance(process, centers, area)
        flown, _, counts = merge_places(places, places)
        prior = log_prior(rbf_kernel(centers, flown, process.length) @ counts, counted)
        return self.with_learned(
            axes=taken.axes,
            signed=np.array(taken.signed),
            center=np.tile(middle, parts),
            process=np.hstack([merged + origin, process.weights]),
            length=np.array(process.length),
            variance=variance,
            prior=prior,
            area=np.array(training.area, dtype=float),
            offsets=tiles.offsets,
            **judged,
        )

    def untrained(self) -> Self:
        """As `Part.untrained`; the footprints of the same camera need no second search."""
        part = super().untrained()
        part.offsets = self.offsets
        return part

    @property
    def width(self) -> int:
        return len(self.axes)

    def prepare(self) -> None:
        """Raise `MapError` for arrays that are not finite, or do not fit each other or the grid."""
        d, count = len(self.center), len(self.variance)
        shapes: dict[str, tuple[int, ...]] = {
            "axes": (len(self.axes), d), "center": (d,), "signal": (d,), "noise": (d, d),
            "process": (len(self.process), 2 + d // max(1, len(self.offsets))),
            "variance": (count,), "prior": (count,), "area": (4,),
            "errors": (3,), "error_coefficients": (3,), "offsets": (len(self.offsets), 2),
        }  # fmt: skip
        for name, array in self.arrays().items():
            if array.shape != shapes.get(name, ()):  # all others are numbers
                raise MapError(f"the field's {name} has shape {array.shape}: train the map again")
            if not np.isfinite(array).all():
                raise MapError(f"the field's {name} is not finite: fly over more of the floor")
        wanted = min(self.cells, max(16, MAX_TABLE // d))
        self.centers, self.shape = grid_cells(tuple(self.area.tolist()), wanted)
        if len(self.centers) != count:
            raise MapError(f"a field of {count} cells fits no grid: train the map again")
        places, weights = np.split(self.process, [2], axis=1)
        origin, length = places.mean(axis=0).round(-3), float(self.length)
        known = places - origin, weights, length
        cells = [self.centers - origin + offset for offset in self.offsets]
        # (M, d) the field at the cells, less the centre
        self.mean = np.hstack([posterior_mean(each, *known) for each in cells]).astype(np.float32)
        self.features = Features(self.axes, bool(self.signed))
        self._tables: dict[int | None, TileTables] = {}
        self.error_model = ErrorModel(*self.errors.tolist())  # of single frames
        x_min, x_max, y_min, y_max = self.area
        self.cell = float(np.sqrt((x_max - x_min) * (y_max - y_min) / len(self.centers)))  # metres

    def prepare_frame(self, observation: Observation) -> None:
        observation.histogram  # noqa: B018  drawn before the filter draws

    def log_posterior(self, observation: Observation) -> np.ndarray:
        """``(M,)`` log of likelihood times prior at the centres of the cells, less a constant."""
        deviations = self.deviations(observation.histogram)
        by_tile = self.tables(observation.samples).log_likelihoods(deviations)
        return np.sum(by_tile, axis=0) + self.prior

    def deviations(self, histograms: np.ndarray) -> np.ndarray:
        """``(..., d)`` features of histograms ``(..., K)``, less the centre."""
        limit = MAX_DEVIATION * np.sqrt(self.signal)
        return np.clip(self.features(histograms) - self.center, -limit, limit)

    def tables(self, samples: int | None) -> TileTables:
        """Likelihoods of the tiles where so many samples were counted; None: all patches."""
        if samples not in self._tables:
            if len(self._tables) >= MOST_TABLES:
                self._tables.clear()
            parts = len(self.offsets)
            bases = tile_bases(self.signal, self.noise, parts, samples)
            means = np.split(self.mean, parts, axis=1)
            self._tables[samples] = TileTables(means, self.variance, bases)
        return self._tables[samples]

    def normalized_residual(self, observation: Observation, log_posterior: np.ndarray) -> float:
        """Squared residual of the frame at its best cell, over that of familiar frames: below 1 for
        nineteen of twenty frames of the survey that were left out.
        """
        deviations, cell = self.deviations(observation.histogram), log_posterior.argmax()
        tables = self.tables(observation.samples)
        squared = better_half(tables.squared_residuals(deviations[None], np.array([cell])))
        familiar = tables.familiar_residual(float(self.residual_scale))
        return float(squared[0] / max(familiar, MIN_VARIANCE))

    def log_likelihood(self, places: np.ndarray, observation: Observation) -> np.ndarray:
        return bilinear(self.log_posterior(observation).reshape(self.shape), self.area, places)

    def correlated_inflation(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` factors, at least one, on the variance of correlated errors at `places`.

        Between the passes of a survey the field's variance is larger than where the errors were
        learned; where a survey repeats its passes, that was nearer to it than a later flight is.
        """
        between = self.variance_at(places) / max(float(self.training_variance), MIN_VARIANCE)
        return float(self.revisit_inflation) * np.maximum(1.0, between)

    def predicted_error(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` mean error in metres of a single frame at ``(M, 2)`` places.

        No less than the white error, and no more than what two places drawn from a square as large
        as the area lie apart.
        """
        limit = MEAN_DISTANCE * np.hypot(*ignorance(tuple(self.area.tolist())))
        predicted = error_terms(self.variance_at(places)) @ self.error_coefficients
        return np.clip(predicted, self.error_model.white_sigma, limit)  # limit where they cross

    def variance_at(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` the field's variance at ``(M, 2)`` places, as a share of the signal."""
        return bilinear(self.variance.reshape(self.shape), self.area, places)


class FrameEvidence:
    """The evidence of frames over a map for states of the appearance: the likelihood of the
    histogram of so many drawn patches, as each of the states corrects them."""

    def __init__(self, texton_map: TextonMap, patches: int, rng: np.random.Generator):
        self._map, self._patches, self._rng = texton_map, patches, rng
        self._field: Field = texton_map.parts["measurement"]
        self.near(None)

    def near(self, estimate: Estimate | None) -> None:
        """Expect the next frame near an estimate; None: anywhere."""
        self._prior: np.ndarray = self._field.prior
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
        residuals = squared / tables.familiar_residual(float(self._field.residual_scale))
        peak = log_posterior.max(axis=1)
        total = np.exp(log_posterior - peak[:, None]).sum(axis=1)
        return peak + np.log(total), residuals.T

    def best_of_tiles(
        self, frame: np.ndarray, states: np.ndarray, penalties: np.ndarray
    ) -> np.ndarray:
        """``(C,)``: which of the ``(S, 5)`` states each tile supports, given ``(S,)`` penalties, at
        the place that all together support.
        """
        by_tile, _, _ = self._likelihoods(frame, states, np.zeros(len(self._field.offsets)))
        by_tile = by_tile - penalties[:, None]
        place = (by_tile.max(axis=1).sum(axis=0) + self._prior).argmax()
        return by_tile[..., place].argmax(axis=1)

    def _likelihoods(
        self, frame: np.ndarray, states: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, TileTables, np.ndarray]:
        """``(C, S, M)`` log likelihoods, their tables, and features ``(S, d)`` as corrected."""
        dictionary, parts, count = self._map.alphabet, self._map.cells, self._patches
        positions = sample_positions(frame.shape, dictionary.patch, count, self._rng)
        patches = (
            corrected_patches(frame, positions, dictionary.patch, state, levels) for state in states
        )
        histograms = np.stack(
            [patch_histogram(each, positions, frame.shape, dictionary, parts) for each in patches]
        )
        tables, deviations = self._field.tables(count), self._field.deviations(histograms)
        return tables.log_likelihoods(deviations), tables, deviations
