"""The player: one HTML file with its data, its style and its script, and no other host."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from html import escape
from importlib.resources import files

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
        "DATA": data,
        "SCRIPT": _read("player.js"),
    }
    # In one go: a flight may be called @DATA@.
    places = f"@({'|'.join(pieces)})@"
    return re.sub(places, lambda place: pieces[place[1]], _read("player.html"))


def _read(name: str) -> str:
    return (files(player) / name).read_text(encoding="utf-8")
