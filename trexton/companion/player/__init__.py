"""A flight to look at, frame by frame: what the camera saw, what the localizer made of it."""

from trexton.companion.player.page import player_html
from trexton.companion.player.recording import Recording, record_replay

__all__ = ["Recording", "player_html", "record_replay"]
