"""The thread that keeps the newest frame of a live source, against scripted sources and streams."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np
import pytest
from conftest import small_flight
from patience import eventually

from trexton.onboard.intake import Grabber
from trexton.onboard.sources import (
    CameraLost,
    Frame,
    Source,
    video,
)
from trexton.onboard.sources.recorded import FlightSource
from trexton.onboard.sources.video import JPEG, StreamSource
from trexton.onboard.tally import Tally, flush


class Scripted(Source):
    """A live source that follows a script: frames, errors, gates to wait at."""

    def __init__(self, *steps):
        self.steps, self.opened, self.closed = list(steps), 0, 0

    def open(self):
        self.opened += 1

    def read(self):
        step = self.steps.pop(0) if self.steps else None
        if isinstance(step, threading.Event):
            step.wait(20)
            return self.read()
        if isinstance(step, Exception):
            raise step
        return step

    def close(self):
        self.closed += 1


def frames(*times):
    return [Frame(float(time), None) for time in times]


class TestGrabber:
    def test_only_the_newest_frame_and_older_ones_counted(self):
        tally, gate = Tally(), threading.Event()
        grabber = Grabber(Scripted(*frames(1, 2, 3), gate, *frames(4)), tally)
        assert eventually(lambda: tally["dropped"] == 2)
        assert grabber.next(10).time == 3
        assert grabber.next(0.01) is None
        gate.set()
        assert grabber.next(10).time == 4
        assert grabber.next(10) is None
        assert grabber.ended
        assert tally["dropped"] == 2
        grabber.close()

    def test_a_lost_camera_is_opened_again(self):
        tally = Tally()
        source = Scripted(CameraLost("unplugged"), CameraLost("unplugged"), *frames(1))
        grabber = Grabber(source, tally)
        assert grabber.next(10).time == 1
        assert (tally["camera"], source.opened) == (2, 3)
        grabber.close()
        assert source.closed == 3

    def test_a_camera_that_breaks_after_every_frame_is_opened_ever_less_often(self, capfd):
        """It was opened ten times a second, with a line for each."""
        steps = [step for n in range(4) for step in (*frames(n), CameraLost("flaps"))]
        source = Scripted(*steps, *frames(9))
        began = time.monotonic()
        grabber = Grabber(source, Tally())
        assert eventually(lambda: source.opened == 5)
        assert time.monotonic() - began > 0.1 + 0.2 + 0.4 + 0.8
        grabber.close()
        flush()
        assert capfd.readouterr().err.count("flaps") == 1

    def test_an_error_nobody_foresaw_reaches_the_loop(self):
        grabber = Grabber(Scripted(ZeroDivisionError("a bug")), Tally())
        with pytest.raises(ZeroDivisionError):
            grabber.next(10)
        grabber.close()

    def test_a_recording_leaves_nothing_out(self):
        recording = Grabber(FlightSource(small_flight(5)), Tally())
        assert [recording.next(0).time for _ in range(5)] == pytest.approx(0.08 * np.arange(5))
        assert recording.next(0) is None and recording.ended


class Stream:
    """A camera of 60 frames a second behind a buffer that holds whatever is not read: each frame is
    its own number."""

    def __init__(self):
        self.began, self.read = time.monotonic(), 0

    def __call__(self, address, backend):
        return self

    isOpened = release = set = lambda self, *value: True  # noqa: N815

    def get(self, name):
        return cv2.VideoWriter_fourcc(*"MJPG") if name == cv2.CAP_PROP_FOURCC else 64

    def grab(self):
        self.read += 1
        time.sleep(max(0.0, self.began + self.read / 60 - time.monotonic()))
        return True

    def retrieve(self):
        return True, np.frombuffer(JPEG + self.read.to_bytes(4, "little"), np.uint8)


def test_a_stream_that_is_decoded_too_slowly_costs_frames_and_not_age(monkeypatch):
    """Decoded as they came, frames were older by the second, and claimed to be fresh."""
    camera = Stream()

    def slow(data):
        time.sleep(8 / 60)
        return np.full((2, 2, 3), camera.began + int.from_bytes(data[2:], "little") / 60)

    monkeypatch.setattr(video, "decode_image", slow)
    monkeypatch.setattr(cv2, "VideoCapture", camera)
    tally = Tally()
    grabber = Grabber(StreamSource("tcp://camera"), tally)
    seen = [grabber.next(10) for _ in range(12)]
    grabber.close()
    off = [frame.time - frame.picture.max() for frame in seen]  # the stamp, less the true moment
    late = 12 * 7 / 60  # by which the twelfth of all frames would come
    assert max(off) < late / 2 and tally["dropped"] > 50
