"""A map and a frame become a position. Offers `Localizer`, the same in flight as in a notebook."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.base.errors import ParameterError
from trexton.base.streams import generator
from trexton.localization.estimate import Estimate
from trexton.localization.neighbors import NearestHistograms
from trexton.localization.pipeline import Pipeline
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import for_method, with_choices

__all__ = ["Estimate", "Localizer", "TextonMap"]


class Localizer(Pipeline):
    """Composes the parts of a method: the same object is evaluated in the notebooks and flown on
    board.

    Parameters
    ----------
    texton_map : TextonMap
    method : str, optional
        Another than the map was trained for; its parts then learn from the map's training set.
    samples, neighbors, nearest, mark, rng
        See `Pipeline`.
    particles : int, optional
        Short for the choice ``filter.particles``.
    **choices
        ``role``: a part, or its name; ``role.option``: a value. See `trexton.localization.methods`.

    Raises
    ------
    ParameterError
        A part or option is unknown or out of range, `rng` is no generator.
    """

    def __init__(
        self,
        texton_map: TextonMap,
        method: str | None = None,
        *,
        samples: int | None = SAMPLES,
        particles: int | None = None,
        neighbors: int | None = None,
        nearest: NearestHistograms | None = None,
        mark: Callable[[str], object] | None = None,
        rng: np.random.Generator,
        **choices: object,
    ):
        rng = generator(rng)
        if not isinstance(texton_map, TextonMap):
            raise ParameterError(
                f"texton_map is a {type(texton_map).__name__}: expected a TextonMap, as load_map "
                "or train_map makes it"
            )
        if particles is not None:
            choices["filter.particles"] = particles
        texton_map = with_choices(for_method(texton_map, method), choices)
        super().__init__(
            texton_map, samples=samples, neighbors=neighbors, nearest=nearest, mark=mark, rng=rng
        )
