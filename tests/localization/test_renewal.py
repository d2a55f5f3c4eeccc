"""A map that a later flight renews."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from small_room import histogram_flight, picture_flight

from trexton.base.errors import FlightError, MapError, ParameterError
from trexton.cli.main import main
from trexton.companion.build.flight_pairs import load_pair
from trexton.evaluation.held_out import assess
from trexton.flights.writing import write_flight
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import save_map
from trexton.localization.renewal import renewed
from trexton.localization.training import train_map
from trexton.vision.camera import Rectification


def changed(flight):
    """As if a rug lay on the left half: another texton is seen there."""
    rug = np.where(flight.position[:, :1] < 2, np.roll(flight.histograms, 2, axis=1), 0)
    return replace(flight, histograms=np.where(rug.any(axis=1)[:, None], rug, flight.histograms))


@pytest.mark.parametrize("method", ["field", "paper"])
def test_frames_of_a_changed_place_are_replaced_and_others_stay(method):
    old = histogram_flight("old", frames=120)
    rng = np.random.default_rng(0)
    texton_map = train_map(old, method=method, rng=rng)
    later = changed(histogram_flight("later", frames=120, noise=2))
    new, replaced = renewed(texton_map, later, rng=rng)
    kept = new.positions[: 120 - replaced]
    assert replaced > 20 and len(new.positions) == 240 - replaced
    assert np.mean(kept[:, 0] < 1.9) < 0.25 < np.mean(old.position[:, 0] < 1.9)
    assert (np.diff(new.time) > 0).all()
    test = changed(histogram_flight("test", frames=90, noise=3))

    def error(which):
        nearest = Localizer(which, rng=np.random.default_rng(1)).nearest
        found = [nearest.query(each).position.mean(axis=0) for each in test.histograms]
        return np.hypot(*(np.array(found) - test.position).T).mean()

    assert error(new) < error(texton_map)


def test_a_changed_place_is_found_by_values_below_zero():
    """Roots of strengths of signals are all zero: no old frame was ever replaced."""
    rng = np.random.default_rng(0)

    def signals(flight):
        return replace(flight, features="signals", histograms=100 * flight.histograms - 90)

    texton_map = train_map(signals(histogram_flight("old", frames=120)), method="field", rng=rng)
    later = histogram_flight("later", frames=120, noise=2)
    assert renewed(texton_map, signals(changed(later)), rng=rng)[1] > 20
    assert renewed(texton_map, signals(later), rng=rng)[1] < 12


def test_counts_do_not_renew_relative_frequencies():
    rng = np.random.default_rng(0)
    texton_map = train_map(histogram_flight("old", frames=120), rng=rng)
    later = histogram_flight("later", frames=120, noise=2)
    counts = replace(later, features="counts", histograms=400 * later.histograms)
    with pytest.raises(MapError, match="divide counts by their sum"):
        renewed(texton_map, counts, rng=rng)


def test_frames_that_the_map_has_are_refused():
    """Each left-out frame found its own copy: any map became honest, and landed."""
    old = histogram_flight("old", frames=120)
    rng = np.random.default_rng(0)
    texton_map = train_map(old, method="field", rng=rng)
    for again in (old, replace(old, name="a part", split={}).select(np.arange(60, 120))):
        with pytest.raises(ParameterError, match=f"{len(again)} frames of .* are in the map"):
            renewed(texton_map, again, rng=rng)
    new, _ = renewed(texton_map, histogram_flight("later", frames=120, noise=2), rng=rng)
    with pytest.raises(ParameterError, match="frames of 'old' are in the map"):
        renewed(new, old, rng=rng)
    elsewhere = replace(old, position=old.position + 0.1)  # few values may be sensed anywhere
    assert renewed(texton_map, elsewhere, rng=rng)


def test_what_renews_nothing_is_refused():
    flight = histogram_flight("old")
    texton_map = train_map(flight, rng=np.random.default_rng(0))
    rng = np.random.default_rng(0)
    with pytest.raises(MapError, match="no frame with a position"):
        renewed(texton_map, replace(flight, position=np.full((60, 2), np.nan)), rng=rng)
    with pytest.raises(FlightError, match="has 4 features a frame where 5 features a frame were"):
        renewed(texton_map, replace(flight, histograms=np.full((60, 4), 0.25)), rng=rng)
    with pytest.raises(ParameterError, match="method fine holds pictures"):
        renewed(replace(texton_map, method="fine"), flight, rng=rng)


def test_a_flight_beside_the_map_or_of_another_camera_does_not_renew_it(tmp_path, capsys):
    rng = np.random.default_rng(0)
    flight = histogram_flight("old", frames=120)
    texton_map = train_map(flight, rng=rng)
    aside = replace(histogram_flight("later", noise=2), position=flight.position[:60] + (20, 0))
    with pytest.raises(MapError, match="100% of the positions of 'later' lie beside the map"):
        renewed(texton_map, aside, rng=rng)
    pictured = picture_flight(tmp_path / "a", "pictured")
    texton_map = train_map(pictured, method="paper", rng=rng)
    lens = Rectification((96, 72), (0, 0, 96, 72), (48, 36), 90.0, (48, 36), (0.1, 0, 0, 0))
    undistorted = replace(pictured, rectification=lens)
    with pytest.raises(FlightError, match="has undistorted images of 48x36 pixels where images"):
        renewed(texton_map, undistorted, rng=rng)
    part = Rectification((96, 72), (48, 36, 48, 36), (48, 36))
    with pytest.raises(FlightError, match="shows 50% x 50% of the camera's picture, from 50%, 50%"):
        renewed(texton_map, replace(pictured, rectification=part), rng=rng)
    save_map(texton_map, tmp_path / "map.npz")
    other = write_flight(replace(pictured, rectification=part), tmp_path / "other")
    assert main(["onboard", str(tmp_path / "map.npz"), "--camera", str(other), "-q"]) == 1
    assert "not 100% x 100%" in capsys.readouterr().err
    small = picture_flight(tmp_path / "b", "small")
    for file in small.frames.files:
        cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file)), (24, 18)))
    with pytest.raises(FlightError, match="images of 24x18 pixels where images of 48x36"):
        renewed(texton_map, small, rng=rng)
    with pytest.raises(FlightError, match="images of 24x18 pixels where images of 48x36"):
        later = replace(small, position=small.position + 0.1)
        load_pair(write_flight(pictured, tmp_path / "A"), write_flight(later, tmp_path / "B"))


def test_every_renewal_is_recorded():
    rng = np.random.default_rng(0)
    texton_map = train_map(histogram_flight("old", frames=120), rng=rng)
    for noise in (2, 3):
        later = histogram_flight(f"later {noise}", frames=120, noise=noise)
        texton_map, _ = renewed(texton_map, later, rng=rng)
    assert [name for name, _ in texton_map.provenance["renewed"]] == ["later 2", "later 3"]


def test_a_place_far_away_does_not_blow_up_the_map():
    """One position of a kilometre made the area one: errors grew to kilometres."""
    rng = np.random.default_rng(0)
    texton_map = train_map(histogram_flight("old", frames=120), method="field", rng=rng)
    later = histogram_flight("later", frames=120, noise=2)
    position = later.position.copy()
    position[7] = (1e3, 0)
    with pytest.raises(MapError, match="positions far beside the map"):
        renewed(texton_map, replace(later, position=position), rng=rng)


def test_a_flight_at_another_heading_is_refused():
    """Its frames took the places of those that fit, and the verdict was honest."""
    rng = np.random.default_rng(0)
    texton_map = train_map(histogram_flight("old", frames=120), method="field", rng=rng)
    held = texton_map.parts["appearance"].with_learned(survey_yaw=np.array(0.1))
    texton_map = replace(texton_map, parts=texton_map.parts | {"appearance": held})
    later = histogram_flight("later", frames=120, noise=2)
    for turned, refused in ((0.0, False), (np.nan, False), (2 * np.pi, False), (np.pi, True)):
        attitude = np.column_stack([np.zeros((120, 2)), np.full(120, 0.1 + turned)])
        if refused:
            with pytest.raises(MapError, match="180 degrees to the map's heading"):
                renewed(texton_map, replace(later, attitude=attitude), rng=rng)
        else:
            assert len(renewed(texton_map, replace(later, attitude=attitude), rng=rng)[0].time)


def test_the_verdict_on_a_renewed_map_is_of_as_many_frames():
    """Its stretches fell into the pause between the flights: few frames, and kind ones."""
    rng = np.random.default_rng(0)
    old = histogram_flight("old", frames=120)
    texton_map = train_map(old, method="field", rng=rng)
    new, _ = renewed(texton_map, histogram_flight("later", frames=120, noise=2), rng=rng)
    judged = [assess(each, rng=np.random.default_rng(1)).frames for each in (texton_map, new)]
    assert judged[1] > 1.5 * judged[0]
