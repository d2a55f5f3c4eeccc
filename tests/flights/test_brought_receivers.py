"""Tracks of receivers and autopilots: positions that are held, references set anew, compasses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_logs import px4_log
from sound_flights import SOUND, sound

from trexton.flights.importers.recording import PoseTrack
from trexton.flights.importers.tracks import TrackColumns, read_track
from trexton.flights.importing import _between_fixes
from trexton.flights.tracking import lost_rows

N = 10**9


@pytest.mark.parametrize("rows", [2, 3, 30])
def test_places_that_a_slow_receiver_repeats_are_taken_on_the_way(rows):
    """A video's subtitles hold each fix until the next; stops and the last fix stay as they are."""
    stamps = np.arange(40 * rows) * N // 30
    last = np.maximum.accumulate(np.where(np.arange(len(stamps)) % rows == 0, stamps, 0)) / N
    go = np.clip(last, 0, 20 * rows / 30) + np.clip(last - 25 * rows / 30, 0, None)
    place = np.column_stack([2 * go, np.sin(go), 0 * go])
    moving = replace(PoseTrack(stamps, place), origin=(47.0, 8.0))
    track, said = _between_fixes(moving)
    assert said[0].startswith(f"positions are new every {rows} rows and repeat between")
    true = np.clip(stamps / N, 0, 20 * rows / 30) + np.clip(stamps / N - 25 * rows / 30, 0, None)
    known = np.arange(len(stamps)) <= 39 * rows
    np.testing.assert_allclose(track.position[known, 0], 2 * true[known], atol=1e-6)
    assert np.isnan(track.position[~known, 0]).all() and track.origin == moving.origin
    assert not lost_rows(stamps / N, track.position)


@pytest.mark.parametrize("kind", sorted(SOUND))
def test_sound_tracks_are_taken_as_they_are(kind):
    flight = sound(kind, 3, 400)
    heights = np.ones((400, 1))
    for digits in (9, 2):  # as exports round
        place = np.hstack([flight.position.round(digits), heights])
        track = PoseTrack(np.rint(flight.time * N).astype(np.int64), place)
        assert _between_fixes(track)[1] == [] or "held" in kind


def test_a_reference_that_px4_sets_anew_in_flight_moves_no_place(tmp_path):
    def reference(i: int) -> tuple[float, float]:
        return (np.nan, 0.0) if i < 3 else (47.0, 0.0) if i < 9 else (47 + 20 / 111_178, -20.0)

    (tmp_path / "a.ulg").write_bytes(px4_log(reference=reference))
    track, _ = read_track(tmp_path / "a.ulg", TrackColumns())
    np.testing.assert_allclose(track.position[:, 1], np.arange(1, 20), atol=1e-2)
    np.testing.assert_allclose(track.origin, (47, 8))


@pytest.mark.parametrize(("name", "said_so"), [("heading_deg", True), ("yaw_deg", False)])
def test_a_compass_is_asked_about(tmp_path, name, said_so):
    (tmp_path / "t.csv").write_text(
        f"t,x,y,{name}\n" + "".join(f"{i},{i},0,90\n" for i in range(9))
    )
    _, said = read_track(tmp_path / "t.csv", TrackColumns(yaw=name))
    assert any("of a compass? give --yaw=-heading_deg" in line for line in said) == said_so
    track, said = read_track(tmp_path / "t.csv", TrackColumns(yaw=f"-{name}"))
    assert not said
    np.testing.assert_allclose(track.attitude[:, 2], -np.pi / 2)
