"""Writing goes through one place: to a temporary name first, then renamed, so that nothing is half-written."""

from __future__ import annotations

import glob
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from trexton.errors import TrextonError

__all__ = [
    "atomic_file",
    "atomic_folder",
    "canonical_json",
    "check_replaceable",
    "clean_leftovers",
    "digest",
    "replace_folder",
]


@contextmanager
def atomic_file(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary file beside `path`; rename it to `path` if the block succeeds, delete it otherwise."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    clean_leftovers(path)
    descriptor, temporary = tempfile.mkstemp(prefix=_prefix(path, "new"), dir=path.parent)
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
    try:
        with os.fdopen(descriptor, mode, **text) as stream:
            yield stream
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


@contextmanager
def atomic_folder(path: str | os.PathLike[str], marker: str) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; it replaces `path` if the block succeeds, and vanishes otherwise.

    Only a folder that holds `marker`, or an empty one, is replaced; see `check_replaceable`.
    """
    path = Path(path)
    check_replaceable(path, marker, True)
    clean_leftovers(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=_prefix(path, "new"), dir=path.parent))
    try:
        yield temporary
        os.chmod(temporary, 0o755)
        replace_folder(temporary, path)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def check_replaceable(path: Path, marker: str, allowed: bool) -> None:
    """Refuse to write a folder over something of a person's.

    Raises
    ------
    TrextonError
        `path` is the folder one stands in, a file, or a folder with something in it that lacks `marker`; or it
        is one of ours and replacing it is not `allowed`.
    """
    if path.resolve() in (Path.cwd(), *Path.cwd().parents):
        raise TrextonError(
            f"{path}: a folder cannot replace the one you stand in: name a new folder"
        )
    if path.is_symlink():
        raise TrextonError(f"{path}: is a link: name the folder itself, or a new one")
    if not path.exists():
        return
    if not path.is_dir():
        raise TrextonError(f"{path}: is a file, not a folder: name a new folder, or remove it")
    if not any(path.iterdir()):
        return
    if not (path / marker).is_file():
        raise TrextonError(
            f"{path}: holds files and no {marker}, so it may be yours: name a new folder, or empty it"
        )
    if not allowed:
        raise TrextonError(f"{path}: is there already: name a new folder, or say --replace")


def replace_folder(new: Path, path: Path) -> None:
    """Put the folder `new` in the place of `path`, which is moved aside first and then removed."""
    if path.exists():
        old = Path(tempfile.mkdtemp(prefix=_prefix(path, "old"), dir=path.parent))
        os.replace(path, old / "was")
        os.replace(new, path)
        shutil.rmtree(old)
    else:
        os.replace(new, path)


def clean_leftovers(path: Path) -> None:
    """Remove what a run that was killed left beside `path`; put back what it had moved aside."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*-*.*"):
        kind, _, process = left.name[len(path.name) + 2 :].partition(".")[0].partition("-")
        if kind not in ("new", "old") or not process.isdigit() or _alive(int(process)):
            continue
        if kind == "old" and (left / "was").exists() and not path.exists():
            os.replace(left / "was", path)
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def _prefix(path: Path, kind: str) -> str:
    """Names the process, so that what a killed one left can be told from what another is writing."""
    return f".{path.name}.{kind}-{os.getpid()}."


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # another person's
    return True


def canonical_json(value: object) -> str:
    """JSON with sorted keys and full float precision: equal values give equal bytes."""
    return json.dumps(value, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def digest(*parts: object) -> str:
    """SHA-256 (hex) of arrays, bytes, files (as `Path`) and JSON values; type and shape count."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            head, body = (
                f"array {part.dtype.str} {part.shape}",
                np.ascontiguousarray(part).tobytes(),
            )
        elif isinstance(part, bytes):
            head, body = "bytes", part
        elif isinstance(part, Path):
            head, body = "file", part.read_bytes()
        else:
            head, body = "json", canonical_json(part).encode()
        total.update(f"{head} {len(body)}\n".encode())
        total.update(body)
    return total.hexdigest()
