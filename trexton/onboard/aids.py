"""What a frame is localized with besides: attitude, height and velocity of the same moment."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from trexton.flights.aiding import Aiding
from trexton.onboard.sinks.base import Guard
from trexton.onboard.sources.base import Frame

__all__ = ["AIDS", "Aids"]

AIDS = ("tilt", "all", "none")
_FIELDS = ("roll", "pitch", "yaw", "height", "velocity")


class Aids:
    """Gathers what the recording and the autopilots say of a frame's moment.

    Parameters
    ----------
    wanted : {"tilt", "all", "none"}
        Roll, pitch and height; yaw and velocity as well, which take a compass; nothing.
    sinks : sequence of Guard
        Asked in turn for what the frame does not bring itself.
    """

    def __init__(self, wanted: str, sinks: Sequence[Guard]):
        self.wanted, self._sinks = wanted, sinks

    def of(self, frame: Frame, stamp: float) -> Aiding | None:
        """What is known at `stamp`, the frame's on the clock of the loop; None where nothing is."""
        if self.wanted == "none":
            return None
        known = self.everything(frame, stamp)
        known = known if self.wanted == "all" else known.without_heading()
        return known if any(getattr(known, name) is not None for name in _FIELDS) else None

    def everything(self, frame: Frame, stamp: float) -> Aiding:
        """What is known at `stamp`, whatever is wanted."""
        said = [] if frame.aiding is None else [frame.aiding.shifted(stamp - frame.time)]
        said += [each for guard in self._sinks if (each := guard.sink.aiding(stamp)) is not None]
        return _first(each.at(stamp) for each in said)


def _first(said: Iterable[Aiding]) -> Aiding:
    """Attitude, height and velocity each of the first who knows it."""
    known = Aiding()
    for each in said:
        if known.attitude_time is None:
            known = replace(
                known, roll=each.roll, pitch=each.pitch, yaw=each.yaw,
                attitude_time=each.attitude_time,
            )  # fmt: skip
        if known.height is None:
            known = replace(known, height=each.height, height_time=each.height_time)
        if known.velocity is None:
            known = replace(known, velocity=each.velocity, velocity_time=each.velocity_time)
    return known
