"""Frames of a flight are files; those of a source that is read forwards come in any order."""

import cv2
import numpy as np
import pytest
from small_recording import film

from trexton.base.errors import FlightError
from trexton.flights.frames import Forward, ImageFiles
from trexton.flights.importers.video import Settings, read
from trexton.vision.images import yuv_from_bgr


def grey(level: int) -> np.ndarray:
    return np.full((48, 64, 3), level, np.uint8)


@pytest.fixture
def video(tmp_path) -> Forward:
    (tmp_path / "t.csv").write_text("t,x,y\n0,0,0\n1,1,1\n")
    path = film(tmp_path / "v.avi", (grey(20 * row) for row in range(8)), 25)
    frames = read(path, Settings(positions="t.csv", offset=0.0)).frames
    assert isinstance(frames, Forward)
    return frames


@pytest.fixture
def files(tmp_path) -> ImageFiles:
    for row in range(8):
        cv2.imwrite(str(tmp_path / f"{row}.png"), grey(20 * row))
    return ImageFiles(tuple(tmp_path / f"{row}.png" for row in range(8)))


def level(image: np.ndarray) -> int:
    return round(float(image[..., 0].mean()) / 20)


@pytest.mark.parametrize("kind", ["video", "files"])
def test_any_order_and_any_choice(kind, request):
    frames = request.getfixturevalue(kind)
    assert len(frames) == 8
    assert [level(frames[row]) for row in (5, 1, 2, 7)] == [5, 1, 2, 7]
    chosen = frames.at(np.array([6, 3, 4]))
    assert [level(image) for image in (chosen[0], chosen[1], chosen[2])] == [6, 3, 4]
    again = chosen.at(np.array([2]))
    assert len(again) == 1 and level(again[0]) == 4
    with pytest.raises(IndexError):
        frames[8]


def test_passed_over_is_not_decoded_and_going_back_starts_anew(tmp_path):
    opened, wanted = [], []

    def items():
        opened.append(1)
        return iter(range(6))

    def decoded(item):
        wanted.append(item)
        return grey(item)

    frames = Forward(tmp_path, np.arange(6), items, decoded)
    frames[1], frames[4]
    assert (len(opened), wanted) == (1, [1, 4])
    frames[2]
    assert (len(opened), wanted) == (2, [1, 4, 2])


def test_what_can_no_longer_be_read_is_named(video):
    video.source.write_bytes(b"")
    with pytest.raises(FlightError, match=r"v.avi: frame 2 can no longer be read"):
        video[2]


def test_equal_images_in_files_have_one_digest(files, tmp_path):
    moved = tmp_path / "other.png"
    moved.write_bytes(files.files[0].read_bytes())
    one, other = ImageFiles(files.files[:1]), ImageFiles((moved,))
    assert one.digest == other.digest != files.digest
    assert files.at(np.array([0])).digest == one.digest
    np.testing.assert_array_equal(one[0], yuv_from_bgr(grey(0)))
