"""The newest frame and no other: read in a thread, stamped at the grab, never queued."""

from __future__ import annotations

import threading
from dataclasses import replace

from trexton.onboard.sources import CameraLost, Frame, Source
from trexton.onboard.tally import Tally
from trexton.onboard.voice import say

__all__ = ["Grabber"]

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 5.0


class Grabber:
    """Hands out every frame of a recording; reads a live source in a thread of its own, and decodes
    its newest frame when asked for it.

    A live frame that a newer one replaced before it was asked for counts as dropped. A live source
    that fails is closed and opened again after a pause that doubles up to `LONGEST_PAUSE`.

    Parameters
    ----------
    source : Source
    tally : Tally
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
        """The newest frame not yet handed out, waiting up to `timeout` seconds for one;
        None if none came."""
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
        """Decoded, stamped with when it was taken, seen as the map's images were."""
        source = self._source
        frame = source.decoded(frame).shifted(-source.delay)
        picture, made = frame.picture, source.rectification
        if made is not None and picture is not None and picture.shape[1::-1] == made.source:
            frame = replace(frame, picture=made.apply(picture))
        if source.watch is not None:
            source.watch(frame)
        return frame

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
                    while not self._stop.is_set():
                        frame = self._source.read()
                        if frame is None:
                            return
                        self._put(frame)
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
