"""Where positions go: what every sink is, the guard that keeps a failing one from stopping the
rest, and the registry of classes that declare themselves.

An address is ``KIND`` or ``KIND:REST``. A sink is one file with its class, its address and its
options, and its line here; one of a person's own needs no line (`trexton.base.plugins`).
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from trexton.base.errors import ParameterError, TrextonError
from trexton.base.options import Options
from trexton.base.plugins import addresses
from trexton.flights.aiding import Aiding
from trexton.onboard.edges import Edge, edge_at
from trexton.onboard.fix import Fix, LocalFrame
from trexton.onboard.tally import Tally, say

# kind: module and class; several kinds may share one
SINKS = {
    "json": "trexton.onboard.sinks.files:JsonLines",
    "csv": "trexton.onboard.sinks.files:CsvTable",
    "tum": "trexton.onboard.sinks.files:TumTrajectory",
    "udpout": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "udpin": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "serial": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "crazyflie": "trexton.onboard.sinks.crazyflie:CrazyflieSink",
}
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0


@dataclass(frozen=True)
class Check:
    """A line of the preflight check: what was looked at, whether it holds, and what was found."""

    name: str
    holds: bool
    words: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.holds else 'FAIL'}  {self.name}: {self.words}"


@dataclass(frozen=True)
class Surroundings:
    """What a sink may need to know beside its address and its options."""

    local: LocalFrame  # how the map lies on the ground
    area: tuple[float, float, float, float]  # (x_min, x_max, y_min, y_max) of the map, metres
    motion_rate: np.ndarray  # (2, 2) m^2, what the motion model adds to a covariance in a second
    tally: Tally
    aiding: str = "none"  # what of the other side's knowledge is used: tilt, all, none
    target: np.ndarray | None = None  # (2,) centre of the landing zone, metres on the map
    clock: Callable[[], float] = time.monotonic  # seconds, as live frames are stamped
    kind: str = ""  # the word before the sink's address
    # the autopilots of all links
    heard: dict[tuple[int, int], float] = field(default_factory=dict)


class Sink(Edge, ABC):
    """Takes one fix after another. Where the world outside fails it raises `OSError`, except in its
    constructor: `Guard` counts what was not delivered and tries again. Any other error is a bug and
    ends the run.
    """

    name = "output"  # in messages to people
    file = ""  # that it writes, if any: nothing that was read, and no file twice
    autopilot: ClassVar[bool] = False  # the preflight check speaks to those alone

    def checks(self, now: float) -> Iterable[Check]:
        """What the preflight check says of the other side."""
        yield Check("link", True, f"{self.name} never answers: nothing can be said of it")

    @abstractmethod
    def open(self) -> None:
        """Begin, or begin again after a fault."""

    @abstractmethod
    def write(self, fix: Fix) -> None:
        """Take one fix."""

    def event(self, event: dict[str, Any]) -> None:
        """Take something worth remembering that is no fix: a command, an answer, a count."""

    def news(self) -> list[dict[str, Any]]:
        """What has happened on the other side since this was last asked, as events for the log."""
        return []

    def aiding(self, time: float) -> Aiding | None:
        """What the other side knows of the vehicle at that moment, where there is one to ask."""
        return None

    def status(self) -> str:
        """A few words for the status line."""
        return ""

    def close(self) -> None:
        """Let go of file or connection."""


class Guard:
    """A sink that may fail: counted, closed, and opened again after a pause that doubles up to
    `LONGEST_PAUSE`.
    """

    def __init__(self, sink: Sink, tally: Tally, clock: Callable[[], float] = time.monotonic):
        self.sink, self._tally, self._clock = sink, tally, clock
        self.left_out = 0  # fixes and events that it did not take
        self._open, self._pause, self._retry_at = False, FIRST_PAUSE, -np.inf

    def write(self, fix: Fix) -> None:
        """Pass the fix on, if the sink works."""
        self._try(lambda: self.sink.write(fix))

    def event(self, event: dict[str, Any]) -> None:
        """Pass the event on, if the sink works."""
        self._try(lambda: self.sink.event(event))

    def _try(self, act: Callable[[], None]) -> None:
        now = self._clock()
        if not self._open and now < self._retry_at:
            self.left_out += 1
            return
        try:
            if not self._open:
                self._open = True  # as far as there is something to close
                self.sink.open()
            act()
            if now >= self._retry_at + self._pause:  # not at once: a sink may fail only later
                self._pause = FIRST_PAUSE
        except (OSError, TrextonError) as error:
            self._tally.count("output")
            self.left_out += 1
            why = getattr(error, "strerror", None) or error
            say(f"trexton onboard: {self.sink.name}: {why}: trying again in {self._pause:g} s")
            self._retry_at = now + self._pause
            self._pause = min(2 * self._pause, LONGEST_PAUSE)
            self.close()
        except Exception:  # a bug: nothing more is asked of it, and the run ends
            self.left_out += 1
            self._retry_at = np.inf
            self.close()
            raise

    def close(self) -> None:
        """Close the sink, whatever state it is in."""
        if self._open:
            self._open = False
            with suppress(OSError, ValueError):
                self.sink.close()


def open_sink(
    address: str, around: Surroundings, options: Mapping[type[Options], Any] | None = None
) -> Sink:
    """The sink at `address`, not yet opened: ``KIND``, ``KIND:REST``, or ``module:Class:REST`` of
    one's own. `options` has an object for each class of options that differs from its defaults.

    Raises `ParameterError` where the kind is unknown or the address incomplete, and
    `ModuleNotFoundError` where an extra is not installed.
    """
    addressed = edge_at("sinks", address, SINKS)
    if addressed is None:
        raise ParameterError(
            f"output {address!r} is of no known kind: "
            f"give one of {', '.join(addresses('sinks', SINKS))}, a colon and an address, or "
            "module:Class"
        )
    kind, name, rest = addressed
    chosen = (options or {}).get(kind.options, kind.options())
    return kind.make(rest, chosen, replace(around, kind=name))
