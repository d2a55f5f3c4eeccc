"""An hour of simulated flight, 45 000 frames, as fast as it goes, and a short form: memory must not
grow.
"""

from __future__ import annotations

import resource
import threading

import numpy as np
import pytest
from conftest import small_flight
from onboard_tools import AREA, room, room_map

from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.onboard import Onboard
from trexton.onboard.fix import Fix
from trexton.onboard.sinks import Guard, Sink, open_sink
from trexton.onboard.sources import Frame, Source
from trexton.onboard.sources.recorded import FlightSource
from trexton.onboard.tally import Tally
from trexton.simulator import Plan, random_waypoints


class Memory(Sink):
    """What the process holds at the thousandth frame, and at the end."""

    def __init__(self):
        self.settled = self.last = 0

    def open(self): ...

    def write(self, fix: Fix):
        if fix.number == 999:
            self.settled = self.resident()

    def close(self):
        self.last = self.resident()

    def resident(self) -> int:
        with open("/proc/self/statm") as stream:
            return int(stream.read().split()[1]) * resource.getpagesize()

    @property
    def growth(self) -> int:
        return self.last - self.settled


def fly(localizer: Localizer, source: Source, frames: int, folder) -> tuple[dict, int]:
    from onboard_tools import surroundings

    tally, memory = Tally(), Memory()
    sinks = [
        Guard(open_sink(address, surroundings(tally)), tally)
        for address in ("csv:/dev/null", "json:/dev/null")
    ]
    log = Guard(open_sink(f"json:{folder}/log", surroundings(tally)), tally)
    onboard = Onboard(
        localizer, source, [*sinks, Guard(memory, tally)], tally=tally, log=log, frames=frames
    )
    summary = onboard.run(threading.Event())
    return summary, memory.growth


class Room(Source):
    """The small room, live, a frame as soon as it is asked for."""

    live = False

    def __init__(self):
        self.room, self.plan = room(12), Plan(random_waypoints(AREA, np.random.default_rng(12)))

    def open(self): ...

    def read(self) -> Frame:
        state = self.room.step(self.plan.goal(self.room.state.position))
        return Frame(state.time, self.room.render())


def test_three_thousand_frames_do_not_grow(tmp_path):
    flight = small_flight(200)
    localizer = Localizer(
        train_map(flight, neighbors=3, rng=np.random.default_rng(1)),
        recovery="augmented",
        rng=np.random.default_rng(2),
    )
    summary, growth = fly(localizer, FlightSource(flight, laps=15), 3000, tmp_path)
    assert summary["frames"] == summary["observed"] == 3000
    assert growth < 1.7e6  # not one kB a frame
    assert len((tmp_path / "log").read_text().splitlines()) == 3000


@pytest.mark.slow
def test_an_hour_in_the_room(tmp_path):
    localizer = Localizer(room_map(), recovery="augmented", rng=np.random.default_rng(2))
    summary, growth = fly(localizer, Room(), 45_000, tmp_path)
    print(summary)
    assert summary["frames"] == 45_000
    assert (
        summary["observed"]
        + sum(count for name, count in summary["faults"].items() if name != "late")
        == 45_000
    )
    assert growth < 16e6
