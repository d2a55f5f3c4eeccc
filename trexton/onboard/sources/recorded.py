"""Recordings as a source. A flight is played as often as asked for, at once or at its own pace."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from trexton.base.errors import FlightError, ImageError
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.onboard.sources import Frame, Playback, Shape, Source


def _parted(address: str) -> tuple[str, str | None]:
    """Folder and part of an address; a folder may have a # in its own name."""
    if "#" not in address or (Path(address) / "flight.toml").is_file():
        return address, None
    folder, _, part = address.rpartition("#")
    return folder, part


class FlightSource(Source):
    """A recorded flight: its images, or its histograms where it has none.

    Every frame comes in order; stamps and numbers of further laps go on where the last one ended.
    At the pace of its stamps it is like a camera: each frame is held back until its time has come,
    and stamped with the clock; who is slow misses frames.
    """

    flight: Flight
    rectified = True  # as they were imported
    options = Playback
    addresses = {
        "my-flight": "a recorded flight, a folder with `flight.toml`",
        "my-flight#test": "one of its parts",
    }

    @staticmethod
    def matches(address: str) -> bool:
        return (Path(_parted(address)[0]) / "flight.toml").is_file()

    @classmethod
    def make(cls, address: str, options: Playback, around: Shape) -> Source:
        folder, part = _parted(address)
        flight = read_flight(folder)
        if part is not None:
            flight = flight.part(part)
        if not len(flight):
            raise FlightError(f"{address}: no frames: nothing to replay")
        return cls(flight, options.laps, folder, options.pace)

    def __init__(
        self, flight: Flight, laps: int = 1, folder: str | None = None, pace: str = "fast"
    ):
        self.flight, self.live = flight, pace == "stamps"
        self.gives = "images" if flight.has_images else "histograms"
        self.files = () if folder is None else (folder,)
        self._offset: float | None = None  # of the clock, to the stamps
        self._played = self._play(laps)

    def read(self) -> Frame | None:
        frame = next(self._played, None)
        if frame is None or not self.live:
            return frame
        if self._offset is None:
            self._offset = time.monotonic() - frame.time
        due = frame.time + self._offset
        time.sleep(max(0.0, due - time.monotonic()))
        return frame.shifted(time.monotonic() - frame.time)

    def _play(self, laps: int) -> Iterator[Frame]:
        stamps, numbers = self.flight.time.tolist(), self.flight.frame.tolist()
        passed, counted = 0.0, 0
        for _ in range(laps):
            for row, (stamp, number) in enumerate(zip(stamps, numbers, strict=True)):
                frame = self._frame(row, Frame(stamp, None, number))
                yield replace(frame.shifted(passed), number=number + counted)
            lasted = stamps[-1] - stamps[0]
            passed += lasted + lasted / max(len(stamps) - 1, 1)
            counted += numbers[-1] + 1

    def _frame(self, row: int, frame: Frame) -> Frame:
        flight = self.flight
        if flight.histograms is not None and not flight.has_images:
            return replace(frame, picture=flight.histograms[row])
        assert flight.frames is not None
        try:  # one of another size is refused by the loop, as from a camera
            return replace(frame, picture=flight.frames[row], aiding=flight.aiding(row))
        except ImageError:
            return frame
