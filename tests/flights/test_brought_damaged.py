"""A generator damages sound recordings in the ways that people's are damaged, at random rates: what
is imported is right, or the damage is named.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_logs import ardupilot_log
from test_brought_photos import photo
from test_import import picture
from test_plausibility import SOUND, UNITS, sound

from trexton.base.errors import FlightError, TrextonError
from trexton.flights.importers.bag import _decoded
from trexton.flights.importers.recording import NANO, PoseTrack, Recording
from trexton.flights.importers.tracks import TrackColumns, read_track
from trexton.flights.importing import Common, _placed, import_flight
from trexton.flights.plausibility import warnings
from trexton.vision.images import decode_image

RATE = 100  # positions a second


def circle(time: np.ndarray) -> np.ndarray:
    """In a room whose origin is a corner, at half a metre a second."""
    return np.column_stack([5 + 2 * np.cos(time / 4), 4 + 2 * np.sin(time / 4), 1 + 0 * time])


def nanoseconds(seconds: np.ndarray) -> np.ndarray:
    return np.rint(seconds * NANO).astype(np.int64)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6), share=st.floats(0.02, 0.12),
    how=st.sampled_from(["zero", "zeros in a row", "another body", "body in a row", "held"]),
)  # fmt: skip
def test_lost_rows_between_frames_are_not_mixed_into_them(seed, share, how):
    rng = np.random.default_rng(seed)
    time = np.arange(9 * RATE) / RATE
    track = circle(time) + 0.0005 * rng.standard_normal((len(time), 3))
    count = round(share * len(time))
    begin = int(rng.integers(50, len(time) - 50 - count))
    lost = np.arange(begin, begin + count)
    if how in ("zero", "another body"):
        lost = rng.choice(np.arange(50, len(time) - 50), count, replace=False)
    if how == "held":
        lost = np.arange(begin, begin + 20 + count)
        track[lost] = track[begin]
    else:
        track[lost] = 0 if "zero" in how else circle(time[lost])[:, [1, 0, 2]] + (2, 2, 0)
    frames = nanoseconds(np.arange(0.3, 8.5, 0.08) + 0.0037)
    placed, said = _placed(Recording(frames, PoseTrack(nanoseconds(time), track)), Common())
    off = np.hypot(*(placed.position - circle(frames / NANO))[:, :2].T)
    assert np.nanmax(off) < 0.02 and np.isfinite(off).mean() > 0.7
    assert any("tracking was lost there, left out" in line for line in said)


@pytest.mark.parametrize("kind", sorted(SOUND))
def test_nothing_of_sound_tracks_is_left_out(kind):
    flight = sound(kind, 3, 200)
    stamps = nanoseconds(flight.time)
    track = PoseTrack(stamps, np.column_stack([flight.position, np.ones(200)]))
    _, said = _placed(Recording(stamps[:-1] + 1000, track), Common(tolerance=100.0))
    assert not [line for line in said if "lost" in line or "flown to" in line]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), share=st.floats(0.01, 0.3))
def test_stamps_that_repeat_and_go_back(seed, share):
    rng, time = np.random.default_rng(seed), np.arange(200) / 20
    order = np.concatenate([np.arange(200), rng.integers(0, 200, round(share * 200))])
    order = order[np.argsort(order + rng.uniform(0, 5, len(order)))]
    track = PoseTrack(nanoseconds(time[order]), circle(time[order]))
    kept, said = track.ordered("the file")
    np.testing.assert_allclose(kept.position, circle(time))
    assert "the file: " in said[0] and len(said) == 2


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**4), damage=st.sampled_from(sorted(UNITS)),
    kind=st.sampled_from(["circle, steady turn", "fast quadrotor", "lanes, nose ahead"]),
)  # fmt: skip
def test_units_and_axes_are_named(seed, damage, kind):
    flight = sound(kind, seed, 300)
    if flight.height is None:
        flight = sound("fast quadrotor", seed, 300)
    assert [*map(str, warnings(type(flight)(**vars(flight) | UNITS[damage](flight))))]


JPEG = cv2.imencode(".jpg", picture(3))[1].tobytes()
PIXELS = JPEG.partition(b"\xff\xda")[2][12:]


@given(share=st.floats(0.1, 0.99), tail=st.binary(max_size=300), zeros=st.integers(0, 5000))
def test_pictures_that_are_cut_or_padded(share, tail, zeros):
    whole = decode_image(JPEG)
    padding = bytes(zeros) + tail.replace(b"\xff", b"")
    np.testing.assert_array_equal(decode_image(JPEG + padding), whole)
    with pytest.raises(TrextonError, match="cut short"):
        decode_image(JPEG[: int(share * len(JPEG)) - 2] + bytes(zeros))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("put", [b"", bytes(400)])
def test_pictures_that_are_damaged_within(share, put):
    """OpenCV fills what follows with grey, or with what it takes for pixels."""
    first = len(JPEG) - round(share * len(PIXELS))
    with pytest.raises(TrextonError, match="damaged"):
        decode_image(JPEG[:first] + put + JPEG[first + 400 :])


def test_damaged_pictures_of_a_bag_are_named():
    middle = len(JPEG) - len(PIXELS) // 2
    for data, why in ((JPEG[:middle] + JPEG[middle + 400 :], "damaged"), (b"none", "jpeg")):
        with pytest.raises(FlightError, match=rf"a.bag cannot be decoded \(.*{why}"):
            _decoded("a.bag", (0, 0, SimpleNamespace(format="jpeg", data=data)))


def test_bytes_before_the_end_of_a_picture_are_no_damage():
    """Webcams leave some."""
    whole = decode_image(JPEG)
    np.testing.assert_array_equal(decode_image(JPEG[:-2] + bytes(2) + JPEG[-2:]), whole)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    latitude=st.floats(-70, 70), longitude=st.floats(1, 179), lost=st.integers(0, 2),
    text=st.booleans(), west=st.booleans(),
)  # fmt: skip
def test_hemispheres_and_fixes(tmp_path_factory, latitude, longitude, lost, text, west):
    longitude = -longitude if west else longitude
    folder: Path = tmp_path_factory.mktemp("places")
    (folder / "p").mkdir()
    for i in range(6):
        photo(folder / "p" / f"{i}.jpg", i, latitude + i * 1e-5, longitude)
    for i in range(lost):
        photo(folder / "p" / f"{6 + i}.jpg", 6 + i, 0.0, 0.0)
    for path in (folder / "p").iterdir() if not text else ():  # the letters as another type
        data = path.read_bytes()
        for letter in (b"N", b"S", b"E", b"W"):
            for tag in (b"\0\1", b"\0\3"):
                data = data.replace(tag + b"\0\2\0\0\0\2" + letter, tag + b"\0\7\0\0\0\2" + letter)
        path.write_bytes(data)
    flight, said = import_flight(folder / "p", folder / "out")
    np.testing.assert_allclose(flight.origin, (latitude, longitude), atol=1e-4)
    np.testing.assert_allclose(np.diff(flight.position[:, 1]), 1.11, atol=0.06)
    assert len(flight) == 6 and any("without a fix" in line for line in said) == bool(lost)


@pytest.mark.parametrize(
    ("names", "asked"),
    [
        (sorted(f"f{row}.png" for row in range(12)), True),
        ([f"f{row}.png" for row in range(12)], False),
        (sorted(f"f{1 + row / 25}.png" for row in range(12)), False),  # f1.04 before f1.2
    ],
)
def test_images_in_the_order_of_text_are_asked_about(tmp_path, names, asked):
    rows = ["t,x,y,image"]
    for row, name in enumerate(names):
        cv2.imwrite(str(tmp_path / name), picture(row))
        rows.append(f"{row / 10},{row},{row % 3},{name}")
    (tmp_path / "table.csv").write_text("\n".join(rows))
    said = " ".join(import_flight(tmp_path / "table.csv", tmp_path / "out")[1])
    assert ("in the order of names as text, f10.png before f2.png" in said) == asked
    assert "order of names" not in said or asked


def test_a_damaged_log_is_said_once(tmp_path, capfd):
    """Its reader wrote a line for every byte, and no word of the positions that were gone."""
    log, path = ardupilot_log(400), tmp_path / "l.bin"
    middle = len(log) // 2
    path.write_bytes(log[:middle] + bytes(37) + log[middle + 37 :])
    track, said = read_track(path, TrackColumns())
    assert len(track.time_ns) in range(395, 400) and len(said) == 1
    assert "damaged, parts were passed over" in said[0]
    path.write_bytes(log)
    assert read_track(path, TrackColumns())[1] == []
    assert capfd.readouterr().err == ""
