"""Frames of a flight: files, a video, a bag; all are asked in one way."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight
from small_recording import film

from trexton.base.errors import FlightError
from trexton.flights import read_flight, write_flight
from trexton.flights.frames import Forward, ImageFiles, VideoFrames, select_frames
from trexton.vision.images import yuv_from_bgr


def grey(level: int) -> np.ndarray:
    return np.full((48, 64, 3), level, np.uint8)


@pytest.fixture
def video(tmp_path) -> VideoFrames:
    return VideoFrames(film(tmp_path / "v.avi", (grey(20 * row) for row in range(8)), 25), 8)


@pytest.fixture
def files(tmp_path) -> ImageFiles:
    for row in range(8):
        cv2.imwrite(str(tmp_path / f"{row}.png"), grey(20 * row))
    return ImageFiles(tuple(tmp_path / f"{row}.png" for row in range(8)))


def level(image: np.ndarray) -> int:
    return round(float(image[..., 0].mean()) / 20)


class Counted(Forward):
    """Numbers that are decoded only when they are wanted."""

    def __init__(self, source, count):
        super().__init__(source, count)
        self.opened, self.wanted = 0, []

    def items(self):
        self.opened += 1
        return iter(range(6))

    def decoded(self, item):
        self.wanted.append(item)
        return grey(item)


@pytest.mark.parametrize("kind", ["video", "files"])
def test_any_order_and_any_choice(kind, request):
    frames = request.getfixturevalue(kind)
    assert len(frames) == 8
    assert [level(frames[row]) for row in (5, 1, 2, 7)] == [5, 1, 2, 7]
    chosen = select_frames(frames, np.array([6, 3, 4]))
    assert [level(image) for image in (chosen[0], chosen[1], chosen[2])] == [6, 3, 4]
    again = select_frames(chosen, np.array([2]))
    assert len(again) == 1 and level(again[0]) == 4
    assert len({frames.digest, chosen.digest, again.digest}) == 3
    assert chosen.digest == select_frames(frames, np.array([6, 3, 4])).digest
    with pytest.raises(IndexError):
        frames[8]


def test_passed_over_is_not_decoded_and_going_back_starts_anew(tmp_path):
    frames = Counted(tmp_path, 6)
    frames[1], frames[4]
    assert (frames.opened, frames.wanted) == (1, [1, 4])
    frames[2]
    assert (frames.opened, frames.wanted) == (2, [1, 4, 2])


def test_what_can_no_longer_be_read_is_named(video):
    video.source.write_bytes(b"")
    with pytest.raises(FlightError, match=r"v.avi: frame 2 can no longer be read"):
        video[2]


def test_a_flight_flies_on_a_video_and_is_written_with_its_images(video, tmp_path):
    flight = replace(small_flight(8), histograms=None, frames=video)
    assert [level(image) for image in flight.images()] == list(range(8))
    part = flight.select(np.array([2, 5]))
    assert [level(image) for image in part.images()] == [2, 5]
    assert part.data_hash != flight.select(np.array([2, 6])).data_hash
    back = read_flight(write_flight(part, tmp_path / "out"))
    np.testing.assert_allclose(np.stack(list(back.images())), np.stack(list(part.images())), atol=2)


def test_equal_images_in_files_have_one_digest(files, tmp_path):
    moved = tmp_path / "other.png"
    moved.write_bytes(files.files[0].read_bytes())
    one, other = ImageFiles(files.files[:1]), ImageFiles((moved,))
    assert one.digest == other.digest
    np.testing.assert_array_equal(one[0], yuv_from_bgr(grey(0)))
