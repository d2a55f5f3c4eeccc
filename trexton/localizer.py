"""The texton map, which training produces, and Algorithm 1 of the paper over it: frame in, estimate out."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trexton.errors import ImageError, MapError, ParameterError
from trexton.files import atomic_file, canonical_json
from trexton.flights.flight import Flight
from trexton.histograms import sampled_histogram, texton_histogram
from trexton.images import check_image
from trexton.neighbors import NearestHistograms, Neighbors
from trexton.particles import GaussianMotion, ParticleFilter, RankMixture
from trexton.progress import progress
from trexton.recovery import make_recovery
from trexton.textons import TextonDictionary

__all__ = [
    "Estimate",
    "Localizer",
    "TextonMap",
    "neighbors_in_flight",
    "rank_covariances",
    "process_covariance",
]

SCHEMA = 1
# Frames closer in time than this see nearly the same floor: as neighbours they would flatter the map. With half a second
# the k-NN errs on the training flight about as much as on a fresh flight of the virtual room.
EXCLUDED_SECONDS = 0.5
# A centimetre: keeps a covariance of identical deviations invertible without mattering for any other.
_FLOOR_VARIANCE = 1e-4


def neighbors_in_flight(
    histograms: np.ndarray, time: np.ndarray, k: int, excluded_s: float = EXCLUDED_SECONDS
) -> np.ndarray:
    """``(N, k)`` rows of the nearest histograms of each frame, itself and its neighbours in time left out.

    Raises
    ------
    MapError
        Some frame has fewer than k others outside the excluded time.
    """
    norms = np.einsum("ij,ij->i", histograms, histograms)
    result = np.empty((len(histograms), k), dtype=np.int64)
    for row, histogram in enumerate(histograms):
        distance = norms - 2 * (histograms @ histogram)
        near = np.abs(time - time[row]) <= excluded_s + 1e-9  # stamps are multiples of a period
        near[max(0, row - 1) : row + 2] = True
        if len(near) - near.sum() < k:
            raise MapError(
                f"{len(time)} training frames over {time[-1] - time[0]:.1f} s leave fewer than {k} neighbours outside "
                f"{excluded_s} s of each: record a longer flight or ask for fewer neighbours"
            )
        distance[near] = np.inf
        result[row] = np.argsort(distance, kind="stable")[:k]
    return result


def rank_covariances(positions: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """``(k, 2, 2)`` Sigma^[j] = Var(T - P_j) for each neighbour rank j (Sec. Filtering), square metres."""
    deviation = positions[:, None, :] - positions[rows]
    return np.stack(
        [np.cov(rank.T) + _FLOOR_VARIANCE * np.eye(2) for rank in deviation.transpose(1, 0, 2)]
    )


def process_covariance(positions: np.ndarray, time: np.ndarray) -> np.ndarray:
    """``(2, 2)`` Sigma_process, the covariance of the forward differences T_t - T_{t-1} (Sec. Filtering).

    Pairs with a gap of more than one and a half periods between them say nothing about one step and are left out.
    """
    gaps = np.diff(time)
    steps = np.diff(positions, axis=0)[gaps <= 1.5 * np.median(gaps)]
    return np.cov(steps.T) + 1e-8 * np.eye(2)


@dataclass(frozen=True, eq=False)
class TextonMap:
    """All that the onboard phase needs to know of a place.

    Attributes
    ----------
    dictionary : TextonDictionary or None
        None where the flight came with histograms and no images.
    histograms : (N, K) array
        Relative texton frequencies of the training frames, full sampling.
    positions : (N, 2) array
        Their positions in metres.
    rank_covariance : (k, 2, 2) array
        Sigma^[j] of the measurement model.
    process_covariance : (2, 2) array
        Sigma_process of the motion model.
    area : (x_min, x_max, y_min, y_max)
    image_shape : (rows, columns) or None
    period_s : float
        Median time from frame to frame.
    provenance : dict
        Data hash, parameters, versions.
    """

    dictionary: TextonDictionary | None
    histograms: np.ndarray
    positions: np.ndarray
    rank_covariance: np.ndarray
    process_covariance: np.ndarray
    area: tuple[float, float, float, float]
    image_shape: tuple[int, int] | None
    period_s: float
    provenance: dict = field(default_factory=dict)

    @property
    def neighbors(self) -> int:
        """k, the number of ranks the measurement model was trained for."""
        return len(self.rank_covariance)

    @classmethod
    def train(
        cls,
        flight: Flight,
        *,
        n_textons=20,
        patch=6,
        neighbors=5,
        rng,
        dictionary=None,
        positions=None,
    ) -> TextonMap:
        """Learn a map from a flight (paper, Sec. Dataset Generation to Filtering).

        Parameters
        ----------
        flight : Flight
            With images, or with histograms only.
        n_textons, patch, neighbors : int
            K, the patch's side in pixels, and k.
        rng : numpy.random.Generator
        dictionary : TextonDictionary, optional
            Use this one instead of learning it from the flight's images.
        positions : (N, 2) array, optional
            Use these instead of the flight's ground truth; frames with NaN do not train.

        Raises
        ------
        MapError
            Too few frames with a position.
        """
        given = flight.position if positions is None else np.asarray(positions, dtype=float)
        if given.shape != (len(flight), 2):
            raise ParameterError(
                f"positions have shape {given.shape}: expected ({len(flight)}, 2), one for each frame"
            )
        known = np.isfinite(given).all(axis=1)
        if known.sum() < 3:
            raise MapError(
                f"flight {flight.name!r} has {known.sum()} frames with a position: training needs at least 3"
            )
        if flight.has_images:
            dictionary = dictionary or TextonDictionary.learn(flight, n_textons, patch, rng=rng)
        trained, place = flight.select(known), given[known]
        histograms = full_histograms(trained, dictionary)
        rows = neighbors_in_flight(histograms, trained.time, neighbors)
        parameters = {
            "n_textons": n_textons,
            "patch": patch,
            "neighbors": neighbors,
            "positions": positions is not None,
        }
        return cls(
            dictionary,
            histograms,
            place,
            rank_covariances(place, rows),
            process_covariance(place, trained.time),
            tuple(flight.area),
            trained.image(0).shape[:2] if flight.has_images else None,
            float(np.median(np.diff(trained.time))),
            {
                "flight": flight.name,
                "data_hash": flight.data_hash,
                "parameters": parameters,
                "versions": _versions(),
            },
        )

    def to_arrays(self) -> dict[str, np.ndarray]:
        """The map as named arrays, the form in which it is stored."""
        arrays = {
            "schema": np.int64(SCHEMA),
            "histograms": self.histograms,
            "positions": self.positions,
            "rank_covariance": self.rank_covariance,
            "process_covariance": self.process_covariance,
            "area": np.asarray(self.area, dtype=float),
            "period_s": np.float64(self.period_s),
            "provenance": np.frombuffer(canonical_json(self.provenance).encode(), np.uint8),
        }
        if self.image_shape is not None:
            arrays["image_shape"] = np.asarray(self.image_shape, dtype=np.int64)
        if self.dictionary is not None:
            arrays["textons"] = self.dictionary.textons
        return arrays

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> TextonMap:
        """The map that `to_arrays` described; raises `MapError` for a newer schema, `KeyError` for a missing array."""
        schema = int(arrays["schema"])
        if schema > SCHEMA:
            raise MapError(
                f"map schema {schema} is newer than {SCHEMA}, the newest this version reads: update trexton"
            )
        return cls(
            TextonDictionary(arrays["textons"]) if "textons" in arrays else None,
            arrays["histograms"],
            arrays["positions"],
            arrays["rank_covariance"],
            arrays["process_covariance"],
            tuple(arrays["area"].tolist()),
            tuple(arrays["image_shape"].tolist()) if "image_shape" in arrays else None,
            float(arrays["period_s"]),
            json.loads(arrays["provenance"].tobytes()),
        )

    def save(self, path: str | os.PathLike) -> Path:
        """Write the map as ``.npz``, whole or not at all."""
        with atomic_file(path, "wb") as stream:
            np.savez(stream, **self.to_arrays())
        return Path(path)

    @classmethod
    def load(cls, path: str | os.PathLike) -> TextonMap:
        """Read a map.

        Raises
        ------
        MapError
            The file is missing, damaged, no map, or of a newer schema.
        """
        try:
            with np.load(path, allow_pickle=False) as stored:
                return cls.from_arrays(dict(stored))
        except MapError as error:
            raise MapError(f"{path}: {error}") from None
        except FileNotFoundError:
            raise MapError(
                f"{path}: no such map: make one with trexton train FLIGHT -o {path}"
            ) from None
        except (
            OSError,
            ValueError,
            KeyError,
            EOFError,
            TypeError,
            AttributeError,
            zipfile.BadZipFile,
        ) as error:
            raise MapError(
                f"{path}: not a whole texton map ({error}): copy or train it again"
            ) from None


def _versions() -> dict[str, str]:
    from trexton.records import software_versions

    return software_versions()


def full_histograms(flight: Flight, dictionary: TextonDictionary | None) -> np.ndarray:
    """``(N, K)`` histograms of a flight: full sampling of its images, or those that it brings."""
    if not flight.has_images:
        return flight.histograms
    images = progress(flight.images(), "histograms", total=len(flight))
    return np.stack([texton_histogram(image, dictionary) for image in images])


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """What one step gives, and what it saw and drew on the way.

    Attributes
    ----------
    position : (2,) array
        Point estimate in metres.
    spread : (2,) array
        Standard deviations of the particles in metres.
    covariance : (2, 2) array
    lost : bool
        The position must not be trusted.
    observed : bool
        False where the step only predicted.
    histogram : (K,) array or None
    neighbors : Neighbors or None
    particles : (M, 2) array
    weights : (M,) array
        Of these particles, before resampling.
    """

    position: np.ndarray
    spread: np.ndarray
    covariance: np.ndarray
    lost: bool
    observed: bool
    histogram: np.ndarray | None
    neighbors: Neighbors | None
    particles: np.ndarray
    weights: np.ndarray


class Localizer:
    """Algorithm 1: the same object is evaluated in the notebooks and flown by the onboard script.

    Parameters
    ----------
    texton_map : TextonMap
    samples : int or None
        Patches drawn a frame; None labels every patch (full sampling).
    particles : int
    neighbors : int, optional
        k, at most what the map was trained for; None uses all of it.
    resampling, estimator : str
        See `trexton.particles.RESAMPLERS` and `ESTIMATORS`.
    recovery : {None, "augmented"}
    rng : numpy.random.Generator
    """

    def __init__(
        self, texton_map: TextonMap, *, samples=400, particles=50, neighbors=None, resampling="wheel",
        estimator="map", recovery=None, rng,
    ):  # fmt: skip
        neighbors = texton_map.neighbors if neighbors is None else neighbors
        if not 1 <= neighbors <= texton_map.neighbors:
            raise ParameterError(
                f"{neighbors} neighbours were asked for: this map was trained for 1 to {texton_map.neighbors}"
            )
        if samples is not None and samples < 1:
            raise ParameterError(
                f"{samples} samples were asked for: expected at least 1, or None for every patch"
            )
        self.map, self.samples, self.rng = texton_map, samples, rng
        self.nearest = NearestHistograms(texton_map.histograms, texton_map.positions, k=neighbors)
        self.filter = ParticleFilter(
            GaussianMotion(texton_map.process_covariance),
            RankMixture(texton_map.rank_covariance[:neighbors]),
            texton_map.area,
            particles,
            resampling=resampling,
            estimator=estimator,
            recovery=make_recovery(recovery),
            rng=rng,
        )

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.filter.reset()

    def observe(self, frame: np.ndarray) -> np.ndarray:
        """``(K,)`` histogram of a frame, which is an ``(H, W, 3) uint8`` image or already a histogram."""
        width = self.map.histograms.shape[1]
        if isinstance(frame, np.ndarray) and frame.ndim == 1:
            if frame.shape != (width,) or not np.isfinite(frame).all():
                raise MapError(
                    f"a histogram of shape {frame.shape} was given: this map takes {width} finite frequencies"
                )
            return frame
        check_image(frame)
        if self.map.dictionary is None:
            raise MapError(
                "an image was given, but this map was trained from histograms only and holds no textons: give histograms, or train on a flight with images"
            )
        if frame.shape[:2] != self.map.image_shape:
            rows, columns = self.map.image_shape
            raise ImageError(
                f"the frame is {frame.shape[1]}x{frame.shape[0]}, but the map was trained on {columns}x{rows}: set the camera to that size"
            )
        if self.samples is None:
            return texton_histogram(frame, self.map.dictionary)
        return sampled_histogram(frame, self.map.dictionary, self.samples, rng=self.rng)

    def step(self, frame: np.ndarray | None) -> Estimate:
        """Localize one frame; None stands for a frame that did not come, and only predicts.

        Raises
        ------
        ImageError, MapError
            The frame does not fit the map; the filter is left as it was.
        """
        histogram = None if frame is None else self.observe(frame)
        neighbors = None if histogram is None else self.nearest.query(histogram)
        belief = self.filter.step(None if neighbors is None else neighbors.position)
        _, covariance = self.filter.moments()
        return Estimate(
            self.filter.estimate(), np.sqrt(np.diagonal(covariance)), covariance, belief.lost, frame is not None,
            histogram, neighbors, belief.particles, belief.weights,
        )  # fmt: skip
