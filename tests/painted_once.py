"""Floors that are painted once a run, and maps that are trained once: every process of the tests
would make the same ones anew.
"""

from __future__ import annotations

import fcntl
import hashlib
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trexton.base.files import write_file
from trexton.simulator.floor import Floor

__all__ = ["once", "painted_once"]

_folders: list[Path] = []  # of this run; none where no test runs


def _kept(path: Path, make: Callable[[], bytes]) -> bytes:
    if not path.exists():
        with open(path.with_suffix(".lock"), "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # whoever comes meanwhile waits for it
            if not path.exists():
                write_file(path, make())
    return path.read_bytes()


def once(make: Callable[[], Any]) -> Callable[[], Any]:
    """What a function makes, kept beside the floors under its name."""

    def kept() -> Any:
        if not _folders:
            return make()
        place = _folders[-1] / f"{make.__name__}.pickle"
        return pickle.loads(_kept(place, lambda: pickle.dumps(make())))

    return lru_cache(kept)


@contextmanager
def painted_once(folder: Path) -> Iterator[None]:
    """Painted floors, and the PNG files of all floors, are kept in `folder` while this lasts."""
    paint, encode = Floor.painted.__wrapped__, Floor.png.__wrapped__

    def painted(layout: str = "hall", seed: int = 0) -> Floor:
        place = folder / f"{layout}-{seed}.pickle"
        return pickle.loads(_kept(place, lambda: pickle.dumps(paint(layout, seed))))

    def png(floor: Floor) -> bytes:
        image, mask = floor.picture.image, floor.picture.mask
        shown = hashlib.blake2b(repr((image.shape, mask is None)).encode())
        for part in (image, mask):
            shown.update(b"" if part is None else np.ascontiguousarray(part))
        return _kept(folder / f"{shown.hexdigest()[:32]}.png", lambda: encode(floor))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Floor, "painted", staticmethod(lru_cache(maxsize=2)(painted)))
        patch.setattr(Floor, "png", lru_cache(maxsize=2)(png))
        _folders.append(folder)
        yield
    _folders.pop()
