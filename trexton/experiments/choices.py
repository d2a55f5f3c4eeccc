"""What the choices cost that the paper leaves open: one at a time is changed.

Some become what the authors' flight code of 2016 did, which is public; the paper wins where the two
differ. Others become a way that neither took. The record says which (`FLIGHT_CODE`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trexton.cache import cached
from trexton.experiments.declaration import FilterParameters, option
from trexton.experiments.evaluation import frames_of, tracks, trained_map
from trexton.flights.flight import Flight
from trexton.histograms import sampled_histogram
from trexton.localizer import TextonMap
from trexton.metrics import summarize
from trexton.records import Record
from trexton.streams import stream
from trexton.textons import TextonDictionary
from trexton.wording import apart, interval

__all__ = ["finding", "Parameters", "run", "with_trace", "without_trace"]

# Variants that do what the flight code did; the others are ways that neither it nor the paper took.
FLIGHT_CODE = frozenset(
    ("sigma_70", "sigma_200", "motion_8", "motion_25", "particles_140", "particles_1000")
    + ("trace", "winner")
)
_STATISTICS = ("mean_cm", "error_cm_x", "error_cm_y")
# The published histograms: about so many random patches an image.
_PUBLISHED_SAMPLES = 5000


@dataclass(frozen=True)
class _Variant:
    """One choice: how it reads in a table, and what it changes."""

    key: str
    group: str
    label: str
    texton_map: TextonMap
    frames: Sequence[np.ndarray]
    options: dict[str, Any] = field(default_factory=dict[str, Any])


def with_trace(histograms: np.ndarray, samples: int) -> np.ndarray:
    """``(N, K)`` histograms of a program that never clears its counts: h'_t = h_t + h'_{t-1} /
    n.
    """
    traced = np.array(histograms, dtype=float)
    for row in range(1, len(traced)):
        traced[row] += traced[row - 1] / samples
    return traced


def without_trace(histograms: np.ndarray, samples: int) -> np.ndarray:
    """The inverse of `with_trace`; the first row stays as it is."""
    cleared = np.array(histograms, dtype=float)
    cleared[1:] -= histograms[:-1] / samples
    return cleared


@dataclass(frozen=True)
class Parameters(FilterParameters):
    """What can be chosen."""

    repeats: int = option(4, "independent runs of the filter for each variant", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Change one open choice at a time and localize the test flight again.

    Returns
    -------
    Record
        ``values["variants"]``: for each variant its label, group, whether the
        flight code had it, and mean Euclidean and per-axis errors in cm
        with intervals; ``paper`` is the method as it stands.
    """
    texton_map = trained_map(train, neighbors=parameters.neighbors, seed=parameters.seed)
    common = {"samples": parameters.samples, "particles": parameters.particles}
    variants = {}
    for variant in _variants(
        texton_map, train, test, parameters.samples, parameters.neighbors, parameters.seed
    ):
        runs = tracks(
            variant.texton_map,
            variant.frames,
            repeats=parameters.repeats,
            seed=parameters.seed,
            **common | variant.options,
        )
        rng = stream(parameters.seed, "intervals")
        summary = summarize([run.estimate for run in runs], test.position, test.diagonal, rng=rng)
        variants[variant.key] = {
            "label": variant.label,
            "group": variant.group,
            "flight_code": variant.key in FLIGHT_CODE,
        } | {key: summary[key] for key in _STATISTICS}
    return parameters.record(
        train,
        test,
        values={"variants": variants, "order": list(variants)},
    )


def _variants(
    texton_map: TextonMap, train: Flight, test: Flight, samples: int, neighbors: int, seed: int
) -> Iterator[_Variant]:
    frames = frames_of(test)
    yield _Variant("paper", "paper", "as the paper says", texton_map, frames)
    for sigma_cm in (70, 200):
        changed = texton_map.changed({"measurement.sigma": sigma_cm / 100})
        yield _Variant(
            f"sigma_{sigma_cm}",
            "measurement",
            f"one hand-set sigma of {sigma_cm} cm for all ranks",
            changed,
            frames,
        )
    changed = texton_map.changed({"measurement.excluded_s": 0.0})
    yield _Variant(
        "near_in_time",
        "measurement",
        "ranks learned with all other frames allowed as neighbours",
        changed,
        frames,
    )
    for sigma_cm in (8, 25):
        changed = texton_map.changed({"motion.sigma": sigma_cm / 100})
        yield _Variant(
            f"motion_{sigma_cm}",
            "motion",
            f"hand-set motion noise of {sigma_cm} cm a frame",
            changed,
            frames,
        )
    for count in (140, 1000):
        yield _Variant(
            f"particles_{count}",
            "particles",
            f"{count} particles",
            texton_map,
            frames,
            {"particles": count},
        )
    yield _Variant(
        "systematic",
        "resampling",
        "systematic resampling",
        texton_map,
        frames,
        {"resampling": "systematic"},
    )
    yield _Variant(
        "mean",
        "estimate",
        "weighted mean as the estimate",
        texton_map,
        frames,
        {"estimation": "mean"},
    )
    yield _Variant(
        "highest_weight",
        "estimate",
        "heaviest particle as the estimate",
        texton_map,
        frames,
        {"estimation": "highest-weight"},
    )
    if test.has_images and train.has_images:
        rng = stream(seed, "samples")
        drawn = np.array(
            [sampled_histogram(frame, texton_map.alphabet, samples, rng=rng) for frame in frames]
        )
        yield _Variant(
            "trace",
            "histogram",
            "counts never cleared between frames",
            texton_map,
            list(with_trace(drawn, samples)),
        )
        yield _Variant(
            "winner",
            "dictionary",
            "winner-take-all dictionary",
            _winner_take_all(train, neighbors, seed),
            frames,
        )
    else:
        cleared = replace(
            texton_map, histograms=without_trace(texton_map.histograms, _PUBLISHED_SAMPLES)
        )
        assert test.histograms is not None  # a flight without images
        frames = list(without_trace(test.histograms, _PUBLISHED_SAMPLES))
        yield _Variant(
            "trace_removed", "histogram", "the trace of the frame before removed", cleared, frames
        )


def _winner_take_all(train: Flight, neighbors: int, seed: int) -> TextonMap:
    """The map of a dictionary learned as the flight code did, from the cache if it was made
    before.
    """

    def compute() -> Any:
        rng = stream(seed, "training")
        dictionary = TextonDictionary.learn(train, rng=rng, method="winner-take-all")
        return TextonMap.train(
            train, neighbors=neighbors, rng=rng, dictionary=dictionary
        ).to_arrays()

    inputs = {"flight": train.data_hash, "neighbors": neighbors, "seed": seed}
    return TextonMap.from_arrays(
        cached("map-winner-take-all", "trexton.localizer", inputs, compute)
    )


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    variants = record.values["variants"]
    paper = variants["paper"]["mean_cm"]
    others = [each for key, each in variants.items() if key != "paper"]
    told = [each for each in others if apart(each["mean_cm"], paper)]
    best = min(others, key=lambda each: each["mean_cm"]["median"])
    return (
        f"Of {len(others)} choices {len(told)} can be told from the paper's on this flight; "
        f"lowest, in hindsight, is the error with {best['label']}: "
        f"{interval(best['mean_cm'], 'cm')} instead of {interval(paper, 'cm')}."
    )
