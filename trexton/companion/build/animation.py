"""A replayed flight as a moving picture of a few hundred kilobytes, for pages without scripts."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
from PIL import Image, ImageDraw, ImageFont

from trexton.companion.experiments.style import COLORS

__all__ = ["moving_picture"]

_SIZE = (640, 300)
_CAMERA = (200, 150)  # of the camera's picture; the floor fills what is left to its right
_MARGIN = 12
_FRAMES = 46
_LASTS_MS = 220
_TRAIL = 12  # frames
_INK, _TRUTH, _BACK = "#1d262d", "#1d262d", "#ffffff"
_COLORS = tuple(COLORS[name] for name in ("paper", "neighbors", "field"))
_SHOWN = len(_COLORS)  # methods: the first, its neighbours alone, the last


def moving_picture(recording: Mapping[str, Any]) -> bytes:
    """An animated WebP of a recording.

    Parameters
    ----------
    recording : mapping
        As the player keeps it: see `trexton.companion.player.playback.Playback`.
    """
    frames = recording["frames"]
    frames = frames[:: -(-len(frames) // _FRAMES)]
    names = list(frames[0]["estimates_cm"])
    names = [*names[: _SHOWN - 1], names[-1]] if len(names) > _SHOWN else names
    floor = recording["floor"] and _decoded(recording["floor"]["image"])
    drawn = [_drawn(recording, floor, frames[: i + 1], names) for i in range(len(frames))]
    stream = io.BytesIO()
    drawn[0].save(
        stream, "WEBP", save_all=True, append_images=drawn[1:], duration=_LASTS_MS, loop=0,
        quality=30, method=4,
    )  # fmt: skip
    return stream.getvalue()


def _decoded(uri: str) -> Image.Image:
    return Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))).convert("RGB")


def _drawn(
    recording: Mapping[str, Any], floor: Image.Image | None, seen: list[Any], names: list[str]
) -> Image.Image:
    """One frame: the camera and the errors to the left, the floor to the right."""
    picture = Image.new("RGB", _SIZE, _BACK)
    draw, now = ImageDraw.Draw(picture), seen[-1]
    if now["image"]:
        picture.paste(_decoded(now["image"]).resize(_CAMERA), (_MARGIN, _MARGIN))
    at = _lay_floor(picture, recording, floor)
    draw.line(
        [at(each["truth_cm"]) for each in seen[-_TRAIL:]], fill=_TRUTH, width=2, joint="curve"
    )
    for x, y in map(at, now["particles_cm"] or ()):
        draw.ellipse((x - 1, y - 1, x + 1, y + 1), fill=COLORS["particles"])
    for name, color in zip(names, _COLORS, strict=False):
        x, y = at(now["estimates_cm"][name])
        draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=color, outline=_BACK)
    x, y = at(now["truth_cm"])
    draw.ellipse((x - 6, y - 6, x + 6, y + 6), outline=_TRUTH, width=3)
    _write_errors(draw, now, names)
    return picture


def _lay_floor(
    picture: Image.Image, recording: Mapping[str, Any], floor: Image.Image | None
) -> Any:
    """Paste the floor; returns where a place in centimetres comes to lie."""
    x_min, x_max, y_min, y_max = recording["area"]
    left, width = _CAMERA[0] + 3 * _MARGIN, _SIZE[0] - _CAMERA[0] - 4 * _MARGIN
    scale = min(width / (x_max - x_min), (_SIZE[1] - 2 * _MARGIN) / (y_max - y_min))
    left += (width - scale * (x_max - x_min)) / 2

    def at(place_cm: Any) -> tuple[float, float]:
        x, y = place_cm
        return left + scale * (x / 100 - x_min), _MARGIN + scale * (y_max - y / 100)

    if floor is not None:
        west, east, south, north = recording["floor"]["extent_m"]
        (x0, y0), (x1, y1) = at((100 * west, 100 * north)), at((100 * east, 100 * south))
        laid = Image.blend(
            floor.resize((round(x1 - x0), round(y1 - y0))),
            Image.new("RGB", (round(x1 - x0), round(y1 - y0)), _BACK), 0.5,
        )  # fmt: skip
        picture.paste(laid, (round(x0), round(y0)))
    return at


def _write_errors(draw: ImageDraw.ImageDraw, frame: Mapping[str, Any], names: list[str]) -> None:
    font = ImageFont.truetype(
        Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", 12
    )
    y = _CAMERA[1] + 2 * _MARGIN
    draw.text((_MARGIN, y), f"{frame['time_s']:.0f} s; off by", font=font, fill=_INK)
    for name, color in zip(names, _COLORS, strict=False):
        y += 20
        draw.ellipse((_MARGIN, y + 3, _MARGIN + 9, y + 12), fill=color)
        error = frame["errors_cm"][name]
        told = "unknown" if error is None else f"{error} cm"
        draw.text((_MARGIN + 16, y), f"{name}: {told}", font=font, fill=_INK)
    y += 20
    draw.ellipse((_MARGIN, y + 3, _MARGIN + 9, y + 12), outline=_TRUTH, width=2)
    draw.text((_MARGIN + 16, y), "the truth", font=font, fill=_INK)
