"""Measurement by a field: at which places a histogram would be observed, and how certain the field
is there.

Of histograms the features of `trexton.field.features` are taken: roots of frequencies, or what
other values ask for. Their field is learned as Gaussian processes (`trexton.field.process`), noise
and errors by cross-validation. The residual of a frame at a place follows a Student distribution,
so that one odd feature rules out no place for good.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import option
from trexton.field.features import Features, is_counted
from trexton.field.likelihood import (
    Basis,
    ErrorModel,
    TileTables,
    bilinear,
    error_terms,
    grid_cells,
    log_prior,
    rbf_kernel,
    tile_blocks,
)  # fmt: skip
from trexton.localization.base import learned
from trexton.localization.estimate import ignorance
from trexton.localization.measurement import MeasurementModel
from trexton.localization.observation import Observation
from trexton.localization.training_set import Training

__all__ = ["Field"]

# Cells times features: what a frame may cost, and how much of the processor's cache it may fill.
MAX_TABLE = 600_000
MIN_VARIANCE = 1e-3  # share of the signal: no place is taken to be known better
MEAN_DISTANCE = 1.28  # of two places drawn from a square, over that of one's deviation
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
    mean: np.ndarray = learned()  # (M, d) the field at the cells, less the centre
    variance: np.ndarray = learned()  # (M,) its variance there, as a share of the signal
    prior: np.ndarray = learned()  # (M,) log density of the training flight over the cells
    area: np.ndarray = learned()  # (4,)
    errors: np.ndarray = learned()  # (3,) an ErrorModel
    training_variance: np.ndarray = learned()  # () the field's where its errors were learned
    revisit_inflation: np.ndarray = learned()  # () see `correlated_inflation`
    residual_scale: np.ndarray = learned()  # () see `normalized_residual`
    offsets: np.ndarray = learned()  # (C, 2) metres to the footprints of the `Tiles`
    error_coefficients: np.ndarray = learned()  # (3,) metres, see `predicted_error`

    def __post_init__(self) -> None:
        super().__post_init__()
        self._known_offsets: np.ndarray | None = None  # of a field of the same camera

    def fit(self, training: Training) -> Self:
        """Learn field, noise and errors.

        Raises
        ------
        MapError
            All histograms are alike, or all places.
        """
        from threadpoolctl import threadpool_limits

        # What learning alone needs; the flight that follows does without SciPy.
        from trexton.field.cross_validation import cross_validate, select_features
        from trexton.field.process import Process, merge_places
        from trexton.field.tiles import Tiles

        parts, histograms = training.cells**2, training.histograms
        counted = is_counted(histograms, parts)
        with threadpool_limits(1, user_api="blas"):  # sums are rounded alike on any machine
            candidates = Features.candidates(histograms, parts)
        if not candidates[0].axes.shape[1]:
            raise MapError(
                f"all {len(histograms)} training histograms are alike: no place differs from "
                "another, record a flight over a floor with some pattern"
            )
        # Far from where x and y are zero distances would be rounded: that moves by kilometres.
        origin = training.positions.mean(axis=0).round(-3)
        places = training.positions - origin
        x_min, x_max, y_min, y_max = (np.array(training.area) - origin.repeat(2)).tolist()
        area = x_min, x_max, y_min, y_max
        if not np.ptp(places, axis=0).any():
            raise MapError(
                f"all {len(places)} training positions are one place: fly over the floor"
            )
        with threadpool_limits(1, user_api="blas"):
            taken = select_features(candidates, histograms, places, training.time, area)
            features = np.asfortranarray(taken(histograms))  # for sums of columns
        cells = min(self.cells, max(16, MAX_TABLE // features.shape[1]))
        centers, _ = grid_cells(area, cells)
        with threadpool_limits(1, user_api="blas"):
            offsets = self._known_offsets
            if offsets is not None and len(offsets) in (1, parts):
                tiles = Tiles(offsets)
            else:
                of_parts = features.reshape(len(features), parts, -1)
                tiles = Tiles.of(places, of_parts, training.time)
            parts = len(tiles.offsets)
            values = features.reshape(len(features) * parts, -1)
            middle = values.mean(axis=0)
            values = values - middle
            centred = values.reshape(len(features), -1)
            chosen, judged, _ = cross_validate(places, centred, training.time, area, tiles, counted)
            merged, values, counts = merge_places(tiles.places(places), values)
            process = Process.fit(merged, values, chosen.length, counts, noise=chosen.noise)
            mean = np.hstack([process.mean(centers + offset) for offset in tiles.offsets])
            variance = tiles.variance(process, centers, area)
            flown, _, counts = merge_places(places, places)
            prior = log_prior(rbf_kernel(centers, flown, process.length) @ counts, counted)
        return self.with_learned(
            axes=taken.axes,
            signed=np.array(taken.signed),
            center=np.tile(middle, parts),
            mean=mean.astype(np.float32),
            variance=variance,
            prior=prior,
            area=np.array(training.area, dtype=float),
            offsets=tiles.offsets,
            **judged,
        )

    def untrained(self) -> Self:
        """As `Part.untrained`; the footprints of the same camera need no second search."""
        part = super().untrained()
        part._known_offsets = self.offsets
        return part

    @property
    def width(self) -> int:
        return len(self.axes)

    def prepare(self) -> None:
        """Raise `MapError` for arrays that do not fit each other."""
        d, count = len(self.center), len(self.variance)
        numbers = ("signed", "training_variance", "revisit_inflation", "residual_scale")
        shapes: dict[str, tuple[int, ...]] = {name: () for name in numbers}
        shapes |= {"area": (4,), "errors": (3,), "error_coefficients": (3,), "prior": (count,)}
        shapes |= {"axes": (len(self.axes), d), "signal": (d,), "noise": (d, d)}
        shapes |= {"mean": (count, d), "offsets": (len(self.offsets), 2)}
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise MapError(
                    f"the field's {name} has shape {array.shape}: expected {shape}, train the map "
                    "again"
                )
            if not np.isfinite(array).all():
                raise MapError(f"the field's {name} is not finite: fly over more of the floor")
        wanted = min(self.cells, max(16, MAX_TABLE // d))
        self.centers, self.shape = grid_cells(tuple(self.area.tolist()), wanted)
        if len(self.centers) != count:
            raise MapError(f"the field has {count} cells and {d} features that fit no grid")
        self.features = Features(self.axes, bool(self.signed))
        self._tables: dict[int | None, TileTables] = {}

    @cached_property
    def error_model(self) -> ErrorModel:
        """How single frames err."""
        return ErrorModel(*self.errors.tolist())

    @property
    def cell(self) -> float:
        """Side of a cell in metres."""
        x_min, x_max, y_min, y_max = self.area
        return float(np.sqrt((x_max - x_min) * (y_max - y_min) / len(self.centers)))

    def prepare_frame(self, observation: Observation) -> None:
        observation.histogram  # noqa: B018  drawn before the filter draws

    def log_posterior(self, observation: Observation) -> np.ndarray:
        """``(M,)`` log of likelihood times prior at the centres of the cells, less a constant."""
        deviations = self.deviations(observation.histogram)
        by_tile = self.tables(observation.samples).log_likelihoods(deviations)
        result: np.ndarray = by_tile.sum(axis=0) + self.prior
        return result

    def deviations(self, histograms: np.ndarray) -> np.ndarray:
        """``(..., d)`` features of histograms ``(..., K)``, less the centre."""
        limit = MAX_DEVIATION * np.sqrt(self.signal)
        return np.clip(self.features(histograms) - self.center, -limit, limit)

    def tables(self, samples: int | None) -> TileTables:
        """Likelihoods of the tiles where so many samples were counted; None: all patches."""
        if samples not in self._tables:
            parts = len(self.offsets)
            noise = tile_blocks(self.noise, parts)
            signals = np.split(self.signal, parts)
            bases = [Basis.of(*each, samples) for each in zip(signals, noise, strict=True)]
            means = np.split(self.mean, parts, axis=1)
            self._tables[samples] = TileTables.of(means, self.variance, bases)
        return self._tables[samples]

    def normalized_residual(self, observation: Observation, log_posterior: np.ndarray) -> float:
        """Squared residual of the frame at its best cell, over that of familiar frames: below 1 for
        nineteen of twenty frames of the survey that were left out.
        """
        deviations, cell = self.deviations(observation.histogram), log_posterior.argmax()
        tables = self.tables(observation.samples)
        squared = tables.squared_residual(deviations[None], np.array([cell]))
        return float(squared[0] / max(float(self.residual_scale), MIN_VARIANCE))

    def log_likelihood(self, places: np.ndarray, observation: Observation) -> np.ndarray:
        return bilinear(self.log_posterior(observation).reshape(self.shape), self.area, places)

    def correlated_inflation(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` factors, at least one, on the variance of correlated errors at `places`.

        The covariance grows with the field's variance: between the passes of a survey it is larger
        than where the errors were learned; and where a survey repeats its passes, they were learned
        nearer to it than a later flight will be.
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
