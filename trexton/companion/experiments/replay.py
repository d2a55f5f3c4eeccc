"""The test flight once more, frame by frame for the player: a way to look at a result."""

from __future__ import annotations

from trexton.base.errors import MapError
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import MapParameters
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.player.playback import PlayedFlight, record_replay
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.localization.training import for_method

# As the player names them; the first one is shown in detail.
_METHODS = {"paper": "the paper's filter", "guarded": "guarded", "field": "field", "fine": "fine"}


def replay(train: Flight, test: Flight, parameters: MapParameters) -> PlayedFlight:
    """What the first run of the experiment sees and draws, beside every method that can learn here.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms. `fine` is shown where the flight has a picture of its
        floor, and the camera and its height, with which frames are laid on it.
    parameters : MapParameters
        The map's, and the seed.
    """
    texton_map = map_of(train, parameters)
    frames = train.select(train.located)
    known = (train.floor, train.camera, train.height)
    laid = test.has_images and all(each is not None for each in known)
    localizers = {}
    for method, label in _METHODS.items():
        rng = stream(parameters.seed, f"training {method}")
        if method == "fine" and not laid:
            continue
        try:
            learned = for_method(texton_map, method, flight=frames, rng=rng)
        except MapError:  # too short a flight, for one; the paper's method learns from any
            if method == "paper":
                raise
            continue
        localizers[label] = Localizer(
            learned,
            samples=parameters.samples,
            rng=stream(parameters.seed, "flight", 0),
            particles=parameters.particles if method == "paper" else None,
        )
    return record_replay(localizers, test)
