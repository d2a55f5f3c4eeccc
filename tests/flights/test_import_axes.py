"""Quaternions are turned as they are meant, by axes that are given or estimated, and positions
and attitudes matched with the frames."""

import numpy as np
import pytest

from trexton.base.errors import TrextonError
from trexton.flights.importers.axes import AXES, attitude_from_quaternions
from trexton.flights.importers.recording import PoseTrack, match
from trexton.flights.importers.tracks import TrackColumns, read_track


@pytest.mark.parametrize(
    ("axes", "turned", "yaw"),
    [("flu", "0 0 0 1", -90), ("rfu", "0 0 0 1", 0), ("camera", "1 0 0 0", 0)],
)
def test_axes_are_told_or_found_by_where_the_camera_looks(tmp_path, axes, turned, yaw):
    path = tmp_path / "track.txt"
    path.write_text(f"0 0 0 1 {turned}\n1 0 0 1 {turned}\n")
    for asked in {axes, "auto"} - ({"auto"} if axes == "rfu" else set()):
        track, said = read_track(path, TrackColumns(axes=asked))
        np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, yaw]] * 2, atol=1e-9)
        assert said[0].endswith(axes)


def test_quaternions_agree_with_the_camera_model():
    from scipy.spatial.transform import Rotation

    from trexton.vision.camera import rotation_matrix

    angles = np.random.default_rng(1).uniform(-1.2, 1.2, (40, 3))
    turned = [Rotation.from_matrix(rotation_matrix(*each)).as_quat() for each in angles]
    np.testing.assert_allclose(attitude_from_quaternions(turned, AXES["rfu"]), angles, atol=1e-12)
    assert np.isnan(attitude_from_quaternions(np.zeros((1, 4)), AXES["rfu"])).all()


def test_matching_respects_tolerance_gaps_and_the_short_way_round():
    track = PoseTrack(
        np.array([0, 1, 2, 5]) * 10**9,
        np.column_stack([np.arange(4.0), np.zeros(4), np.full(4, np.nan)]),
        np.column_stack([np.zeros(4), np.zeros(4), [3.1, -3.1, 3.1, 0]]),
    )
    stamps = np.array([0.0, 0.5, 2.0, 3.5, 5.4, 6.0]) * 1e9
    found, _ = match(stamps.astype(np.int64), track, 0.5)
    np.testing.assert_array_equal(np.isfinite(found.position[:, 0]), [1, 1, 1, 0, 1, 0])
    assert abs(abs(found.attitude[1, 2]) - np.pi) < 1e-6
    with pytest.raises(TrextonError, match="give the time offset"):
        match(np.array([10**12]), track, 0.5)
