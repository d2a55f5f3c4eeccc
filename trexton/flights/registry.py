"""Public data, listed in ``data/registry.toml``. It is never trusted without its SHA-256."""

import hashlib
import os
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from trexton.base.cache import cache_folder, shipped
from trexton.base.errors import DataError
from trexton.base.files import check_not_read, digest, work_folder, write_file
from trexton.base.plugins import resolve
from trexton.base.progress import say
from trexton.flights.writing import write_flight


@cache
def registry() -> dict[str, dict[str, Any]]:
    """Every public data set by name: title, licence, files (key, url, sha256), reader if it is a
    flight.
    """
    return tomllib.loads((shipped("data") / "registry.toml").read_text(encoding="utf-8"))


def data_folder() -> Path:
    """Where raw files are: ``$TREXTON_DATA`` (may be read-only if complete), else ``public`` in the
    cache.
    """
    named = os.environ.get("TREXTON_DATA")
    return Path(named) if named else cache_folder() / "public"


def locate(name: str) -> list[Path]:
    """The raw files of `name` on this machine, downloaded where they are not whole.

    Raises
    ------
    DataError
        There is no such data set, a file has another hash, or cannot be downloaded.
    """
    if name not in registry():
        raise DataError(
            f"no public data set is named {name!r}: the names are {', '.join(registry())}"
        )
    return [_located(file["key"], file) for file in registry()[name]["files"]]


def fetch(name: str, out: str | os.PathLike[str], replace: bool = False) -> Path:
    """Make the data set `name` ready at `out`: a Flight folder, or the file itself where it is no
    flight.
    """
    files, out = locate(name), Path(out)
    if "reader" in registry()[name]:
        check_not_read(out, *files)
        read = resolve("readers", registry()[name]["reader"], {})
        return write_flight(read(*files), out, replace)
    target = out / files[0].name
    if target.exists() and not replace and digest(target) != digest(files[0]):
        raise DataError(f"{target}: another file is there: name another folder, or say --replace")
    write_file(target, files[0].read_bytes())
    return target


def _located(key: str, file: dict[str, Any]) -> Path:
    path = data_folder() / key
    if path.is_file():
        with open(path, "rb") as stream:
            if hashlib.file_digest(stream, "sha256").hexdigest() == file["sha256"]:
                return path
    say(f"fetching {file['url']}")
    import pooch
    import requests

    pooch.get_logger().setLevel("WARNING")
    try:
        with work_folder(path) as parts:
            loader = pooch.HTTPDownloader(timeout=20)
            part = pooch.retrieve(file["url"], file["sha256"], path.name, parts, downloader=loader)
            os.replace(part, path)
    except (requests.RequestException, ValueError) as error:  # ValueError: of another hash
        raise DataError(
            f"{path} is not whole and cannot be fetched from {file['url']} ({error}): try again, "
            "or set TREXTON_DATA to a folder that holds the raw files by their keys"
        ) from None
    return path
