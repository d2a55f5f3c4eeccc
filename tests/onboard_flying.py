"""Maps, recordings and localizers for tests of the onboard loop, and a way to fly them."""

from __future__ import annotations

import threading
import time
from functools import lru_cache

import numpy as np
from onboard_tools import AREA, room, room_map

from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import train_map
from trexton.onboard.fix import Fix
from trexton.onboard.loop import Onboard
from trexton.onboard.sinks import Guard, Sink
from trexton.onboard.sources import Frame, Source
from trexton.onboard.tally import Tally
from trexton.simulator.recording import Plan, random_waypoints


class Kept(Sink):
    """Keeps the fixes."""

    def __init__(self):
        self.fixes: list[Fix] = []

    def open(self): ...

    def write(self, fix):
        self.fixes.append(fix)


def run(
    localizer: Localizer,
    source: Source,
    stop: threading.Event | None = None,
    sink: Sink | None = None,
    **options,
):
    """The fixes, the tally and the summary of a run to the source's end."""
    tally, kept = Tally(), sink or Kept()
    if not source.live:
        options.setdefault("rate", 0.1)  # a busy machine must not make a frame late here
    summary = Onboard(localizer, source, [Guard(kept, tally)], tally=tally, **options).run(
        stop or threading.Event()
    )
    return getattr(kept, "fixes", None), tally, summary


def histogram_map(flight: Flight) -> TextonMap:
    return train_map(flight.part("train"), neighbors=3, rng=np.random.default_rng(1))


def room_localizer(**options) -> Localizer:
    return Localizer(room_map(), rng=np.random.default_rng(4), **options)


class Film(Source):
    """A recording of given pictures, 0.08 s apart."""

    live = False

    def __init__(self, pictures, period=0.08):
        self.pictures, self.period, self.index = list(pictures), period, 0

    def open(self): ...

    def read(self):
        if self.index == len(self.pictures):
            return None
        self.index += 1
        return Frame((self.index - 1) * self.period, self.pictures[self.index - 1])


@lru_cache
def filmed() -> list[np.ndarray]:
    """Forty frames of a flight in the small room."""
    simulator, plan = room(6), Plan(random_waypoints(AREA, np.random.default_rng(6)))
    pictures = []
    for _ in range(40):
        simulator.step(plan.goal(simulator.state.position))
        pictures.append(simulator.render())
    return pictures


class Live(Source):
    """A live camera on a script: a picture, an error to raise, or something to be done before the
    next of them."""

    def __init__(self, steps, clock=time.monotonic):
        self.steps, self.opened, self._clock = list(steps), 0, clock

    def open(self):
        self.opened += 1

    def read(self):
        while self.steps:
            step = self.steps.pop(0)
            if isinstance(step, Exception):
                raise step
            if isinstance(step, Frame):
                return step
            if not callable(step):
                return Frame(self._clock(), step)
            step()
        return None
