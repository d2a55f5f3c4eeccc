"""Where frames come from: each source against plain files, fake devices and a clock that the test
sets.
"""

from __future__ import annotations

import os
import threading

import cv2
import numpy as np
import pytest
from conftest import small_flight
from onboard_tools import Clock

from trexton.base.errors import FlightError, ParameterError, TrextonError
from trexton.base.plugins import resolve
from trexton.flights.folder import read_flight
from trexton.onboard.sources import (
    SOURCES,
    CameraLost,
    Frame,
    Playback,
    Source,
    open_source,
    recorded,
    video,
)
from trexton.onboard.sources.recorded import FlightSource
from trexton.onboard.sources.video import StreamSource
from trexton.vision.images import yuv_from_bgr


def everything(source: Source) -> list[Frame]:
    source.open()
    frames = list(map(source.decoded, iter(source.read, None)))
    source.close()
    return frames


class TestRegistry:
    def test_each_address_finds_its_source(self, image_folder, flight_folder):
        assert isinstance(open_source("/dev/video3"), StreamSource)
        assert isinstance(open_source("rtsp://127.0.0.1/floor"), StreamSource)
        assert isinstance(open_source("videotestsrc ! appsink"), StreamSource)
        assert isinstance(open_source(str(image_folder)), FlightSource)
        assert open_source(str(flight_folder), options={Playback: Playback(pace="stamps")}).live
        assert isinstance(open_source("stream:/dev/video0"), StreamSource)

    def test_modules_load_by_name(self):
        for kind in SOURCES:
            assert resolve("sources", kind, SOURCES).addresses

    @pytest.mark.parametrize("address", ["nowhere", "/dev/videoX", "", "flight:none"])
    def test_anything_else_is_an_error_with_a_sentence(self, address):
        with pytest.raises(TrextonError, match="give"):
            open_source(address)


class TestFlight:
    def test_histograms_with_their_stamps(self):
        flight = small_flight()
        frames = everything(FlightSource(flight))
        np.testing.assert_array_equal([frame.time for frame in frames], flight.time)
        np.testing.assert_array_equal([frame.picture for frame in frames], flight.histograms)

    def test_images_and_laps_whose_stamps_go_on(self, image_folder):
        flight = read_flight(image_folder)
        frames = everything(FlightSource(flight, laps=3))
        np.testing.assert_allclose([frame.time for frame in frames], 0.08 * np.arange(18))
        for row, frame in enumerate(frames):
            np.testing.assert_array_equal(frame.picture, flight.image(row % 6))

    def test_a_split(self, flight_folder):
        assert len(everything(open_source(f"{flight_folder}#test"))) == 20

    def test_a_folder_with_a_number_sign_in_its_name(self, flight_folder):
        """Taken for a part of another flight, its map image was flown as its only frame."""
        odd = flight_folder.rename(flight_folder.with_name("flight #2"))
        whole = len(read_flight(odd))
        assert len(everything(open_source(str(odd)))) == whole > 20
        assert len(everything(open_source(f"{odd}#test"))) == 20
        with pytest.raises(FlightError, match="no split ''"):
            open_source(f"{odd}#")

    def test_a_broken_image_is_a_frame_without_picture(self, image_folder):
        file = read_flight(image_folder).frames.files[2]
        file.write_bytes(file.read_bytes()[:100])
        assert [frame.picture is None for frame in everything(open_source(str(image_folder)))] == [
            False,
            False,
            True,
            False,
            False,
            False,
        ]


class TestStream:
    def test_a_named_pipe_is_a_live_stream(self, tmp_path):
        pipe = tmp_path / "camera.y4m"
        os.mkfifo(pipe)

        def film():
            with open(pipe, "wb", buffering=0) as stream:
                stream.write(b"YUV4MPEG2 W64 H48 F25:2 Ip A1:1 C422 XCOLORRANGE=FULL\n")
                for shade in (50, 100, 150):
                    stream.write(b"FRAME\n" + bytes([shade]) * (64 * 48) + bytes([128]) * (64 * 48))

        camera = threading.Thread(target=film)
        camera.start()
        source = open_source(str(pipe))
        assert isinstance(source, StreamSource)
        source.open()
        shades, stamps = zip(
            *(
                (frame.picture[..., 0].mean(), frame.time)
                for frame in (source.decoded(source.read()) for _ in range(3))
            ),
            strict=False,
        )
        assert shades == pytest.approx((50, 100, 150), abs=2)
        assert stamps[0] < stamps[1] < stamps[2]
        with pytest.raises(CameraLost):
            source.read()
        source.close()
        camera.join()


class FakeCapture:
    """A V4L2 device as OpenCV shows it."""

    def __init__(self, frames, opened=True):
        self.frames, self.opened, self.settings = list(frames), opened, {}

    def __call__(self, device, backend):
        assert backend == cv2.CAP_V4L2
        return self

    def isOpened(self):
        return self.opened

    def set(self, name, value):
        self.settings[name] = value

    def get(self, name):
        code = cv2.VideoWriter_fourcc(*"YUYV")
        return {cv2.CAP_PROP_FOURCC: code}.get(name, self.settings.get(name, 0))

    def grab(self):
        return bool(self.frames)

    def retrieve(self):
        return True, self.frames.pop(0)

    def release(self):
        self.released = True


class TestCamera:
    @pytest.fixture
    def source(self, monkeypatch):
        def source(capture, shape=None) -> StreamSource:
            monkeypatch.setattr(cv2, "VideoCapture", capture)
            return StreamSource("/dev/video0", shape)

        monkeypatch.setattr(video, "time", Clock(5.0))
        return source

    def test_it_is_asked_for_the_size_and_stamped_at_the_grab(self, source, rng):
        image = rng.integers(0, 256, (4, 6, 3), dtype=np.uint8)
        capture = FakeCapture([image])
        camera = source(capture, shape=(4, 6))
        camera.open()
        frame = camera.decoded(camera.read())
        np.testing.assert_array_equal(frame.picture, yuv_from_bgr(image))
        assert frame.time == 5.0
        assert capture.settings[cv2.CAP_PROP_FRAME_WIDTH] == 6
        assert capture.settings[cv2.CAP_PROP_FRAME_HEIGHT] == 4

    @pytest.mark.parametrize("raw", [None, np.zeros(47, np.uint8), np.zeros((4, 5, 2), np.uint8)])
    def test_bytes_of_another_form_are_a_frame_without_picture(self, source, raw):
        camera = source(FakeCapture([raw]))
        camera.open()
        assert camera.decoded(camera.read()).picture is None

    def test_unplugged_or_absent(self, source):
        camera = source(FakeCapture([]))
        camera.open()
        with pytest.raises(CameraLost, match="no frames"):
            camera.read()
        with pytest.raises(CameraLost, match="cannot be opened"):
            source(FakeCapture([], opened=False)).open()


def test_paced_holds_frames_back_until_their_time_and_stamps_them(monkeypatch):
    monkeypatch.setattr(recorded, "time", Clock(50.0))
    source = FlightSource(small_flight(4), pace="stamps")
    np.testing.assert_allclose(
        [frame.time for frame in everything(source)], 50 + 0.08 * np.arange(4)
    )


def test_jpegs_cut_short_or_of_another_size_are_not_hidden(tmp_path, rng):
    """OpenCV's reader fills the one up and bends the other, and says nothing."""

    def jpeg(width: int, height: int) -> bytes:
        small = rng.integers(0, 255, (height // 8, width // 8, 3), dtype=np.uint8)
        return cv2.imencode(".jpg", cv2.resize(small, (width, height)))[1].tobytes()

    pictures = [jpeg(128, 96) for _ in range(6)]
    pictures[2] = pictures[2][: len(pictures[2]) // 3]
    pictures[4] = jpeg(64, 48)
    (tmp_path / "film.mjpeg").write_bytes(b"".join(pictures))
    address = str(tmp_path / "film.mjpeg")
    for file in (f"stream:{address}", f"file://{address}"):  # it would be over in no time
        with pytest.raises(ParameterError, match="a file is no live camera: trexton import it"):
            open_source(file)
    source = StreamSource(address)
    source.open()
    seen = [source.decoded(source.read()).picture for _ in pictures]
    assert seen[2] is None and seen[4].shape == (48, 64, 3)
    assert [seen[row].shape for row in (0, 1, 3, 5)] == [(96, 128, 3)] * 4
