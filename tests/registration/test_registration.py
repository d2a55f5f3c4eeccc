"""Registration on a picture of the floor: correlation, belief, alignment, the tracker, its
trust.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from registration_tools import (
    CAMERA,
    across,
    covered,
    errors,
    flight,
    tracker_as_new,
    waypoints,
)

from trexton.base.errors import MapError
from trexton.registration.alignment import Aligner
from trexton.registration.belief import CellBelief
from trexton.registration.ground import CoarseMatcher, Ground, fine_cell
from trexton.registration.tracker import FloorTracker
from trexton.registration.trust import Trust
from trexton.simulator.floor import Floor
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import MapImage, transform_points
from trexton.vision.visual_odometry import shrink, shrunken_camera

SMALL = shrunken_camera(CAMERA, 4)


@cache
def floor() -> MapImage:
    return Floor.painted().picture


def view(pose: np.ndarray) -> np.ndarray:
    """The floor's luma as a perfect shrunken camera sees it."""
    world = CAMERA.world_from_pixel(pose[:3], pose[3:])
    matrix = np.linalg.inv(floor().world_from_pixel) @ world
    luma = cv2.cvtColor(floor().image, cv2.COLOR_BGR2GRAY)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return shrink(cv2.warpPerspective(luma, matrix, (320, 240), flags=flags, borderValue=145), 4)


# -- ground
# -------------------------------------------------------------------------------------------


def test_cells_show_the_floor_where_it_lies():
    image = np.zeros((80, 120, 3), np.uint8)
    image[20:30, 90:100] = 200
    mask = np.ones((80, 120), bool)
    mask[:, :30] = False
    ground = Ground.from_map(MapImage.from_extent(image, 1.0, 3.0, 100, mask), 0.05, margin=0.2)
    column, row = ground.to_cells([[1.95, 2.75]])[0].round().astype(int)
    assert ground.luma[row, column] == pytest.approx(200, abs=2)
    assert np.allclose(ground.to_world(ground.to_cells([[1.3, 2.4]])), [[1.3, 2.4]])
    assert np.allclose(
        transform_points(ground.from_world, [[1.3, 2.4]]), ground.to_cells([[1.3, 2.4]])
    )
    assert ground.mask.sum() == pytest.approx(90 * 80 / 25, rel=0.1)  # neither margin nor mask


def test_a_picture_without_anything_mapped_is_refused():
    image = MapImage.from_extent(
        np.zeros((20, 20, 3), np.uint8), 0, 1, 20, np.zeros((20, 20), bool)
    )
    with pytest.raises(MapError, match="nothing of the map image is mapped"):
        Ground.from_map(image, 0.05)


@pytest.mark.parametrize("metres", [0.01, 5000.0])
def test_a_picture_in_another_unit_is_refused_before_memory_is_asked_for(metres):
    image = MapImage.from_extent(np.full((20, 20, 3), 9, np.uint8), 0, metres, 20 / metres)
    with pytest.raises(MapError, match="check world_from_pixel and the heights"):
        Ground.from_map(image, 0.02, margin=0.5)


# -- correlation
# --------------------------------------------------------------------------------------


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.4, -2.9])
@pytest.mark.parametrize("place", [(2.4, 2.6), (0.5, 0.5)], ids=["inside", "corner"])
def test_correlation_peaks_where_the_frame_was_taken_at_any_yaw(place, yaw):
    matcher = CoarseMatcher(Ground.from_map(floor(), 0.05, 0.8), SMALL)
    pose = np.array([*place, 1.0, 0.05, -0.04, yaw])
    correlation, overlap = matcher.response(view(pose), pose)
    gain = Trust().gain(correlation, 8 * overlap)
    row, column = np.unravel_index(int(np.argmax(gain)), gain.shape)
    seen = transform_points(SMALL.world_from_pixel(pose[:3], pose[3:]), [SMALL.principal_point])[0]
    assert np.hypot(*(matcher.ground.to_world([column, row]) - seen)) < 0.06
    assert correlation[row, column] > 0.7 and overlap.max() <= 1.001
    window = (slice(row - 3, row + 4), slice(column - 2, column + 3))
    part, _ = matcher.response(view(pose), pose, window)
    assert np.allclose(part, correlation[window], atol=0.02)


def test_brightness_does_not_move_the_correlation():
    matcher = CoarseMatcher(Ground.from_map(floor(), 0.05, 0.8), SMALL)
    pose = np.array([2.4, 2.6, 1.0, 0, 0, 0.3])
    bright = view(pose)
    dark = np.rint(0.6 * bright + 20).astype(np.uint8)
    assert np.allclose(*(matcher.response(each, pose)[0] for each in (bright, dark)), atol=0.03)


# -- belief
# -------------------------------------------------------------------------------------------


def test_belief_moves_widens_and_finds_its_modes():
    belief = CellBelief(np.ones((40, 60), bool))
    fit = np.full((1, 40, 60), -30.0)
    fit[0, 10, 20], fit[0, 30, 50] = 0, -1
    belief.weigh(fit, (slice(0, 40), slice(0, 60)))
    belief.move(np.array([[3.0, -2.0]]), 0.5)
    first, second = belief.modes(5, 2, 0.05)
    assert first[1:3] == (8, 23) and second[1:3] == (28, 53)
    assert first[3] / second[3] == pytest.approx(np.e, rel=0.05)
    assert belief.support(1)[0].start <= 8 and belief.support(1)[1].stop >= 53
    belief.sharpen(np.array([23.4, 8.2]), np.array([23, 8]), 2)
    assert belief.around(np.array([23.4, 8.2]), 1) == pytest.approx(first[3], rel=0.01)
    belief.scale(np.array([53, 28]), 2, 0.0)
    belief.normalize()
    assert np.allclose(belief.moments()[0], [23.4, 8.2], atol=0.2)
    assert belief.around(np.array([900, 900]), 2) == 0


def test_headings_that_fit_worse_are_dropped():
    belief = CellBelief(np.ones((10, 10), bool))
    belief.reset(np.array([0.0, 1.0, 2.0]))
    fit = np.full((3, 10, 10), -20.0)
    fit[1] = 0
    belief.weigh(fit, (slice(0, 10), slice(0, 10)))
    belief.drop_headings()
    assert belief.headings == pytest.approx([1.0])


def test_belief_that_left_the_floor_starts_again():
    belief = CellBelief(np.ones((10, 10), bool))
    belief.move(np.array([[500.0, 0.0]]), 0.5)
    assert belief.mass.sum() == pytest.approx(1) and belief.mass.min() > 0


# -- alignment
# ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False], ids=["attitude", "no-attitude"])
def test_alignment_finds_the_pose_from_six_centimetres_away(known):
    aligner = Aligner(Ground.from_map(floor(), fine_cell(CAMERA, 1.0)), SMALL)
    pose = np.array([2.4, 2.6, 1.03, 0.05, -0.06, 0.3])
    start = pose + [0.05, -0.04, -0.03, *(np.zeros(3) if known else (-0.05, 0.06, 0.04))]
    deviation = np.array([np.inf, np.inf, 0.05, *([0.005] * 3 if known else [0.07] * 3)])
    found = aligner.align(view(pose), start, deviation)
    assert np.hypot(*(found.pose - pose)[:2]) < 0.004
    assert np.abs(found.pose - pose)[3:].max() < 0.005
    assert found.score > 0.8
    assert 0 < found.covariance[0, 0] < 0.01**2


def test_alignment_where_nothing_is_mapped_says_so():
    aligner = Aligner(Ground.from_map(floor(), fine_cell(CAMERA, 1.0)), SMALL)
    away = np.array([20.0, 20.0, 1, 0, 0, 0])
    found = aligner.align(view(away), away, np.full(6, 0.1))
    assert found.score == 0 and not np.isfinite(found.flow)


# -- tracker
# ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False], ids=["attitude", "no-attitude"])
def test_tracker_follows_a_flight_to_the_centimetre(known):
    tracker = tracker_as_new()
    error, fixes = errors(tracker, flight(), known)
    assert error[10:].max() < 0.03 and error[10:].mean() < 0.012
    assert not any(fix.lost for fix in fixes[10:])


def test_tracker_keeps_its_place_on_a_floor_that_repeats():
    tracker = tracker_as_new("carpet")
    error, _ = errors(tracker, flight(60, "carpet"), True)
    assert error[25:].max() < 0.05


def test_a_camera_turned_upside_down_is_followed_too():
    tracker = tracker_as_new()
    rows = [(frame[::-1, ::-1].copy(), place, tilt) for frame, place, tilt in flight(20)]
    error, fixes = errors(tracker, rows, False)
    assert error[10:].max() < 0.03
    assert abs(abs(fixes[-1].pose[5]) - np.pi) < 0.2


def test_trackers_share_nothing():
    """What one comes to believe of the heading leaves the headings that another searches alone."""
    (frame, _, attitude), *_ = flight(20)
    picture = Floor.painted("hall", 4).picture
    upside_down = frame[::-1, ::-1].copy()
    expected = FloorTracker(picture, CAMERA, 1.0).step(upside_down)
    other = FloorTracker(picture, CAMERA, 1.0)
    other.step(None)  # every heading is possible, until the autopilot tells one
    other.step(frame, attitude=attitude)
    assert FloorTracker(picture, CAMERA, 1.0).step(upside_down).pose.tolist() == (
        expected.pose.tolist()
    )


def test_kidnapped_is_noticed_and_found_again():
    tracker = tracker_as_new()
    room = Simulator(Floor.painted("hall", 4), camera=CAMERA, rng=np.random.default_rng(2))
    for _ in range(8):
        state = room.step(None)
        fix = tracker.step(room.render(), attitude=state.attitude)
    assert not fix.lost
    room.vehicle.teleport((1.0, 1.2))
    found = []
    for _ in range(12):
        state = room.step(None)
        fix = tracker.step(room.render(), attitude=state.attitude)
        right = np.hypot(*(fix.position - state.position[:2])) < 0.1
        assert right or fix.lost
        found.append(right and not fix.lost)
    assert all(found[6:])


def test_frames_that_do_not_come_widen_the_covariance():
    tracker = tracker_as_new()
    assert tracker.step(None).lost and np.isnan(tracker.step(None).position).all()
    _, fixes = errors(tracker, flight(12), True)
    gone = tracker.step(None)
    assert not gone.observed and gone.covariance[0, 0] > fixes[-1].covariance[0, 0]


@pytest.mark.parametrize("every", [2, 4])
@pytest.mark.parametrize("known", [True, False])
def test_frames_that_do_not_come_are_bridged(every, known):
    tracker = tracker_as_new()
    rows = waypoints()
    seen, between = [], []
    for number, (frame, place, attitude) in enumerate(rows):
        came = number % every == 0
        fix = tracker.step(frame if came else None, attitude=attitude if came and known else None)
        assert fix.observed == came
        if number >= 24:
            off = fix.position - place[:2]
            claimed = off @ np.linalg.solve(fix.covariance, off)
            (seen if came else between).append((np.hypot(*off), claimed, fix.lost))
    for rows, nearly in ((seen, 0.03), (between, 0.15)):
        off, claimed, lost = np.transpose(rows)
        assert np.quantile(off, 0.9) < nearly
        assert lost.mean() < 0.1
        assert np.mean(claimed < 4.605) > 0.7


def test_a_long_gap_ends_where_the_vehicle_has_got_to():
    tracker = tracker_as_new()
    rows = waypoints()
    errors(tracker, rows[:20], True)
    gap = [tracker.step(None) for _ in range(25)]
    assert [fix.lost for fix in gap] == [False] * 11 + [True] * 14
    widths = [fix.covariance[0, 0] for fix in gap]
    assert widths == sorted(widths)
    error, fixes = errors(tracker, rows[45:55], True)
    assert error[-4:].max() < 0.05 and not fixes[-1].lost


def test_a_sight_of_nothing_is_coasted_over_and_then_given_up():
    tracker = tracker_as_new()
    rows = flight(12)
    errors(tracker, rows, True)
    blank = np.full((240, 320, 3), 128, np.uint8)
    fixes = [tracker.step(blank, attitude=rows[-1][2]) for _ in range(15)]
    assert np.hypot(*(fixes[0].position - rows[-1][1][:2])) < 0.1
    assert fixes[-1].lost
    assert fixes[-1].covariance[0, 0] > 0.2


def test_what_is_expected_while_lost_is_a_place_and_a_heading():
    """A floor may be nearly its own half turn, and its places score as well from there."""
    belief = CellBelief(np.ones((40, 40), bool))
    belief.reset(np.array([0.1, np.pi]))
    belief.mass[0] = 0
    belief.normalize()
    belief.expect(np.array([10, 20]), 3, heading=0.0)
    assert belief.mass[0].sum() == pytest.approx(0.5)
    assert belief.mass[0, 17:24, 7:14].sum() == pytest.approx(0.5)
    belief.expect(np.array([10, 20]), 3, heading=1.5)  # not among them any more: any may be it
    assert belief.mass[1].sum() == pytest.approx(0.5)


def test_a_fine_print_is_held_between_two_cells():
    """It fits no cell there, and another place a period away fits one."""
    error, fixes = errors(tracker_as_new("carpet"), waypoints(185, "carpet")[80:], True)
    assert sum(fix.lost for fix in fixes[5:]) < 20 and error[5:].max() < 0.3


def test_where_a_print_repeats_a_place_in_doubt_moves_on_as_before(monkeypatch):
    """Odometry may be a period off there, frame after frame, and says so only by its certainty."""
    tracker = tracker_as_new("carpet")
    shift, wrong = tracker.odometry.shift, [10]

    def a_period_off(frame):
        moved, sure = shift(frame)
        if not (tracker._carried and tracker._last.lost and wrong[0]):
            return moved, sure
        wrong[0] -= 1
        return moved + (13.0, 0.0), 0.2

    monkeypatch.setattr(tracker.odometry, "shift", a_period_off)
    error, fixes = errors(tracker, waypoints(185, "carpet")[80:], True)
    assert sum(fix.lost for fix in fixes[5:]) > 5 and error[5:].max() < 0.6 and not wrong[0]


def test_over_a_rug_odometry_says_where_until_a_place_is_certain():
    """Places far away fit better than the true one, whose floor lies under the rug."""
    picture = Floor.painted("carpet", 4).picture
    rows, columns = picture.image.shape[:2]
    image = covered(picture.image, rows // 3, columns // 3, rows // 4, columns // 4)
    flown = across(replace(picture, image=image), (0.8, 2.9), (4.4, 3.0), 90)
    error, fixes = errors(FloorTracker(picture, CAMERA, 1.0), flown, False)
    lost = np.array([fix.lost for fix in fixes])
    assert lost[5:].any() and error[5:].max() < 0.3


def test_a_place_that_looks_like_the_floor_under_a_rug_is_not_taken_for_it():
    """Half a room away lies, a little soiled, the floor that the rug makes of this one."""
    picture = Floor.painted("hall", 4).picture
    rows, columns = picture.image.shape[:2]
    half = columns // 2
    changed = covered(picture.image, rows // 2, columns // 6, rows // 3, columns // 5)
    dirt = np.random.default_rng(3).normal(0, 110, (rows // 40, half // 40, 3))
    surveyed = picture.image.copy()
    surveyed[:, half:] = np.clip(changed[:, :half] + cv2.resize(dirt, (half, rows)), 0, 255)
    flown = across(replace(picture, image=changed), (1.3, 4.4), (1.3, 0.5), 80)
    tracker = FloorTracker(replace(picture, image=surveyed), CAMERA, 1.0, trust=Trust(least=0.54))
    error, fixes = errors(tracker, flown, False)
    lost = np.array([fix.lost for fix in fixes])
    assert lost.sum() > 12 and not (error[~lost] > 0.1).any()
    assert error[-1] < 0.1  # odometry carries it over the rug


@pytest.mark.parametrize("known", [True, False])
def test_a_camera_of_three_frames_a_second_is_followed_around_corners(known):
    tracker = tracker_as_new()
    error, fixes = errors(tracker, waypoints()[::4], known)
    assert error[6:].max() < 0.05
    assert np.mean([fix.lost for fix in fixes[6:]]) < 0.25


def test_a_place_in_doubt_is_looked_for_on_the_whole_floor():
    """A metre off another print looks the same; nothing is believed of the true one any more."""
    tracker, rows = tracker_as_new("carpet"), waypoints(185, "carpet")
    errors(tracker, rows[:20], True)
    false = tracker._last.pose + (0, 1, 0, 0, 0, 0)
    column, row = np.rint(tracker.coarse.ground.to_cells(false[:2])).astype(int)
    tracker.belief.mass[:] = 0
    tracker.belief.mass[:, row - 3 : row + 4, column - 3 : column + 4] = 1
    tracker.belief.normalize()
    tracker._pose, tracker._last = false, replace(tracker._last, pose=false, lost=True)
    error, fixes = errors(tracker, rows[20:60], True)
    lost = np.array([fix.lost for fix in fixes])
    assert lost.any() and not lost[20:].any() and error[20:].max() < 0.05


def test_a_first_place_must_fit_as_well_as_training_frames_do():
    """One that fits as a view half covered does may be another that looks alike."""
    tracker = tracker_as_new()
    rows = waypoints(40)
    score = min(fix.score for fix in errors(tracker, rows, True)[1][5:])
    for least, found in ((0.55, True), (0.65, False)):
        tracker.reset()
        tracker.trust = Trust(least=least * score)
        assert errors(tracker, rows, True)[1][-1].lost != found
