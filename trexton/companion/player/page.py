"""The player: one HTML file with its data, its style and its script, and no other host."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from html import escape
from importlib.resources import files
from typing import Any

from trexton.companion import player
from trexton.companion.player.playback import PlayedFlight

__all__ = ["player_html"]


def player_html(recording: PlayedFlight, title: str | None = None) -> str:
    """The page that plays `recording`.

    Parameters
    ----------
    recording : PlayedFlight
    title : str, optional
        In place of the flight's name.
    """
    data = json.dumps(asdict(recording), separators=(",", ":")).replace("<", "\\u003c")
    pieces = {
        "TITLE": escape(title or recording.flight),
        "STYLE": _read("player.css"),
        "STILL": _still(recording),
        "DATA": data,
        "SCRIPT": _read("player.js"),
    }
    # In one go: a flight may be called @DATA@.
    places = f"@({'|'.join(pieces)})@"
    return re.sub(places, lambda place: pieces[place[1]], _read("player.html"))


def _read(name: str) -> str:
    return (files(player) / name).read_text(encoding="utf-8")


def _still(recording: PlayedFlight) -> str:
    """Where scripts are off: the whole track and its estimates as one drawing."""
    x_min, x_max, y_min, y_max = (100 * value for value in recording.area)
    pad = 0.05 * max(x_max - x_min, y_max - y_min)
    box = (x_min - pad, -y_max - pad, x_max - x_min + 2 * pad, y_max - y_min + 2 * pad)
    width = 0.006 * box[2]
    name = recording.names[0] if recording.names else ""
    dots = "".join(
        f'<circle cx="{each["estimates_cm"][name][0]}" cy="{-each["estimates_cm"][name][1]}" '
        f'r="{1.6 * width:.1f}"/>'
        for each in recording.frames
        if each["estimates_cm"][name]
    )
    track = " ".join(_point(each["truth_cm"]) for each in recording.frames)
    return (
        f'<svg class="still" role="img" aria-label="True track, and estimates of {escape(name)}" '
        f'viewBox="{" ".join(f"{value:.1f}" for value in box)}">'
        f'<polyline points="{track}" fill="none" stroke-width="{width:.1f}" '
        f'style="stroke:var(--truth)"/>'
        f'<g style="fill:var(--paper)">{dots}</g></svg>'
    )


def _point(place: Any) -> str:
    return "" if place is None or None in place else f"{place[0]},{-place[1]}"
