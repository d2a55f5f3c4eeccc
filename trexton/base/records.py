"""What an experiment returns: one frozen record, written as JSON with its pictures beside it.

Equal inputs give equal bytes, except under ``timings``: what depends on the clock belongs there.

A number with its 95 % interval is an entry, ``{"value": 45.1, "low": 40.2, "high": 51.0}``: it says
``value`` whichever statistic it is, for the key that holds it tells that, as ``mean_cm``. An end of
which nothing is known is None; counts such as ``trials`` may stand beside. What says ``median`` is
one: among several statistics of one sample (``median``, ``p95``), in bands that figures draw, and
under ``timings``, where ``low`` and ``high`` are of medians over stretches.
"""

from __future__ import annotations

import hashlib
import json
import platform
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.arrays import DAMAGE
from trexton.base.errors import DataError, TrextonError
from trexton.base.files import canonical_json, read_bytes, write_file

SCHEMA = 2
MOST_TEXT = 2**25  # bytes: so much has the report of a flight of 100,000 frames
MOST_LISTS = 2**20  # of lists and sections, which take far more memory than text
SECTIONS = ("parameters", "values", "series", "timings", "provenance")
KINDS: dict[str, type] = {"experiment": str, "flight": str, **dict.fromkeys(SECTIONS, dict)}
_PACKAGES = ("trexton", "numpy", "scipy", "numba", "opencv-python-headless", "matplotlib", "pandas")


def plain(value: object) -> object:
    """Arrays and NumPy scalars as JSON values; NaN and infinities become None."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def software_versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    versions = {"python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


@dataclass(frozen=True, eq=False)
class Record:
    """The result of one experiment on one flight.

    Attributes
    ----------
    parameters : dict
        Everything that was chosen, seed included.
    values : dict
        Reproducible results, nested, in SI units unless the key's suffix says otherwise (``_cm``).
    series : dict
        Arrays that figures draw (lists in the file).
    images : dict of str to (H, W[, 3]) uint8 array
        Pictures (BGR), written as PNG files beside the record.
    timings : dict
        What depends on the clock and the machine.
    provenance : dict
        Data hashes and versions.
    """

    experiment: str
    flight: str
    parameters: dict[str, Any]
    values: dict[str, Any]
    series: dict[str, Any] = field(default_factory=dict)
    images: dict[str, np.ndarray] = field(default_factory=dict)
    timings: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    schema: int = SCHEMA

    def __post_init__(self) -> None:
        for name in SECTIONS:
            object.__setattr__(self, name, plain(getattr(self, name)))

    def save(self, folder: str | Path) -> Path:
        """Write ``<experiment>.json`` and its pictures into `folder`; the path of the JSON file."""
        import cv2

        folder, pictures = Path(folder), {}
        for name, image in self.images.items():
            data = cv2.imencode(".png", image)[1].tobytes()
            file = f"{self.experiment}-{name}.png"
            write_file(folder / file, data)
            pictures[name] = {"file": file, "sha256": hashlib.sha256(data).hexdigest()}
        path = folder / f"{self.experiment}.json"
        write_file(path, canonical_json(vars(self) | {"images": pictures}))
        return path

    @classmethod
    def load(cls, path: str | Path) -> Record:
        """Read a record and its pictures; raises `TrextonError` where the file is missing, damaged
        or of another schema.
        """
        import cv2

        from trexton.base.pictures import MOST_BYTES, decode

        path, room = Path(path), MOST_BYTES
        try:
            text = read_bytes(path, MOST_TEXT, "a record", DataError)
            if text.count(b"[") + text.count(b"{") > MOST_LISTS:
                raise ValueError(f"it holds more than {MOST_LISTS:,} lists")
            content = json.loads(text)
            if (schema := content["schema"]) != SCHEMA:
                advice = "update trexton" if schema > SCHEMA else "run it again"
                raise TrextonError(f"{path}: record schema {schema}, expected {SCHEMA}: {advice}")
            for key, kind in KINDS.items():
                if not isinstance(found := content.get(key, kind()), kind):
                    raise ValueError(f"its {key} is a {type(found).__name__}")
            pictures = content.pop("images")
            record = cls(**content)
            for name, entry in pictures.items():
                # Beside the record, and the one that was written: nothing else is opened.
                file = path.parent / Path(entry["file"]).name
                data = read_bytes(file, MOST_BYTES, "a picture", DataError)
                if hashlib.sha256(data).hexdigest() != entry["sha256"]:
                    raise ValueError(f"its picture {entry['file']} is another one")
                picture = decode(data, cv2.IMREAD_UNCHANGED)
                if picture is None:
                    raise ValueError(f"its picture {entry['file']} is damaged")
                room -= picture.nbytes
                if room < 0:
                    raise ValueError(f"its pictures unpack to more than {MOST_BYTES:,} bytes")
                record.images[name] = picture
        except DAMAGE as error:
            raise TrextonError(
                f"{path}: not a readable record ({error}): run its experiment again"
            ) from None
        return record
