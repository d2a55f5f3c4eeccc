"""Floors that are painted once a run: every process of the tests would paint the same ones anew."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from trexton.base.files import write_file
from trexton.simulator.floor import Floor

__all__ = ["painted_once"]


def _kept(path: Path, make: Callable[[], bytes]) -> bytes:
    if not path.exists():
        write_file(path, make())
    return path.read_bytes()


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
        yield
