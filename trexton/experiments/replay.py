"""The test flight once more, frame by frame for the player: a way to look at a result."""

from __future__ import annotations

from collections.abc import Sequence

from trexton.experiments.declaration import MapParameters
from trexton.experiments.evaluation import floor_picture, trained_map
from trexton.flights.flight import Flight
from trexton.localizer import Localizer
from trexton.player import Recording, record_replay
from trexton.streams import stream

__all__ = ["replay"]


def replay(
    train: Flight, test: Flight, parameters: MapParameters, methods: Sequence[str] = ("paper",)
) -> Recording:
    """What the first run of the experiment sees and draws.

    Parameters
    ----------
    train, test : Flight
    parameters : MapParameters
        The map's, and the seed.
    methods : sequence of str
        The first is shown in detail; of the others the estimates.
    """
    texton_map = trained_map(
        train, textons=parameters.textons, neighbors=parameters.neighbors, seed=parameters.seed
    )
    localizers = {
        _LABELS.get(method, method): Localizer(
            texton_map,
            method=method,
            samples=parameters.samples,
            rng=stream(parameters.seed, "flight", 0),
            particles=parameters.particles if method == "paper" else None,
        )
        for method in methods
    }
    extent, pictures = floor_picture(test)
    floor = (pictures["floor"], tuple(extent["floor"]["extent_m"])) if pictures else None
    return record_replay(localizers, test, floor=floor)


_LABELS = {"paper": "the paper's filter"}
