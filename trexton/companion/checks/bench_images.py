"""Stages that look at pixels: histograms, homography, simulator."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from trexton.companion.checks.scene import Scene
from trexton.companion.checks.timing import Row, interleave
from trexton.companion.executor import limited_threads
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.patches import gather_patches, position_grid, sample_positions

__all__ = ["full_histogram", "homography", "sampled", "simulator"]

_GEMM = 2048
_CORRECT_M = 0.3  # metres within which a fix counts as right


def operations(shape: tuple[int, ...], n_textons: int, patch: int) -> float:
    """Multiplications and additions of labelling every position: 1.303e9 for 640x480, 20 textons of
    6x6x3.
    """
    return 2.0 * np.prod(position_grid(shape, patch)) * n_textons * 3 * patch**2


def full_histogram(scene: Scene, quick: bool) -> Iterator[Row]:
    """Every patch of a frame labelled: the compiled kernel against sgemm and SciPy."""
    image, dictionary, rng = scene.frame, scene.dictionary, scene.rng("full sampling")
    square = rng.random((_GEMM, _GEMM), dtype=np.float32)
    share = operations(image.shape, dictionary.n_textons, dictionary.patch) / (2.0 * _GEMM**3)
    for threads in (1, 2):
        contestants = {
            "sgemm": lambda: square @ square,
            "numba": lambda: texton_histogram(image, dictionary),
        }
        if threads == 1:
            contestants["cdist"] = lambda: _by_cdist(image, dictionary)
        with limited_threads(threads):
            times = interleave(
                contestants, 0.6 if quick else 2.0, 3 if quick else 9, pause=threads > 1
            )
        same_work = times["sgemm"].median * share
        name, size = "full histogram", f"{image.shape[1]}x{image.shape[0]}"
        limit = 1 / (1.15, 0.9)[threads - 1]
        yield Row.compare(name, size, threads, times["numba"], "sgemm's rate", same_work, limit)
        if threads == 1:
            yield Row.compare(
                name, size, threads, times["numba"], "SciPy cdist", times["cdist"], 1 / 15
            )


def sampled(scene: Scene, quick: bool) -> Iterator[Row]:
    """400 samples of a frame against SciPy on gathered patches."""
    from scipy.spatial.distance import cdist

    image, dictionary, rng = scene.frame, scene.dictionary, scene.rng("samples")
    textons = dictionary.textons.reshape(dictionary.n_textons, -1).astype(float)

    def by_cdist() -> Any:
        patches = gather_patches(image, sample_positions(image.shape, 6, 400, rng), 6).reshape(
            400, -1
        )
        return (
            np.bincount(cdist(patches, textons, "sqeuclidean").argmin(axis=1), minlength=20) / 400
        )

    contestants = {
        "ours": lambda: sampled_histogram(image, dictionary, 400, rng=rng),
        "cdist": by_cdist,
    }
    with limited_threads(1):
        times = interleave(contestants, 0.3 if quick else 1.0)
    yield Row.compare(
        "sampled histogram", 400, 1, times["ours"], "SciPy cdist", times["cdist"], 1.0
    )


def homography(scene: Scene, quick: bool) -> Iterator[Row]:
    """One frame located on the floor's picture against one SIFT of it, and the mode at half
    resolution.
    """
    from trexton.registration.homography import HomographyLocalizer

    frames, positions = scene.views
    whole, half = (
        HomographyLocalizer(scene.simulator.floor.picture, scale=scale) for scale in (1.0, 0.5)
    )
    turn = iter(np.tile(np.arange(len(frames)), 10_000))
    detector = cv2.SIFT.create(nfeatures=whole.keypoints)
    luma = [np.ascontiguousarray(frame[..., 0]) for frame in frames]
    contestants = {
        "whole": lambda: whole.locate(frames[next(turn)]),
        "half": lambda: half.locate(frames[next(turn)]),
        "sift": lambda: detector.detectAndCompute(luma[next(turn)], None),
    }
    with limited_threads(1):
        times = interleave(contestants, 1.0 if quick else 4.0, 3 if quick else 6)
        right = {
            name: np.mean([
                np.hypot(*(localizer.locate(frame).position - position)) < _CORRECT_M
                for frame, position in zip(frames, positions, strict=False)
            ])
            for name, localizer in (("whole", whole), ("half", half))
        }  # fmt: skip
    size = f"{frames[0].shape[1]}x{frames[0].shape[0]}"
    notes = {name: f"right within {_CORRECT_M} m: {share:.0%}" for name, share in right.items()}
    sift = "SIFT of the frame"
    yield Row.compare(
        "homography", size, 1, times["whole"], sift, times["sift"], 1.4, notes["whole"]
    )
    half_name = "homography, half resolution"
    yield Row.compare(
        half_name, size, 1, times["half"], "homography", times["whole"], 1 / 3, notes["half"]
    )


def simulator(scene: Scene, quick: bool) -> Iterator[Row]:
    """A frame of the virtual room with all effects against one warp of the floor's picture."""
    room, picture = scene.simulator, scene.simulator.floor.picture
    state = room.state
    camera_view = room.camera.world_from_pixel(state.position, state.attitude)
    view = np.linalg.inv(picture.world_from_pixel) @ camera_view
    size = (room.camera.width, room.camera.height)

    def warp() -> Any:
        return cv2.warpPerspective(
            picture.image, view, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )

    def render() -> Any:
        room.step(np.array([2.5, 2.5]))
        return room.render()

    with limited_threads(1):
        times = interleave({"ours": render, "warp": warp}, 0.5 if quick else 2.0)
    name = f"{size[0]}x{size[1]}"
    yield Row.compare("simulator", name, 1, times["ours"], "warpPerspective", times["warp"], 8.0)


def _by_cdist(image: np.ndarray, dictionary: Any, rows: int = 16) -> np.ndarray:
    """Full sampling with SciPy, a few rows at a time."""
    from scipy.spatial.distance import cdist

    window = (dictionary.patch, dictionary.patch)
    textons = dictionary.textons.reshape(dictionary.n_textons, -1).astype(float)
    windows = np.lib.stride_tricks.sliding_window_view(image, window, axis=(0, 1)).transpose(
        0, 1, 3, 4, 2
    )
    counts = np.zeros(dictionary.n_textons)
    for first in range(0, len(windows), rows):
        patches = windows[first : first + rows].reshape(-1, textons.shape[1])
        counts += np.bincount(
            cdist(patches, textons, "sqeuclidean").argmin(axis=1), minlength=len(counts)
        )
    return counts / counts.sum()
