"""A recorded flight: its images, or its histograms where it has no images."""

from __future__ import annotations

from pathlib import Path

from trexton.base.errors import FlightError, ImageError
from trexton.flights import Flight, read_flight
from trexton.onboard.sources.base import Expected, Frame, Playback, Source

__all__ = ["FlightSource"]


def _parted(address: str) -> tuple[str, str | None]:
    """Folder and part of an address; a folder may have a # in its own name."""
    if "#" not in address or (Path(address) / "flight.toml").is_file():
        return address, None
    folder, _, part = address.rpartition("#")
    return folder, part


class FlightSource(Source):
    """Every frame of a flight in order, with its own stamps; further laps go on where the last
    one ended."""

    live = False
    rectified = True  # as they were imported

    addresses = {
        "my-flight": "a recorded flight, a folder with `flight.toml`",
        "my-flight#test": "one of its parts",
    }
    options = Playback

    @staticmethod
    def matches(address: str) -> bool:
        return (Path(_parted(address)[0]) / "flight.toml").is_file()

    @classmethod
    def make(cls, address: str, options: Playback, around: Expected) -> Source:
        folder, part = _parted(address)
        flight = read_flight(folder)
        if part is not None:
            flight = flight.part(part)
        if not len(flight):
            raise FlightError(f"{address}: no frames: nothing to replay")
        return cls(flight, options.laps, folder)

    def __init__(self, flight: Flight, laps: int = 1, folder: str | None = None):
        self.flight, self.laps = flight, laps
        self.gives = "images" if flight.has_images else "histograms"
        self.files = () if folder is None else (folder,)
        duration = float(flight.time[-1] - flight.time[0])
        self._lap_s = duration + duration / max(len(flight) - 1, 1)
        self._next = 0

    def read(self) -> Frame | None:
        lap, row = divmod(self._next, len(self.flight))
        if lap >= self.laps:
            return None
        self._next += 1
        stamp = float(self.flight.time[row]) + lap * self._lap_s
        number = int(self.flight.frame[row]) + lap * (int(self.flight.frame[-1]) + 1)
        if self.flight.histograms is not None and not self.flight.has_images:
            return Frame(stamp, self.flight.histograms[row], number)
        assert self.flight.frames is not None
        try:
            aiding = self.flight.aiding(row).shifted(lap * self._lap_s)
            # One of another size is told by the loop, as from a camera.
            return Frame(stamp, self.flight.frames[row], number, aiding)
        except ImageError:
            return Frame(stamp, None, number)
