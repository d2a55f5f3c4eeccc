"""A map is a file of arrays, read without trust: sizes first, then all that flight needs. Offers
`save_map`, `load_map` and their halves without a file."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.arrays import DAMAGE, read_arrays
from trexton.base.errors import DataError, MapError, ParameterError
from trexton.localization.base import Part
from trexton.localization.methods import fitting, name_of, part_class
from trexton.localization.texton_map import TextonMap
from trexton.vision.images import position_grid
from trexton.vision.textons import TextonDictionary

SCHEMA, READ = 3, (2, 3)  # written; and read


def save_map(texton_map: TextonMap, path: str | os.PathLike[str]) -> Path:
    """Write a map as ``.npz``, whole or not at all; `MapError` as of `check_map`."""
    from trexton.base.files import write_file  # as a flight only reads

    check_map(texton_map)
    content = io.BytesIO()  # a ZipFile on a full disk complains once more when it is dropped
    np.savez_compressed(content, **_counted(texton_map))  # type: ignore[arg-type]
    write_file(path, content.getvalue())
    return Path(path)


def check_map_or_new(path: str | os.PathLike[str]) -> None:
    """Refuse to replace a file that holds something, but is no map, by a `ParameterError`."""
    if not os.path.isfile(path) or os.path.getsize(path) == 0:
        return
    if not zipfile.is_zipfile(path) or "schema.npy" not in zipfile.ZipFile(path).namelist():
        raise ParameterError(f"{path}: is a file that is no map: give another name")


def load_map(path: str | os.PathLike[str]) -> TextonMap:
    """Read a map.

    Raises
    ------
    MapError
        The file is missing, damaged, no map, or of another schema.
    """
    try:
        return from_arrays(read_arrays(path))
    except (DataError, MapError, ParameterError) as error:
        raise MapError(f"{path}: {error}") from None
    except FileNotFoundError:
        words = f"{path}: no such map: make one with trexton train FLIGHT -o {path}"
        raise MapError(words) from None
    except DAMAGE as error:
        words = f"{path}: not a whole texton map ({error}): copy or train it again"
        raise MapError(words) from None


def _counted(texton_map: TextonMap) -> dict[str, np.ndarray]:
    """The arrays to store: frequencies as the counts that they are of, which take less room."""
    arrays, shape = to_arrays(texton_map), texton_map.image_shape
    if texton_map.dictionary is not None and shape is not None:
        size = np.prod(position_grid(shape, texton_map.dictionary.patch))
        counts = np.rint(arrays["histograms"] * size).astype(np.uint32)
        if np.array_equal(_frequencies(counts), arrays["histograms"]):
            arrays["counts"] = counts
            del arrays["histograms"]
    return arrays


def _frequencies(counts: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):  # refused by `check_map`
        return np.asarray(counts / counts.sum(axis=1, keepdims=True))


def to_arrays(texton_map: TextonMap) -> dict[str, np.ndarray]:
    """A map as named arrays, the form in which it is stored."""
    from trexton.base.files import canonical_json

    header = {
        "method": texton_map.method,
        "parts": {
            role: {"name": name_of(role, part), "options": part.as_dict()}
            for role, part in texton_map.parts.items()
        },
        "provenance": texton_map.provenance,
    }
    if texton_map.rectification is not None:
        header["rectification"] = texton_map.rectification.table()
    arrays = {
        "schema": np.asarray(SCHEMA),
        "histograms": texton_map.histograms,
        "positions": texton_map.positions,
        "time": texton_map.time,
        "area": np.asarray(texton_map.area, dtype=float),
        "period_s": np.asarray(texton_map.period_s),
        "header": np.frombuffer(canonical_json(header).encode(), np.uint8),
    }
    if texton_map.image_shape is not None:
        arrays["image_shape"] = np.asarray(texton_map.image_shape, dtype=np.int64)
    if texton_map.dictionary is not None:
        arrays["textons"] = texton_map.dictionary.textons
    for role, part in texton_map.parts.items():
        arrays |= {f"{role}.{name}": array for name, array in part.arrays().items()}
    return arrays


def from_arrays(arrays: Mapping[str, np.ndarray]) -> TextonMap:
    """The map that `to_arrays` described.

    Raises
    ------
    MapError
        It has another schema, or values that no training gives.
    KeyError
        An array is missing.
    """
    schema = int(arrays["schema"])
    if schema not in READ:
        advice = "is newer, update trexton" if schema > SCHEMA else "is older, train it again"
        raise MapError(f"map schema {schema}, expected {SCHEMA}: it {advice}")
    header = json.loads(arrays["header"].tobytes())
    if gone := {"calibration", "integrity", "view"} & header["parts"].keys():
        raise MapError(
            f"the map has a part for {' and '.join(sorted(gone))}, as method guarded or "
            "view=nadir had: these are gone, train it again with trexton train --method field"
        )
    if (rectified := header.get("rectification")) is not None:
        from trexton.vision.camera import Rectification

        rectified = Rectification.from_table(rectified)
    whole = TextonMap(
        TextonDictionary(arrays["textons"]) if "textons" in arrays else None,
        _frequencies(arrays["counts"]) if "counts" in arrays else arrays["histograms"],
        arrays["positions"],
        arrays["time"],
        tuple(arrays["area"].tolist()),
        tuple(arrays["image_shape"].tolist()) if "image_shape" in arrays else None,
        float(arrays["period_s"]),
        header["method"],
        # Maps of earlier versions hold parts that nothing reads.
        fitting({role: _part(role, entry, arrays) for role, entry in header["parts"].items()}),
        header["provenance"],
        rectified,
    )
    check_map(whole)
    return whole


def _part(role: str, entry: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Part:
    own = f"{role}."
    mine = {name.removeprefix(own): each for name, each in arrays.items() if name.startswith(own)}
    kind = part_class(role, entry["name"], imports=False)
    return kind.from_arrays(mine, **entry["options"])


def check_map(texton_map: TextonMap) -> None:
    """Refuse a map with values that no training gives.

    Raises
    ------
    MapError
        The first thing that is wrong.
    """
    for holds, what, value in _demands(texton_map):
        if not holds:
            if isinstance(value, np.ndarray):
                value = f"{value.dtype} of shape {value.shape}"
            raise MapError(f"in a map {what}, found {value}: copy or train it again")


def _demands(whole: TextonMap) -> Iterator[tuple[bool, str, object]]:
    """What must hold, in words, and what is found; later ones rely on those before."""
    histograms, positions, time, shape = (
        whole.histograms, whole.positions, whole.time, whole.image_shape
    )  # fmt: skip
    table = _real(histograms) and histograms.ndim == 2 and histograms.shape[0] > 0
    yield table, "histograms are finite (N, K) numbers", histograms
    count, width = histograms.shape
    placed = _real(positions) and positions.shape == (count, 2)
    yield placed, f"positions are finite ({count}, 2) metres", positions
    rising = _real(time) and time.shape == (count,) and bool((np.diff(time) > 0).all())
    yield rising, f"stamps are {count} rising seconds", time
    x_min, x_max, y_min, y_max = (float(value) for value in whole.area)
    real = bool(np.isfinite(whole.area).all()) and x_min < x_max and y_min < y_max
    yield real, "the area is x_min < x_max, y_min < y_max in metres", whole.area
    yield 0 < whole.period_s < np.inf, "the period is positive", whole.period_s
    if shape is not None:
        sizes = len(shape) == 2 and all(isinstance(n, int) and 0 < n < 2**16 for n in shape)
        yield sizes, "the images have (rows, columns)", shape
    if whole.rectification is not None:
        size = whole.rectification.size
        yield size[::-1] == shape, "images are rectified to their size", size
    if whole.dictionary is not None:  # other features may be negative
        yield bool((histograms >= 0).all()), "histograms are not negative", histograms
        textons = len(whole.dictionary.textons)
        what = f"histograms have one column a texton and part of the image, here {width}"
        yield textons * whole.cells**2 == width, what, textons
        yield shape is not None, "images have a shape", None
    yield isinstance(whole.method, str), "a method has a name", whole.method
    names = whole.feature_names
    named = isinstance(names, list) and len(names) in (0, width)
    yield named, f"features have {width} names, or none", names
    if "measurement" in whole.parts:
        yield whole.neighbors <= count, f"neighbours are at most {count}", whole.neighbors
    for role, part in whole.parts.items():
        fits = part.width in (None, width)
        yield fits, f"a {role}'s axes are those of {width} features", part.width


def _real(array: np.ndarray) -> bool:
    return array.dtype.kind == "f" and bool(np.isfinite(array).all())
