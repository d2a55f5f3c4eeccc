"""The test flight once more, frame by frame for the player: a way to look at a result."""

from __future__ import annotations

import numpy as np

from trexton.experiments.declaration import MapParameters
from trexton.experiments.evaluation import floor_picture, trained_map
from trexton.flights.flight import Flight
from trexton.localizer import Localizer
from trexton.player import Recording, record_replay
from trexton.streams import stream

__all__ = ["replay"]

# As the player names them; the first one is shown in detail.
_METHODS = {"paper": "the paper's filter", "guarded": "guarded", "field": "field", "fine": "fine"}


def replay(train: Flight, test: Flight, parameters: MapParameters) -> Recording:
    """What the first run of the experiment sees and draws, and every other method beside it.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms. `fine` is shown where the flight has a picture of its
        floor, and the camera and its height, with which frames are laid on it.
    parameters : MapParameters
        The map's, and the seed.
    """
    texton_map = trained_map(
        train, textons=parameters.textons, neighbors=parameters.neighbors, seed=parameters.seed
    )
    frames = train.select(np.isfinite(train.position).all(axis=1))
    laid = None not in (train.floor, train.camera, train.height) and test.has_images
    methods = [each for each in _METHODS if each != "fine" or laid]
    localizers = {
        _METHODS[method]: Localizer(
            texton_map.for_method(
                method, flight=frames, rng=stream(parameters.seed, f"training {method}")
            ),
            samples=parameters.samples,
            rng=stream(parameters.seed, "flight", 0),
            particles=parameters.particles if method == "paper" else None,
        )
        for method in methods
    }
    extent, pictures = floor_picture(test)
    floor = (pictures["floor"], tuple(extent["floor"]["extent_m"])) if pictures else None
    return record_replay(localizers, test, floor=floor)
