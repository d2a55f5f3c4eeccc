"""How mats lie in the virtual hall: floors to try a method on that it was not built on.

A layout is a list of `Placement`; some repeat one motif, which misleads a localizer that sees only
that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from trexton.base.errors import ParameterError

__all__ = ["HALL", "LAYOUTS", "Placement", "layout"]


@dataclass(frozen=True)
class Placement:
    """One mat: its print, centre and size in metres.

    Attributes
    ----------
    print_seed : int or None
        Mats of one seed and size show the same print to the pixel; None paints a new one.
    """

    mat: str
    x: float
    y: float
    width: float
    height: float
    print_seed: int | None = None


HALL = (
    Placement("rug", 0.98, 4.12, 1.50, 1.20),
    Placement("waves", 2.62, 4.22, 1.30, 1.05),
    Placement("town", 4.17, 3.93, 1.35, 1.50),
    Placement("tiles", 0.80, 2.42, 1.15, 1.30),
    Placement("bauhaus", 4.24, 2.16, 1.15, 1.25),
    Placement("puzzle", 0.96, 0.84, 1.50, 1.20),
    Placement("leaves", 2.66, 0.80, 1.30, 1.15),
    Placement("terrazzo", 4.26, 0.74, 1.20, 1.00),
)


def _hall(rng: np.random.Generator) -> tuple[Placement, ...]:
    return HALL


def _moved(rng: np.random.Generator) -> tuple[Placement, ...]:
    """The eight mats, each in the place of another."""
    order = rng.permutation(len(HALL))
    return tuple(
        replace(place, mat=HALL[other].mat) for place, other in zip(HALL, order, strict=True)
    )


def _repeats(rng: np.random.Generator) -> tuple[Placement, ...]:
    """Two prints, each laid four times, equal to the pixel."""
    names = rng.choice([place.mat for place in HALL], 2, replace=False)
    return tuple(
        replace(place, mat=str(names[i % 2]), width=1.2, height=1.0, print_seed=int(i % 2))
        for i, place in enumerate(HALL)
    )


def _few(rng: np.random.Generator) -> tuple[Placement, ...]:
    """Two mats on bare boards."""
    return tuple(HALL[i] for i in sorted(rng.choice(len(HALL), 2, replace=False)))


def _carpet(rng: np.random.Generator) -> tuple[Placement, ...]:
    """One print from wall to wall."""
    return (Placement(HALL[int(rng.integers(len(HALL)))].mat, 2.5, 2.5, 4.9, 4.9),)


LAYOUTS: dict[str, Callable[[np.random.Generator], tuple[Placement, ...]]] = {
    "hall": _hall,
    "moved": _moved,
    "repeats": _repeats,
    "few": _few,
    "carpet": _carpet,
}


def layout(name: str, rng: np.random.Generator) -> tuple[Placement, ...]:
    """The placements of the layout `name`.

    Raises
    ------
    ParameterError
        There is no such layout.
    """
    if name not in LAYOUTS:
        raise ParameterError(f"layout {name!r} is unknown: choose one of {', '.join(LAYOUTS)}")
    return LAYOUTS[name](rng)
