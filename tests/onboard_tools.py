"""A small colourful room in which a small camera knows where it is, and what else the onboard tests
share.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from painted_once import once
from small_room import random_walk

from trexton.flights.flight import Flight
from trexton.localization.localizer import Estimate, TextonMap
from trexton.localization.training import train_map
from trexton.onboard.fix import Fix, LocalFrame
from trexton.onboard.settings import MavlinkOptions
from trexton.onboard.sinks import Surroundings
from trexton.onboard.tally import Tally
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera, MapImage

CAMERA = Camera(128, 96, 104.0)
AREA = (0.0, 4.0, 0.0, 4.0)


@lru_cache
def colourful_floor() -> Floor:
    """A floor of 4 m x 4 m whose colours change slowly and never the same way twice."""
    rng = np.random.default_rng(3)
    coarse = cv2.resize(
        rng.uniform(30, 225, (7, 7, 3)).astype(np.float32),
        (400, 400),
        interpolation=cv2.INTER_CUBIC,
    )
    grain = rng.normal(0, 12, (400, 400, 1))
    picture = np.clip(coarse + grain, 0, 255).astype(np.uint8)
    return Floor(MapImage.from_extent(picture, AREA[0], AREA[3], 100.0))


@lru_cache
def narrow_floor() -> Floor:
    """The same picture, 2.4 m wide: a short flight shows all of it."""
    image = colourful_floor().picture.image
    return Floor(MapImage.from_extent(image, 0.0, 2.4, len(image) / 2.4))


def colourful_flight(folder: Path, frames: int = 60) -> Flight:
    """A survey of that floor, with attitude and height."""
    return record_flight(folder, frames=frames, every=5, camera=CAMERA, floor=colourful_floor())


def room(seed: int = 1, **options) -> Simulator:
    """The virtual room over that floor."""
    return Simulator(colourful_floor(), camera=CAMERA, rng=np.random.default_rng(seed), **options)


@once
def room_map() -> TextonMap:
    """A map of the room, from a survey of 200 frames."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        flight = record_flight(
            f"{folder}/survey", frames=200, every=4, seed=1, camera=CAMERA, floor=colourful_floor()
        )
        texton_map = train_map(flight, n_textons=16, rng=np.random.default_rng(1))
    # The survey was thinned out: a live camera gives four frames where it kept one.
    walk = random_walk(texton_map.parts["motion"].covariance / 4, 0.08)
    return replace(texton_map, period_s=0.08, parts=texton_map.parts | {"motion": walk})


@once
def field_map() -> TextonMap:
    """A map of the room for method ``field``, from a survey at the rate of a live camera."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        flight = record_flight(
            f"{folder}/survey", frames=500, seed=1, camera=CAMERA, floor=colourful_floor()
        )
        return train_map(
            flight, method="field", n_textons=16, rng=np.random.default_rng(1),
            **{"motion.agility": 1.0},
        )  # fmt: skip


def make_fix(
    time: float = 1.0, position=(0.0, 0.0), covariance=((0.04, 0.0), (0.0, 0.09)), **more
) -> Fix:
    """A usable fix, unless told otherwise."""
    covariance = np.array(covariance, dtype=float)
    fields = {
        "number": 1,
        "spread": np.sqrt(np.diagonal(covariance)),
        "lost": False,
        "observed": True,
        **more,
    }
    return Fix(time=time, position=np.array(position, dtype=float), covariance=covariance, **fields)


def make_estimate(position=(0.0, 0.0), spread=(0.1, 0.1), lost=False, observed=True) -> Estimate:
    """An estimate whose four particles have that mean and spread."""
    position, spread = np.array(position, dtype=float), np.array(spread, dtype=float)
    particles = position + spread * [[1, 1], [1, -1], [-1, 1], [-1, -1]]
    return Estimate(
        position,
        np.diag(spread**2),
        lost,
        observed,
        particles=particles,
        weights=np.full(4, 0.25),
    )


def surroundings(tally: Tally | None = None, **changes) -> Surroundings:
    """What a sink is told of a map of 5 m x 5 m that lies with its +y to the north."""
    fields = {
        "local": LocalFrame(0.0, 1.0), "area": (0.0, 5.0, 0.0, 5.0),
        "motion_rate": 0.01 * np.eye(2), "tally": tally or Tally(),
    }  # fmt: skip
    return Surroundings(**fields | changes)


def mavlink(**changes) -> dict:
    """Options of the MAVLink sink, as `open_sink` takes them."""
    return {MavlinkOptions: MavlinkOptions(**changes)}


@dataclass
class Clock:
    """A clock that tests set."""

    now: float = 100.0

    def __call__(self) -> float:
        return self.now

    monotonic = __call__  # for who asks the module

    def sleep(self, seconds: float) -> None:
        self.now += seconds
