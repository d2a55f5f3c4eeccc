"""What is done with a frame before it is localized. The newest is read in a thread, stamped at the
grab, never queued; it is checked for faults of the camera. Attitude, height and velocity of the
same moment are gathered."""

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trexton.flights.aiding import Aiding
from trexton.onboard.sinks import Guard
from trexton.onboard.sources import CameraLost, Frame, Source
from trexton.onboard.tally import Tally, say

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 5.0  # seconds before a source is opened again
STEADY = 5.0  # seconds after which a source that was opened counts as running
SAMPLE_STRIDE = 8  # one pixel in 64 tells black from white and one frame from the next
BLACK_LEVEL, WHITE_LEVEL = 12, 243  # grey levels, of 255
RING = 16  # frames, of which none comes again
SATURATED_SHARE = 0.98  # of the pixels, from which on a frame is dark or bright
AIDS = ("tilt", "all", "none")
_STAMPED = {  # what shares a stamp
    "attitude_time": ("roll", "pitch", "yaw"),
    "height_time": ("height",),
    "velocity_time": ("velocity", "velocity_sigma"),
}


class Grabber:
    """Hands out every frame of a recording; reads a live source in a thread of its own, and decodes
    its newest frame when asked for it.

    A live frame that a newer one replaced before it was asked for counts as dropped. A live source
    that fails is closed and opened again after a pause that doubles up to `LONGEST_PAUSE`.
    """

    def __init__(self, source: Source, tally: Tally):
        self._source, self._tally = source, tally
        self._newest: Frame | None = None
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._failure: Exception | None = None
        self.ended = False
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        if source.live:
            self._thread.start()
        else:
            source.open()

    def next(self, timeout: float) -> Frame | None:
        """The newest frame not yet handed out; None if none comes for `timeout` seconds."""
        if not self._source.live:
            frame = self._source.read()
            self.ended = frame is None
            return frame and self._decoded(frame)
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self.ended, timeout)
            if self._failure is not None:
                raise self._failure
            frame, self._newest = self._newest, None
        return frame and self._decoded(frame)

    def _decoded(self, frame: Frame) -> Frame:
        """Decoded, stamped with when it was taken."""
        return self._source.decoded(frame).shifted(-self._source.delay)

    def close(self) -> None:
        """Stop; a source that hangs in its driver is left to end with the process."""
        self._stop.set()
        if self._source.live:
            self._thread.join(timeout=2.0)
        else:
            self._source.close()

    def _run(self) -> None:
        pause, reported = FIRST_PAUSE, None
        try:
            while not self._stop.is_set():
                try:
                    self._source.open()
                    opened = time.monotonic()
                    while not self._stop.is_set():
                        frame = self._source.read()
                        if frame is None:
                            return
                        self._put(frame)
                        if time.monotonic() - opened > STEADY:
                            pause, reported = FIRST_PAUSE, None
                except CameraLost as error:
                    self._tally.count("camera")
                    if str(error) != reported:  # once, not at every attempt
                        say(f"trexton onboard: {error}")
                        reported = str(error)
                finally:
                    self._source.close()
                self._stop.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
        except Exception as error:  # raised again by `next`, in the thread that can report it
            self._failure = error
        finally:
            with self._changed:
                self.ended = True
                self._changed.notify_all()

    def _put(self, frame: Frame) -> None:
        with self._changed:
            if self._newest is not None:
                self._tally.count("dropped")
            self._newest = frame
            self._changed.notify_all()


class Inspector:
    """Names the fault of a frame, or None; `shape` is that of the map's images, if it has any."""

    def __init__(self, shape: tuple[int, int] | None):
        self.shape = shape
        self._last: deque[bytes] = deque(maxlen=RING)

    def check(self, picture: np.ndarray) -> str | None:
        """The fault of an ``(H, W, 3) uint8`` image; a histogram has none."""
        if picture.ndim == 1:
            return None
        if self.shape is not None and picture.shape[:2] != self.shape:
            return "size"
        sample = picture[::SAMPLE_STRIDE, ::SAMPLE_STRIDE]
        # Sensor noise alone makes two frames differ: a camera of equal bytes repeats itself, or
        # hangs in a ring of buffers.
        same = (content := sample.tobytes()) in self._last
        self._last.append(content)
        luma = sample[..., 0]
        if np.mean(luma <= BLACK_LEVEL) >= SATURATED_SHARE:
            return "dark"
        if np.mean(luma >= WHITE_LEVEL) >= SATURATED_SHARE:
            return "bright"
        return "frozen" if same else None


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
        """The aiding at `stamp`, the frame's on the clock of the loop; None where there is none."""
        if self.wanted == "none":
            return None
        aiding = self.everything(frame, stamp)
        aiding = aiding if self.wanted == "all" else aiding.without_heading()
        return aiding if any(getattr(aiding, stamp) is not None for stamp in _STAMPED) else None

    def everything(self, frame: Frame, stamp: float) -> Aiding:
        """All aiding at `stamp`, whatever is wanted."""
        said = [] if frame.aiding is None else [frame.aiding.shifted(stamp - frame.time)]
        said += [each for guard in self._sinks if (each := guard.sink.aiding(stamp)) is not None]
        aiding = Aiding()
        for each in said:  # attitude, height and velocity each of the first who knows it
            lacking = [stamp for stamp in _STAMPED if getattr(aiding, stamp) is None]
            names = [name for stamp in lacking for name in (stamp, *_STAMPED[stamp])]
            known = each.at(stamp)
            aiding = replace(aiding, **{name: getattr(known, name) for name in names})
        return aiding
