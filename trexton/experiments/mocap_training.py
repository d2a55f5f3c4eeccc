"""Training on motion-capture positions (paper, Analysis, "Training Set based on Motion Tracking System")."""

from __future__ import annotations

import numpy as np

from trexton.experiments.evaluation import (
    Track,
    drift,
    evaluate,
    floor_picture,
    frames_of,
    provenance,
    tracks,
    trained_map,
)
from trexton.flights.flight import Flight
from trexton.localizer import TextonMap
from trexton.metrics import summarize
from trexton.particles import ESTIMATORS
from trexton.records import Record

__all__ = ["run"]


def run(
    train: Flight,
    test: Flight,
    *,
    samples: int = 400,
    textons: int = 20,
    particles: int = 50,
    neighbors: int = 5,
    repeats: int = 20,
    seed: int = 1,
    resampling: str = "wheel",
    estimator: str = "map",
) -> Record:
    """Train on one flight, localize every frame of another, compare with motion capture.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms; then `samples` and `textons` do not apply.
    samples, textons, particles, neighbors : int
        The paper's defaults.
    repeats : int
        Independent runs of the filter over the test flight.
    """
    texton_map = trained_map(train, textons=textons, neighbors=neighbors, seed=seed)
    options = {
        "samples": samples,
        "particles": particles,
        "resampling": resampling,
        "estimator": estimator,
    }
    frames = frames_of(test)
    runs = tracks(texton_map, frames, repeats=repeats, seed=seed, **options)
    values, series = evaluate(runs, texton_map.positions, test, k=neighbors, seed=seed)
    floor, pictures = floor_picture(test)
    rank_std_cm = 100 * np.sqrt(np.diagonal(texton_map.rank_covariance, axis1=1, axis2=2))
    values |= {
        "drift_cm_per_min": drift(runs, test, rng=np.random.default_rng([seed, 10_001])),
        "estimators": _estimators(texton_map, frames, test, runs, seed, options),
        "counts": {
            "train": len(texton_map.positions),
            "test": len(test),
            "test_s": test.time[-1] - test.time[0],
            "textons": texton_map.histograms.shape[1],
            "lost": np.mean([run.lost.sum() for run in runs]),
        },
        "applies": {"sampling": test.has_images, "dictionary": train.has_images},
        "model": {
            "process_std_cm": 100 * np.sqrt(np.diagonal(texton_map.process_covariance)),
            "rank_std_cm": rank_std_cm,
            "first_rank_std_cm": rank_std_cm[0].mean(),
            "last_rank_std_cm": rank_std_cm[-1].mean(),
        },
    }
    step_s = np.concatenate([run.step_s for run in runs])
    return Record(
        experiment="mocap_training",
        flight=train.name,
        parameters={
            **options,
            "textons": textons,
            "neighbors": neighbors,
            "repeats": repeats,
            "seed": seed,
        },
        values=values,
        series=series | floor,
        images=pictures,
        timings={"step_s": {"median": np.median(step_s), "p99": np.percentile(step_s, 99)}},
        provenance=provenance(train, test),
    )


def _estimators(
    texton_map: TextonMap, frames, test: Flight, runs: list[Track], seed: int, options: dict
) -> dict:
    """Mean Euclidean error in cm under each point estimate; the filter draws the same particles under all of them."""
    result = {}
    for name in ESTIMATORS:
        same = name == options["estimator"]
        others = (
            runs
            if same
            else tracks(
                texton_map, frames, repeats=len(runs), seed=seed, **options | {"estimator": name}
            )
        )
        rng = np.random.default_rng([seed, 10_002])
        result[name] = summarize(
            [run.estimate for run in others], test.position, test.diagonal, rng=rng
        )["mean_cm"]
    return result
