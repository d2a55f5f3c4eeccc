"""The texton map, which training produces: the training set, and what the parts of a method learned
from it.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trexton.base.defaults import NEIGHBORS, PATCH, TEXTONS, USUAL_CELLS
from trexton.base.errors import MapError, ParameterError
from trexton.base.files import atomic_file
from trexton.base.options import whole
from trexton.base.progress import say
from trexton.base.streams import generator
from trexton.localization.base import Area, Part, Training
from trexton.localization.counting import full_histograms
from trexton.localization.distances import Distance, Hellinger
from trexton.localization.map_files import DAMAGE, from_arrays, read_arrays, to_arrays
from trexton.localization.methods import changed, compose, fitting
from trexton.vision.rectification import Rectification
from trexton.vision.textons import MAX_PATCH, MAX_TEXTONS, TextonDictionary

if TYPE_CHECKING:
    from trexton.flights.flight import Flight

__all__ = ["TextonMap"]

JUDGES = ("calibration", "integrity")  # parts that learn last, the first before the second


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
    def alphabet(self) -> TextonDictionary:
        """The dictionary of a map that was trained on images; `MapError` where there is none."""
        if self.dictionary is None:
            raise MapError(
                "this map was trained on histograms and holds no textons: train on images"
            )
        return self.dictionary

    @property
    def distance(self) -> Distance:
        """Between histograms: the method's, or Hellinger's where it looks at no neighbours."""
        return self.parts.get("distance") or Hellinger()

    @property
    def neighbors(self) -> int:
        """k: neighbours that the measurement model was trained for; the usual where it has none."""
        return int(getattr(self.parts.get("measurement"), "neighbors", NEIGHBORS))

    @classmethod
    def train(
        cls,
        flight: Flight,
        *,
        method: str = "paper",
        n_textons: int = TEXTONS,
        patch: int = PATCH,
        cells: int | None = None,
        neighbors: int | None = None,
        rng: np.random.Generator,
        dictionary: TextonDictionary | None = None,
        positions: np.ndarray | None = None,
        **choices: object,
    ) -> TextonMap:
        """Learn a map from a flight (paper, Sec. Dataset Generation to Filtering).

        Parameters
        ----------
        flight : Flight
            With images, or with histograms only.
        method : str
            An entry of `trexton.localization.methods.METHODS`.
        n_textons, patch : int
            K, and the patch's side in pixels.
        cells : int, optional
            Parts of the image along each side, each with a histogram of its own; 1 in the paper.
            The method's own unless given, see `trexton.base.defaults.USUAL_CELLS`; 1 where parts of
            the image show nothing of what others show, as when the heading was not held.
        neighbors : int, optional
            Short for the choice ``measurement.neighbors``.
        rng : numpy.random.Generator
        dictionary : TextonDictionary, optional
            Use this one instead of learning it from the flight's images.
        positions : (N, 2) array, optional
            Use these instead of the flight's ground truth; frames with NaN do not train.
        **choices
            ``role``: a part, or its name; ``role.option``: a value. They replace what the method
            says.

        Raises
        ------
        MapError
            Too few frames with a position.
        ParameterError
            A method, part or option is unknown or out of range, `rng` is no generator.
        """
        if neighbors is not None:
            choices["measurement.neighbors"] = neighbors
        rng = generator(rng)
        usual, own = cells is None, USUAL_CELLS.get(method, 1) if flight.has_images else 1
        cells = whole(own if cells is None else cells, "cells", 1, 8)
        n_textons = whole(n_textons, "n_textons", 1, MAX_TEXTONS)
        patch = whole(patch, "patch", 1, MAX_PATCH)
        parts: dict[str, Any] = compose(method, choices)
        given = flight.position if positions is None else np.ma.asarray(positions, dtype=float)
        given = np.ma.filled(given, np.nan)
        if given.shape != (len(flight), 2):
            raise ParameterError(
                f"positions have shape {given.shape}: "
                f"expected ({len(flight)}, 2), one for each frame"
            )
        known = np.isfinite(given).all(axis=1)
        if known.sum() < 3:
            raise MapError(
                f"flight {flight.name!r} has {known.sum()} frames with a position: "
                "training needs at least 3"
            )
        if cells > 1 and not flight.has_images:
            raise ParameterError(
                f"flight {flight.name!r} came as histograms: there is no image to cut into "
                f"{cells} x {cells} parts, leave cells at 1"
            )
        trained, place, looked = flight.select(known), given[known], flight
        shape = trained.image(0).shape[:2] if flight.has_images else None
        rectified = flight.rectification if flight.has_images else None
        if rectified and shape and rectified.size[::-1] != shape:
            raise MapError(
                f"flight {flight.name!r} has images of {shape[1]}x{shape[0]} pixels, its "
                f"[rectification] makes {rectified.size[0]}x{rectified.size[1]}: import it again"
            )
        if "view" in parts:
            parts["view"] = view = parts["view"].of(trained)
            looked = view.flight(flight)
        if flight.has_images:
            dictionary = dictionary or TextonDictionary.learn(looked, n_textons, patch, rng=rng)
        parameters = {
            "method": method,
            "n_textons": n_textons,
            "patch": patch,
            "cells": cells,
            "positions": positions is not None,
        }
        from trexton.base.records import software_versions  # what training needs, no flight does

        untrained = cls(
            dictionary,
            full_histograms(looked.select(known), dictionary, cells),
            place,
            trained.time,
            flight.area,
            shape,
            float(np.median(np.diff(trained.time))),
            method,
            {},
            {
                "flight": flight.name,
                "data_hash": flight.data_hash,
                "parameters": parameters,
                "versions": software_versions(),
            },
            rectified,
        )
        if usual:
            return untrained._with_parts_or_whole(parts, trained, rng)
        return untrained.with_parts(parts, flight=trained, rng=rng)

    def with_parts(
        self,
        parts: Mapping[str, Part],
        *,
        flight: Flight | None = None,
        rng: np.random.Generator | None = None,
    ) -> TextonMap:
        """This map with other parts, trained on its own training set.

        Parameters
        ----------
        parts : mapping of role to Part
            Those not named stay as they are.
        flight : Flight, optional
            The frames behind the map, for parts that learn from more than histograms.
        rng : numpy.random.Generator, optional
            For parts that draw; a fixed one unless given.

        Raises
        ------
        ParameterError
            Another view than the map's: its histograms were not counted in that; or a part that
            does not fit the others, see `trexton.localization.methods.fitting`.
        """
        own = self.parts.get("view")
        if self.parts and parts.get("view", own) is not own:
            raise ParameterError(
                "the view belongs to the histograms of a map: choose it when training, as in "
                "trexton train FLIGHT --set view=nadir"
            )
        result = replace(self, parts=fitting(self.parts | dict(parts), parts))
        training = result.training(flight=flight, rng=rng)
        fitted = {role: part.fit(training) for role, part in parts.items() if role not in JUDGES}
        result = replace(result, parts=result.parts | fitted)
        for role in JUDGES:  # they judge the method as a whole: what changes it concerns them too
            if role in result.parts and (fitted or role in parts):
                judged = replace(training, texton_map=result)
                judge = result.parts[role].untrained().fit(judged)
                result = replace(result, parts=result.parts | {role: judge})
        return result

    def training(
        self, *, flight: Flight | None = None, rng: np.random.Generator | None = None
    ) -> Training:
        """What the parts learn from; see `with_parts`."""
        return Training(
            self.histograms,
            self.positions,
            self.time,
            self.area,
            self.period_s,
            self.distance,
            self.dictionary,
            flight,
            np.random.default_rng(0) if rng is None else generator(rng),
            cells=self.cells,
        )

    def changed(
        self, choices: Mapping[str, object], *, rng: np.random.Generator | None = None
    ) -> TextonMap:
        """This map with the parts that `choices` name, trained on its own training set; see
        `train`.
        """
        new = changed(self.parts, choices)
        return self.with_parts(new, rng=rng) if new else self

    def for_method(
        self,
        method: str | None,
        *,
        flight: Flight | None = None,
        rng: np.random.Generator | None = None,
    ) -> TextonMap:
        """This map with the parts of another method, trained as by `with_parts`; itself for its
        own, or None.

        Where the flight behind it is given, histograms are counted anew for a method that cuts
        images into other parts, as by `train`. Else they stay as they are, but for those of parts
        as its own method cuts them, which are joined for one that takes whole images.
        """
        if method is None or method == self.method:
            return self
        kept = {role: part for role, part in self.parts.items() if role in ("view", "odometry")}
        parts, own = compose(method), replace(self, method=method, parts=kept)
        cells = USUAL_CELLS.get(method, 1)
        if flight is None or not flight.has_images:
            as_usual = self.cells == USUAL_CELLS.get(self.method, 1)
            own = own.joined() if as_usual and cells < self.cells else own
            return own.with_parts(parts, flight=flight, rng=rng)
        return own.counted(flight, cells)._with_parts_or_whole(parts, flight, rng)

    def _with_parts_or_whole(
        self, parts: Mapping[str, Part], flight: Flight, rng: np.random.Generator | None
    ) -> TextonMap:
        """As `with_parts`, of whole images where the field does not find where their parts look."""
        fitted = self.with_parts(parts, flight=flight, rng=rng)
        offsets = getattr(fitted.parts.get("measurement"), "offsets", None)
        if self.cells == 1 or offsets is None or len(offsets) > 1:
            return fitted
        say("parts of the images show nothing of each other: they are taken as a whole")
        return self.joined().with_parts(parts, flight=flight, rng=rng)

    def joined(self) -> TextonMap:
        """This map with histograms of whole images; its parts stay, see `with_parts`."""
        parts = self.histograms.reshape(len(self.histograms), self.cells**2, -1)
        return self._of(parts.sum(axis=1), 1)

    def _of(self, histograms: np.ndarray, cells: int) -> TextonMap:
        parameters = self.provenance.get("parameters", {}) | {"cells": cells}
        provenance = self.provenance | {"parameters": parameters}
        return replace(self, histograms=histograms, provenance=provenance)

    def counted(self, flight: Flight, cells: int) -> TextonMap:
        """This map with the histograms of so many parts of the image a side, of the `flight` behind
        it; its parts stay as they are: see `with_parts`.

        Raises
        ------
        MapError
            The flight has other frames than the map.
        """
        if cells == self.cells:
            return self
        if len(flight) != len(self.positions):
            raise MapError(
                f"flight {flight.name!r} has {len(flight)} frames, the map "
                f"{len(self.positions)}: give the frames that it was trained on"
            )
        view = self.parts.get("view")
        looked = flight if view is None else view.flight(flight)
        return self._of(full_histograms(looked, self.alphabet, cells), cells)

    def select(self, rows: np.ndarray) -> TextonMap:
        """The map of these rows of the training set only, a mask or indices; its parts stay as they
        learned from all: see `with_parts`.
        """
        return replace(
            self,
            histograms=self.histograms[rows],
            positions=self.positions[rows],
            time=self.time[rows],
        )

    def to_arrays(self) -> dict[str, np.ndarray]:
        """The map as named arrays, the form in which it is stored."""
        return to_arrays(self)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> TextonMap:
        """The map that `to_arrays` described; see `trexton.localization.map_files.from_arrays`."""
        return from_arrays(arrays)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the map as ``.npz``, whole or not at all."""
        content = io.BytesIO()  # a ZipFile on a full disk complains once more when it is dropped
        np.savez(content, **self.to_arrays())  # type: ignore[arg-type]
        with atomic_file(path, "wb") as stream:
            stream.write(content.getbuffer())
        return Path(path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TextonMap:
        """Read a map.

        Raises
        ------
        MapError
            The file is missing, damaged, no map, or of another schema.
        """
        try:
            return cls.from_arrays(read_arrays(path))
        except (MapError, ParameterError) as error:
            raise MapError(f"{path}: {error}") from None
        except FileNotFoundError:
            raise MapError(
                f"{path}: no such map: make one with trexton train FLIGHT -o {path}"
            ) from None
        except DAMAGE as error:
            raise MapError(
                f"{path}: not a whole texton map ({error}): copy or train it again"
            ) from None
