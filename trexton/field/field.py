"""Measurement by a field: at which places this histogram would be seen, and how sure the field
is there.

Of histograms the features of `trexton.field.features` are taken: roots of frequencies, or what
other values ask for. Their field is learned as Gaussian processes (`trexton.field.process`), their
noise from blocks of the training flight that were left out. What is left of a frame at a place
follows a Student distribution, so that one odd feature rules out no place for good.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import option
from trexton.field.error_model import ErrorModel, unknown
from trexton.field.features import Features
from trexton.field.grid import bilinear, grid_cells
from trexton.field.likelihood import Basis, Table, bumps, relative
from trexton.localization.base import Area, Training, learned
from trexton.localization.estimate import ignorance
from trexton.localization.measurement import MeasurementModel
from trexton.localization.observation import Observation

__all__ = ["Field"]

# Cells times features: what a frame may cost, and how much of the processor's cache it may fill.
LARGEST_TABLE = 600_000
LEAST = 1e-3  # variance, as a share of the signal: no place is taken to be known better
DRAWN = 1.28  # mean distance of two places drawn from a square, over that of one's deviation
FARTHEST = 1e6  # deviations of a feature: beyond, squares would overflow


@dataclass(eq=False)
class Field(MeasurementModel):
    """The likelihood of a histogram over the whole floor, from processes of the training flight."""

    needs = {}
    cells: int = option(
        4800, "squares of the floor, about; fewer where there are many features",
        low=16, high=1_000_000,
    )  # fmt: skip
    axes: np.ndarray = learned()  # (K, d) of `Features`, and
    signed: np.ndarray = learned()  # () whether they are those of values
    center: np.ndarray = learned()  # (d,) their means
    signal: np.ndarray = learned()  # (d,) their variances over the floor
    noise: np.ndarray = learned()  # (d, d) their covariance from frame to frame
    mean: np.ndarray = learned()  # (M, d) the field at the cells, less the centre
    variance: np.ndarray = learned()  # (M,) its variance there, as a share of the signal
    prior: np.ndarray = learned()  # (M,) log of where the training flight was
    area: np.ndarray = learned()  # (4,)
    errors: np.ndarray = learned()  # (3,) an ErrorModel
    learned_at: np.ndarray = learned()  # () the variance where the frames behind it were
    repeated: np.ndarray = learned()  # () see `lasting_growth`
    misfit: np.ndarray = learned()  # () see `strangeness`
    offsets: np.ndarray = learned()  # (C, 2) metres to what the parts of an image show, see `Tiles`
    expected: np.ndarray = learned()  # (3,) metres a term of `unknown`, see `expected_error`

    def __post_init__(self) -> None:
        super().__post_init__()
        self._known: np.ndarray | None = None  # offsets of a field of the same camera

    def fit(self, training: Training) -> Self:
        """Learn field, noise and errors.

        Raises
        ------
        MapError
            All histograms are alike.
        """
        from threadpoolctl import threadpool_limits

        # What learning alone needs; the flight that follows does without SciPy.
        from trexton.field.process import Process, merge_places
        from trexton.field.study import Study
        from trexton.field.tiles import Tiles

        parts = training.cells**2
        with threadpool_limits(1, user_api="blas"):  # sums are rounded alike on any machine
            taken = Features.of(training.histograms, parts)
            features = np.asfortranarray(taken(training.histograms))  # for sums of columns
        if not features.shape[1]:
            raise MapError(
                f"all {len(features)} training histograms are alike: no place can be told from "
                "another, record a flight over a floor with some pattern"
            )
        # Far from where x and y are zero distances would be rounded: that moves by kilometres.
        origin = training.positions.mean(axis=0).round(-3)
        places, area = training.positions - origin, _moved(training.area, -origin)
        if not np.ptp(places, axis=0).any():
            raise MapError(
                f"all {len(places)} training positions are one place: fly over the floor"
            )
        cells = min(self.cells, max(16, LARGEST_TABLE // features.shape[1]))
        centers, _ = grid_cells(area, cells)
        with threadpool_limits(1, user_api="blas"):
            looks = features.reshape(len(features), parts, -1)
            if self._known is not None and len(self._known) in (1, parts):
                tiles = Tiles(self._known)
            else:
                tiles = Tiles.of(places, looks, training.time)
            parts = len(tiles.offsets)
            values = features.reshape(len(features) * parts, -1)
            middle = values.mean(axis=0)
            values = values - middle
            centred = values.reshape(len(features), -1)
            study = Study.of(places, centred, training.time, area, tiles)
            merged, values, counts = merge_places(tiles.places(places), values)
            process = Process.fit(merged, values, study.length, counts)
            mean = np.hstack([process.mean(centers + offset) for offset in tiles.offsets])
            variance = tiles.variance(process, centers, area)
            flown, _, counts = merge_places(places, places)
            prior = relative(bumps(centers, flown, process.length) @ counts)
        return self.with_learned(
            axes=taken.axes,
            signed=np.array(taken.signed),
            center=np.tile(middle, parts),
            signal=study.signal,
            noise=study.noise,
            mean=mean.astype(np.float32),
            variance=variance,
            prior=prior,
            area=np.array(training.area, dtype=float),
            errors=np.array([study.model.lasting, study.model.fresh, study.model.lasts_s]),
            learned_at=np.array(study.learned_at),
            repeated=np.array(study.repeated),
            misfit=np.array(study.misfit),
            offsets=tiles.offsets,
            expected=study.expected,
        )

    def untrained(self) -> Self:
        """As `Part.untrained`; of the same camera it need not find again where its parts look."""
        part = super().untrained()
        part._known = self.offsets
        return part

    @property
    def width(self) -> int:
        return len(self.axes)

    def prepare(self) -> None:
        """Raise `MapError` for arrays that do not fit each other."""
        d, count = len(self.center), len(self.variance)
        shapes = {
            "axes": (len(self.axes), d), "signed": (), "signal": (d,), "noise": (d, d),
            "mean": (count, d), "prior": (count,), "area": (4,), "errors": (3,), "learned_at": (),
            "repeated": (), "misfit": (), "offsets": (len(self.offsets), 2), "expected": (3,),
        }  # fmt: skip
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise MapError(
                    f"the field's {name} has shape {array.shape}: expected {shape}, train the map "
                    "again"
                )
            if not np.isfinite(array).all():
                raise MapError(f"the field's {name} is not finite: fly over more of the floor")
        wanted = min(self.cells, max(16, LARGEST_TABLE // d))
        self.centers, self.shape = grid_cells(tuple(self.area.tolist()), wanted)
        if len(self.centers) != count:
            raise MapError(f"the field has {count} cells and {d} features that fit no grid")
        self.features = Features(self.axes, bool(self.signed))
        self._tables: dict[int | None, tuple[np.ndarray, Table]] = {}

    @cached_property
    def error_model(self) -> ErrorModel:
        """How single frames err."""
        return ErrorModel(*self.errors.tolist())

    @property
    def cell(self) -> float:
        """Side of a cell in metres."""
        x_min, x_max, y_min, y_max = self.area
        return float(np.sqrt((x_max - x_min) * (y_max - y_min) / len(self.centers)))

    def look(self, observation: Observation) -> None:
        observation.histogram  # noqa: B018  drawn before the filter draws

    def over_cells(self, observation: Observation) -> np.ndarray:
        """``(M,)`` log of likelihood times prior at the centres of the cells, less a constant."""
        whiten, table = self._table(observation.samples)
        limit = FARTHEST * np.sqrt(self.signal)
        features = np.clip(self.features(observation.histogram) - self.center, -limit, limit)
        found: np.ndarray = table.log_likelihood(features @ whiten) + self.prior
        return found

    def _table(self, samples: int | None) -> tuple[np.ndarray, Table]:
        """Axes in which the noise of so many samples is white, and the field along them."""
        if samples not in self._tables:
            basis = Basis.of(self.signal, self.noise, samples)
            table = Table.of(self.mean @ basis.whiten, self.variance, basis.strength)
            self._tables[samples] = basis.whiten, table
        return self._tables[samples]

    def strangeness(self, observation: Observation, found: np.ndarray) -> float:
        """How far what was seen is from the field where it fits best, of which `found` by
        `over_cells` tells: below 1 for nineteen of twenty frames of the survey that were left out.
        """
        _, table = self._table(observation.samples)
        cell = int(found.argmax())
        far = table.misfit(found[cell] - self.prior[cell], cell)
        return float(far / max(float(self.misfit), LEAST))

    def log_likelihood(self, places: np.ndarray, observation: Observation) -> np.ndarray:
        grid = self.over_cells(observation).reshape(self.shape)
        return bilinear(grid, self.area, places)

    def lasting_growth(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` factors, one at least, on the variance of lasting errors at `places` ``(M, 2)``.

        What is claimed grows with the root of the field's variance. Between the passes of a survey
        it is larger than where the errors were learned; and where a survey repeats its passes, they
        were learned nearer to it than a later flight will be.
        """
        between = self.variance_at(places) / max(float(self.learned_at), LEAST)
        return float(self.repeated) * np.maximum(1.0, between)

    def expected_error(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` metres by which a single frame is expected to err at `places` ``(M, 2)``.

        No less than what is new in each frame, and no more than what two places drawn from a
        square as large as the area lie apart.
        """
        drawn = DRAWN * np.hypot(*ignorance(tuple(self.area.tolist())))
        expected = unknown(self.variance_at(places)) @ self.expected
        return np.clip(expected, self.error_model.fresh, drawn)  # the latter where they cross

    def variance_at(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` the field's variance at `places` ``(M, 2)``, as a share of the signal."""
        return bilinear(self.variance.reshape(self.shape), self.area, places)


def _moved(area: Area, by: np.ndarray) -> Area:
    (x, y), (x_min, x_max, y_min, y_max) = by.tolist(), area
    return x_min + x, x_max + x, y_min + y, y_max + y
