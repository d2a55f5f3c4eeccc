"""The three homography experiments on a small simulated flight, whose geometry is known."""

import cv2
import numpy as np
import pytest

from trexton.companion.experiments import homography_baseline, homography_training, mosaic
from trexton.companion.experiments.homography_training import filtered_positions
from trexton.companion.experiments.mosaic import (
    locate_all,
    stitched_map,
)
from trexton.companion.experiments.style import COLORS
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Forty frames that follow each other closely enough to be linked, and eight of another
    flight.
    """
    folder = tmp_path_factory.mktemp("flights")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TREXTON_CACHE", str(tmp_path_factory.mktemp("cache")))
        # Small pictures: SIFT of the whole hall would take longer than everything else.
        hall = cv2.resize(Floor.painted().picture.image, (960, 960), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / "hall.png"), hall)
        room = {
            "floor": Floor.from_file(folder / "hall.png", 5.0),
            "camera": Camera(width=320, height=240, focal=260.0),
            "every": 2,
        }
        train = record_flight(folder / "train", frames=40, **room)
        test = record_flight(folder / "test", pattern="waypoints", frames=8, **room)
        yield train, test


def test_fixes_on_the_true_floor_are_right(flights):
    _, test = flights
    position = locate_all(test.floor, test)
    error = np.hypot(*(position - test.position).T)
    assert np.isfinite(position).all()
    # What is left is the tilt, which the method does not know: a metre of height times a few
    # degrees.
    tilt = np.hypot(*np.tan(test.attitude[:, :2]).T) * test.height
    assert (error < tilt + 0.03).all()


def test_the_mosaic_record_says_what_the_mosaic_is(flights):
    train, _ = flights
    record = mosaic.run(train, train, mosaic.Parameters())
    stitched = stitched_map(train)  # from the cache
    assert record.values["used"] == stitched.used.sum()
    assert record.values["links"] == len(stitched.errors)
    off = np.hypot(*(stitched.poses[:, :2] - train.position).T)
    assert (stitched.left_out > off[stitched.anchors]).all()
    off[stitched.anchors] = stitched.left_out
    off = off[stitched.used]
    median = record.values["frame_position_error_cm"]["median"]
    assert median == pytest.approx(100 * np.median(off)) and median < 5
    plan = mosaic.stitched(record).axes[0]
    np.testing.assert_array_equal(plan.lines[1].get_xydata(), train.position[stitched.anchors])


def test_the_baseline_counts_failures_and_shows_the_fixes(flights):
    train, test = flights
    record = homography_baseline.run(train, test, homography_baseline.Parameters())
    position = np.array(record.series["mosaic_m"], dtype=float)
    lost = int((~np.isfinite(position).all(axis=1)).sum())
    assert record.values["mosaic"]["missing"] == lost
    error = np.abs(position - test.position)[np.isfinite(position).all(axis=1)]
    assert record.values["mosaic"]["error_cm_x"]["value"] == pytest.approx(100 * error[:, 0].mean())
    drawn = {line.get_label(): line for line in homography_baseline.fixes(record).axes[0].lines}
    np.testing.assert_array_equal(
        drawn["homography"].get_xydata(), position[np.isfinite(position).all(axis=1)]
    )
    assert drawn["homography"].get_color() == COLORS["homography"]


def test_filtering_drops_outliers_fills_gaps_and_keeps_the_rest():
    time = np.arange(80) * 0.08
    truth = np.column_stack([0.5 * time, 1 + 0.3 * np.sin(time)])
    position = truth.copy()
    position[[10, 40]] += 3.0
    position[20:23] = np.nan
    before = position.copy()
    found = filtered_positions(position)
    np.testing.assert_allclose(found[4:-4], truth[4:-4], atol=0.02)
    np.testing.assert_array_equal(position, before)  # the input is left as it was


def test_training_on_homography_positions_differs_only_in_them(flights):
    train, test = flights
    record = homography_training.run(
        train,
        test,
        homography_training.Parameters(samples=60, textons=6, particles=20, neighbors=2, repeats=2),
    )
    values = record.values
    assert values["filter"]["frames"] == len(test)
    position = locate_all(stitched_map(train).map, train)
    known = np.isfinite(position).all(axis=1)
    assert values["filter_training"]["missing"] == (~known).sum()
    assert values["filter_training"]["error_cm_y"]["value"] == pytest.approx(
        100 * np.abs(position - train.position)[known, 1].mean()
    )
    assert min(values[f"{name}_process_std_cm"] for name in ("filter", "remedy", "mocap")) > 0
    lines = homography_training.estimate_errors(record).axes[0].lines
    estimate = np.array(record.series["remedy_estimate_m"])
    np.testing.assert_allclose(lines[2].get_ydata(), 100 * np.abs(estimate - test.position)[:, 0])
    assert lines[0].get_color() == COLORS["paper"] and lines[2].get_color() != COLORS["field"]
