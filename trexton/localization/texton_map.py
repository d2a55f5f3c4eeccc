"""The texton map: the training set of a place, and what the parts of a method learned from it.

Plain data: `trexton.localization.training` makes one, `trexton.localization.map_files` stores it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trexton.base.defaults import NEIGHBORS
from trexton.base.errors import MapError
from trexton.localization.base import Area
from trexton.localization.neighbors import Distance, Hellinger
from trexton.vision.textons import TextonDictionary

if TYPE_CHECKING:
    from trexton.vision.camera import Rectification


@dataclass(frozen=True, eq=False)
class TextonMap:
    """All that the onboard phase needs to know of a place.

    Attributes
    ----------
    dictionary : TextonDictionary or None
        None where the flight came with histograms and no images.
    histograms : (N, K) array
        Relative texton frequencies of the training frames, full sampling; of one part of the image
        after the other where it is cut into `cells`.
    positions : (N, 2) array
        Their positions in metres.
    time : (N,) array
        Their stamps in seconds.
    area : (x_min, x_max, y_min, y_max)
    image_shape : (rows, columns) or None
    period_s : float
        Median time from frame to frame.
    method : str
        What it was trained for.
    parts : dict of str to Part
        By role, trained.
    provenance : dict
        Data hash, parameters, versions.
    rectification : Rectification or None
        What was done to a camera's images before; a camera in flight needs the same.
    """

    dictionary: TextonDictionary | None
    histograms: np.ndarray
    positions: np.ndarray
    time: np.ndarray
    area: Area
    image_shape: tuple[int, int] | None
    period_s: float
    method: str
    parts: dict[str, Any]
    provenance: dict[str, Any] = field(default_factory=dict)
    rectification: Rectification | None = None

    @property
    def cells(self) -> int:
        """Into how many parts along each side an image is cut, each with a histogram of its own."""
        if self.dictionary is None or self.image_shape is None:
            return 1
        return math.isqrt(self.histograms.shape[1] // len(self.dictionary.textons))

    @property
    def feature_names(self) -> list[str]:
        """Of the columns of a map that was trained on other features; none where unknown."""
        return self.provenance.get("features", [])

    @property
    def alphabet(self) -> TextonDictionary:
        """The dictionary of a map that was trained on images; `MapError` where there is none."""
        if self.dictionary is None:
            raise MapError("the map was trained on histograms and holds no textons: use images")
        return self.dictionary

    @property
    def distance(self) -> Distance:
        """Between histograms: the method's, or Hellinger's where it looks at no neighbours."""
        return self.parts.get("distance") or Hellinger()

    @property
    def neighbors(self) -> int:
        """k: neighbours that the measurement model was trained for; the usual where it has none."""
        return int(getattr(self.parts.get("measurement"), "neighbors", NEIGHBORS))

    def joined(self) -> TextonMap:
        """This map with histograms of whole images; its parts stay as they are."""
        parts = self.histograms.reshape(len(self.histograms), self.cells**2, -1)
        return self.with_histograms(parts.sum(axis=1), 1)

    def with_histograms(self, histograms: np.ndarray, cells: int) -> TextonMap:
        """This map with other histograms of its frames, of so many parts of the image a side."""
        parameters = self.provenance.get("parameters", {}) | {"cells": cells}
        provenance = self.provenance | {"parameters": parameters}
        return replace(self, histograms=histograms, provenance=provenance)

    def select(self, rows: np.ndarray) -> TextonMap:
        """The map of these rows only, a mask or indices; its parts stay as they learned."""
        kept = {name: getattr(self, name)[rows] for name in ("histograms", "positions", "time")}
        return replace(self, **kept)
