"""A replayed flight as a moving picture of a few hundred kilobytes, for pages without scripts.

Offers `moving_picture`, which draws what the player keeps with Matplotlib.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from trexton.companion.experiments.style import COLORS

__all__ = ["moving_picture"]

_INCHES, _DPI = (6.4, 3.0), 100
_FRAMES = 46
_LASTS_MS = 220
_TRAIL = 12  # frames
_TRUTH = "#1d262d"
_COLORS = tuple(COLORS[name] for name in ("paper", "neighbors", "field"))
_SHOWN = len(_COLORS)  # methods: the first, its neighbours alone, the last


def moving_picture(recording: Mapping[str, Any]) -> bytes:
    """An animated WebP of a recording.

    Parameters
    ----------
    recording : mapping
        As the player keeps it: see `trexton.companion.player.playback.PlayedFlight`.
    """
    frames = recording["frames"]
    frames = frames[:: -(-len(frames) // _FRAMES)]
    names = list(frames[0]["estimates_cm"])
    names = [*names[: _SHOWN - 1], names[-1]] if len(names) > _SHOWN else names
    drawn = [_drawn(recording, frames[: i + 1], names) for i in range(len(frames))]
    stream = io.BytesIO()
    drawn[0].save(
        stream, "WEBP", save_all=True, append_images=drawn[1:], duration=_LASTS_MS, loop=0,
        quality=30, method=4,
    )  # fmt: skip
    return stream.getvalue()


def _decoded(uri: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))))


def _drawn(recording: Mapping[str, Any], frames: list[Any], names: list[str]) -> Image.Image:
    """The last of `frames`: the camera and the errors to the left, the floor to the right."""
    figure, now = Figure(_INCHES), frames[-1]
    camera = figure.add_axes((0.02, 0.46, 0.31, 0.5))
    floor = figure.add_axes((0.36, 0.04, 0.62, 0.92))
    for axes in (camera, floor):
        axes.set_axis_off()
    if now["image"]:
        camera.imshow(_decoded(now["image"]))
    if recording["floor"]:
        extent = recording["floor"]["extent_m"]
        floor.imshow(_decoded(recording["floor"]["image"]), extent=extent, alpha=0.5)
    x_min, x_max, y_min, y_max = recording["area"]
    floor.set(xlim=(x_min, x_max), ylim=(y_min, y_max), aspect="equal")
    trail = np.array([each["truth_cm"] for each in frames[-_TRAIL:]], dtype=float) / 100
    floor.plot(*trail.T, color=_TRUTH)
    if now["particles_cm"]:
        particles = np.array(now["particles_cm"], dtype=float) / 100
        floor.plot(*particles.T, ".", color=COLORS["particles"], markersize=2)
    figure.text(0.02, 0.38, f"{now['time_s']:.0f} s; off by", color=_TRUTH)
    for row, (name, color) in enumerate(zip(names, _COLORS, strict=False)):
        place = np.array(now["estimates_cm"][name] or (np.nan, np.nan), dtype=float) / 100
        floor.plot(*place, "o", color=color)
        error = now["errors_cm"][name]
        said = "unknown" if error is None else f"{error} cm"
        figure.text(0.02, 0.3 - 0.08 * row, f"● {name}: {said}", color=color)
    floor.plot(*trail[-1], "o", color=_TRUTH, markersize=9, fillstyle="none", markeredgewidth=2)
    figure.text(0.02, 0.3 - 0.08 * len(names), "○ the truth", color=_TRUTH)
    stream = io.BytesIO()
    figure.savefig(stream, dpi=_DPI)
    return Image.open(stream).convert("RGB")
