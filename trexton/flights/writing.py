"""A `Flight` is written as a folder that `trexton.flights.folder` reads back to the same bits.

`write_flight` writes it whole or not at all, `write_tables` all but its images.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.files import atomic_folder
from trexton.flights.flight import Flight
from trexton.flights.folder import ANGLES
from trexton.flights.frames import ImageFiles
from trexton.flights.header import FORMAT


def write_flight(flight: Flight, path: str | os.PathLike[str], replace: bool = False) -> Path:
    """Write `flight` as a folder, whole or not at all; images and floor are copied as they are.

    A folder in its place must be empty, unless `replace`. Raises `DataError` where it is not, or
    cannot be written.
    """
    path = Path(path)
    with atomic_folder(path, replace) as folder:
        if (frames := flight.frames) is not None:
            (folder / "images").mkdir()
            for file, name in zip(frames.files, _image_names(frames), strict=True):
                shutil.copyfile(file, folder / "images" / name)
        if flight.floor_file is not None:
            shutil.copyfile(flight.floor_file, folder / flight.floor_file.name)
        write_tables(flight, folder)
    return path


def write_tables(flight: Flight, folder: Path) -> None:
    """Write flight.toml, frames.csv and histograms.csv of `flight` into an existing folder."""
    (folder / "flight.toml").write_text(_header_text(flight), encoding="utf-8")
    x, y = flight.position.T
    columns: dict[str, Any] = {"frame": flight.frame, "t_s": flight.time, "x_m": x, "y_m": y}
    if flight.height is not None:
        columns["z_m"] = flight.height
    if flight.attitude is not None:
        columns |= dict(zip(ANGLES, flight.attitude.T, strict=False))
    if flight.frames is not None:
        columns["image"] = _image_names(flight.frames)
    _write_csv(folder / "frames.csv", columns)
    if flight.histograms is not None:
        names = flight.feature_names or [
            f"t{column}" for column in range(flight.histograms.shape[1])
        ]
        features = dict(zip(names, flight.histograms.T, strict=True))
        _write_csv(folder / "histograms.csv", {"frame": flight.frame, **features})


def _image_names(frames: ImageFiles) -> list[str]:
    names = [file.name for file in frames.files]
    if len(set(names)) == len(set(frames.files)):
        return names
    # Two folders hold files of one name: the second would replace the first.
    return [f"{row:06d}{file.suffix}" for row, file in enumerate(frames.files)]


def _write_csv(path: Path, columns: dict[str, Any]) -> None:
    lists = [np.asarray(values, dtype=object).tolist() for values in columns.values()]
    with open(path, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        # str of a Python float reads back to the same bits
        writer.writerows(zip(*lists, strict=False))


def _header_text(flight: Flight) -> str:
    """``flight.toml`` for `flight`: what JSON writes of texts, numbers and lists is valid TOML."""
    text = partial(json.dumps, ensure_ascii=False)
    tables: dict[str, dict[str, Any]] = {
        "": {
            "format": FORMAT, "name": flight.name, "source": flight.source,
            "licence": flight.licence, "area_m": list(map(float, flight.area)),
        },
        "split": {text(key): list(ends) for key, ends in flight.split.items()},
    }  # fmt: skip
    if flight.features != "textons":
        tables[""]["features"] = flight.features
    if flight.notes:
        tables[""]["notes"] = list(flight.notes)
    if (camera := flight.camera) is not None:
        tables["camera"] = {
            "width_px": camera.width, "height_px": camera.height, "focal_px": float(camera.focal),
            "center_px": list(map(float, camera.principal_point)),
        }  # fmt: skip
    if flight.rectification is not None:
        tables["rectification"] = flight.rectification.table()
    if flight.origin is not None:
        latitude, longitude = map(float, flight.origin)
        tables["origin"] = {"latitude_deg": latitude, "longitude_deg": longitude}
    if flight.floor_file is not None:
        matrix = np.asarray(flight.floor_from_pixel, dtype=float).tolist()
        tables["floor"] = {"image": flight.floor_file.name, "world_from_pixel": matrix}
    lines = []
    for name, table in tables.items():
        lines += ["", f"[{name}]"] if name and table else []
        lines += [f"{key} = {text(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"
