"""Training: a flight becomes a map, and parts of a map are trained anew on its training set.

`full_histograms` keeps its counts in the cache, so that the next training on these frames has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from trexton.base.defaults import PATCH, TEXTONS, USUAL_CELLS
from trexton.base.errors import MapError, ParameterError
from trexton.base.options import whole
from trexton.base.progress import progress, say
from trexton.base.streams import generator
from trexton.localization.base import Part
from trexton.localization.methods import changed, compose, fitting
from trexton.localization.texton_map import TextonMap
from trexton.localization.training_set import training_set
from trexton.vision.histograms import label_image
from trexton.vision.textons import MAX_PATCH, MAX_TEXTONS, TextonDictionary
from trexton.vision.threads import ahead

if TYPE_CHECKING:
    from trexton.flights.flight import Flight

KEPT_FROM = 250  # frames; shorter flights are counted in a second or two
_PARTS = 2  # a side: images are counted in quarters, whose sum serves methods that take the whole


def train_map(
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
        Parts of the image along each side, each with a histogram of its own. The method's own
        unless given (`trexton.base.defaults.USUAL_CELLS`), or 1 where these show nothing of what
        others show.
    neighbors : int, optional
        Short for the choice ``measurement.neighbors``.
    rng : numpy.random.Generator
    dictionary, positions : TextonDictionary, (N, 2) array, optional
        Instead of what is learned from the images, and of the flight's ground truth; frames with
        NaN do not train.
    **choices
        ``role``: a part, or its name; ``role.option``: a value. They replace the method's own.

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
    usual = USUAL_CELLS.get(method, 1) if flight.has_images else 1
    parameters: dict[str, Any] = {
        "method": method,
        "n_textons": whole(n_textons, "n_textons", 1, MAX_TEXTONS),
        "patch": whole(patch, "patch", 1, MAX_PATCH),
        "cells": whole(usual if cells is None else cells, "cells", 1, 8),
        "positions": positions is not None,
    }
    parts = compose(method, choices)
    place = _positions(flight, positions)
    trained = flight.select(located := np.isfinite(place).all(axis=1))
    untrained = _without_parts(flight, trained, place[located], dictionary, parameters, rng)
    train = with_parts if cells is not None else _with_parts_or_whole
    return train(untrained, parts, flight=trained, rng=rng)


def _without_parts(
    flight: Flight,
    trained: Flight,
    place: np.ndarray,
    dictionary: TextonDictionary | None,
    parameters: dict[str, Any],
    rng: np.random.Generator,
) -> TextonMap:
    """The training set of a map, and where it comes from, before any part has learned from it."""
    shape, rectified, cells = None, None, parameters["cells"]
    names = {}
    if flight.has_images:
        shape, rectified = trained.image(0).shape[:2], flight.rectification
        if rectified and rectified.size[::-1] != shape:
            raise MapError(
                f"flight {flight.name!r} has images of {shape[1]}x{shape[0]} pixels, its "
                f"[rectification] makes {rectified.size[0]}x{rectified.size[1]}: import it again"
            )
        size = parameters["n_textons"], parameters["patch"]
        dictionary = dictionary or TextonDictionary.learn(flight, *size, rng=rng)
    elif cells > 1:
        raise ParameterError(
            f"flight {flight.name!r} came as histograms: there is no image to cut into "
            f"{cells} x {cells} parts, leave cells at 1"
        )
    elif flight.feature_names:
        names = {"features": list(flight.feature_names)}
    from trexton.base.records import software_versions  # what training needs, no flight does

    provenance = {
        "flight": flight.name, "data_hash": flight.data_hash, "parameters": parameters,
        "versions": software_versions(), **names,
    }  # fmt: skip
    return TextonMap(
        dictionary,
        full_histograms(trained, dictionary, cells),
        place,
        trained.time,
        flight.area,
        shape,
        float(np.median(np.diff(trained.time))),
        parameters["method"],
        {},
        provenance,
        rectified,
    )


def _positions(flight: Flight, given: np.ndarray | None) -> np.ndarray:
    """``(N, 2)``: the flight's own unless `given`, NaN where a frame does not train."""
    position = flight.position if given is None else np.ma.asarray(given, dtype=float)
    place = np.ma.filled(position, np.nan)
    if place.shape != (len(flight), 2):
        raise ParameterError(
            f"positions have shape {place.shape}: expected ({len(flight)}, 2), one for each frame"
        )
    known = np.isfinite(place).all(axis=1).sum()
    if known < 3:
        raise MapError(
            f"flight {flight.name!r} has {known} frames with a position: training needs at least 3"
        )
    low, high = np.reshape(flight.area, (2, 2)).T
    inside = ((place >= low - flight.diagonal) & (place <= high + flight.diagonal)).all(axis=1)
    if inside.sum() < known / 2:
        raise MapError(
            f"flight {flight.name!r} has {known - inside.sum()} of {known} positions far from its "
            "area_m: correct them, or area_m"
        )
    return place


def with_parts(
    texton_map: TextonMap,
    parts: Mapping[str, Part],
    *,
    flight: Flight | None = None,
    rng: np.random.Generator | None = None,
) -> TextonMap:
    """A map with other parts, trained on its own training set; those not named stay.

    Parameters
    ----------
    texton_map : TextonMap
    parts : mapping of role to Part
    flight : Flight, optional
        The frames behind the map, for parts that learn from more than histograms.
    rng : numpy.random.Generator, optional
        For parts that draw; a fixed one unless given.

    Raises
    ------
    ParameterError
        A part does not fit the others, see `trexton.localization.methods.fitting`.
    """
    result = replace(texton_map, parts=fitting(texton_map.parts | dict(parts), parts))
    training = training_set(result, flight=flight, rng=rng)
    fitted = {role: part.fit(training) for role, part in parts.items()}
    return replace(result, parts=result.parts | fitted)


def with_choices(
    texton_map: TextonMap, choices: Mapping[str, object], *, rng: np.random.Generator | None = None
) -> TextonMap:
    """A map with the parts that `choices` name, trained on its own training set. Raises
    `ParameterError` or `MapError` where one does not fit, or the map lacks what it learns from.

    Parameters
    ----------
    choices : mapping
        ``role``: a part, or its name; ``role.option``: a value.
    rng : numpy.random.Generator, optional
        For parts that draw what they learn.
    """
    new = changed(texton_map.parts, choices)
    return with_parts(texton_map, new, rng=rng) if new else texton_map


def for_method(
    texton_map: TextonMap,
    method: str | None,
    *,
    flight: Flight | None = None,
    rng: np.random.Generator | None = None,
) -> TextonMap:
    """A map with the parts of another method, trained as by `with_parts`; itself for its
    own, or None.

    Where the flight behind it is given, histograms are counted anew for a method that cuts
    images into other parts, as by `train`. Else they stay as they are, but for those of parts
    as its own method cuts them, which are joined for one that takes whole images.
    """
    if method is None or method == texton_map.method:
        return texton_map
    kept = {role: part for role, part in texton_map.parts.items() if role == "odometry"}
    parts, own = compose(method), replace(texton_map, method=method, parts=kept)
    cells = USUAL_CELLS.get(method, 1)
    if flight is None or not flight.has_images:
        as_usual = texton_map.cells == USUAL_CELLS.get(texton_map.method, 1)
        own = own.joined() if as_usual and cells < texton_map.cells else own
        return with_parts(own, parts, flight=flight, rng=rng)
    if cells != own.cells:
        if len(flight) != len(own.positions):
            raise MapError(
                f"flight {flight.name!r} has {len(flight)} frames, the map {len(own.positions)}: "
                "give the frames that it was trained on"
            )
        own = own.with_histograms(full_histograms(flight, own.alphabet, cells), cells)
    return _with_parts_or_whole(own, parts, flight, rng)


def _with_parts_or_whole(
    texton_map: TextonMap,
    parts: Mapping[str, Part],
    flight: Flight,
    rng: np.random.Generator | None,
) -> TextonMap:
    """As `with_parts`, of whole images where the field does not find where their parts look."""
    fitted = with_parts(texton_map, parts, flight=flight, rng=rng)
    offsets = getattr(fitted.parts.get("measurement"), "offsets", None)
    if texton_map.cells == 1 or offsets is None or len(offsets) > 1:
        return fitted
    say("parts of the images show nothing of each other: they are taken as a whole")
    return with_parts(texton_map.joined(), parts, flight=flight, rng=rng)


def full_histograms(
    flight: Flight, dictionary: TextonDictionary | None, cells: int = 1
) -> np.ndarray:
    """``(N, K)`` histograms of a flight: full sampling of its images, or those that it brings.

    Raises
    ------
    MapError
        The flight has neither.
    """
    if dictionary is None or not flight.has_images:
        if flight.histograms is None:
            raise MapError(f"flight {flight.name!r} has no histograms: give a dictionary")
        return flight.histograms
    counts = _counts(flight, dictionary, _PARTS if cells == 1 else cells)
    if cells == 1:
        counts = counts.reshape(len(flight), _PARTS**2, -1).sum(axis=1)
    return counts / counts.sum(axis=1, keepdims=True)


def _counts(flight: Flight, dictionary: TextonDictionary, cells: int) -> np.ndarray:
    """``(N, K cells^2) int32``"""

    def compute() -> dict[str, np.ndarray]:
        images = progress(flight.images(), "histograms", total=len(flight))
        labelled = ahead(partial(label_image, dictionary=dictionary, cells=cells), images)
        return {"counts": np.stack([counts for _, counts in labelled]).astype(np.int32)}

    if len(flight) < KEPT_FROM:
        return compute()["counts"]
    from trexton.base.cache import cached  # which an onboard computer never needs

    assert flight.frames is not None  # only images are counted
    inputs = {
        "frames": flight.frames.digest,
        "textons": [dictionary.textons.shape, dictionary.textons.tobytes().hex()],
        "cells": cells,
    }
    return cached("counts", "trexton.vision.histograms", inputs, compute)["counts"]
