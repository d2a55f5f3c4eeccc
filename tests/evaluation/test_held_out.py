"""Stretches of a training flight, flown by maps that did not see them."""

from dataclasses import dataclass, field
from unittest import mock

import numpy as np
import pytest
from onboard_tools import CAMERA, colourful_flight, narrow_floor
from small_room import histogram_flight

from trexton.base.errors import MapError
from trexton.cli import train
from trexton.cli.main import main
from trexton.evaluation import held_out
from trexton.evaluation.held_out import (
    STRETCH_S,
    WARM_S,
    Assessment,
    assess,
    replay,
    stretches,
)
from trexton.flights.writing import write_flight
from trexton.localization.map_files import load_map
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import train_map
from trexton.simulator.recording import record_flight


@pytest.fixture(scope="module")
def plain():
    flight = histogram_flight("hall", frames=160, turns=6.0)
    return train_map(flight, rng=np.random.default_rng(1))


def test_replay_flies_what_its_map_did_not_see(plain):
    own = TextonMap.select
    with mock.patch.object(TextonMap, "select", autospec=True, side_effect=own) as selected:
        flown = list(replay(plain, samples=50, rng=np.random.default_rng(2)))
    every = stretches(plain.time)
    half = len(every) // 2
    settled = int(np.ceil(WARM_S / plain.period_s))
    assert len(flown) == 2 * sum(len(rows) - settled for rows in every[: 2 * half])
    first = every[0][settled:]
    places = [truth for truth, _ in flown[: len(first)]]
    np.testing.assert_array_equal(places, plain.positions[first])
    kept = selected.call_args_list[0].args[1]
    assert np.abs(np.subtract.outer(plain.time[kept], plain.time[every[0]])).min() > 0.4
    assert len(every[0]) * plain.period_s == pytest.approx(STRETCH_S + WARM_S, abs=0.3)
    short = np.arange(130) * 0.1  # two stretches of a short flight leave half of it
    every = stretches(short)
    left_out = {row for rows in (every[0], every[len(every) // 2]) for row in rows}
    assert len(left_out) < 70 and all(rows[-1] * 0.1 > WARM_S for rows in every)
    with pytest.raises(MapError, match="longer one"):
        stretches(np.arange(20) * 0.25)


def test_stretches_lie_where_was_flown():
    """A flight with a pause of an hour was judged by the few frames about its ends."""
    without = np.arange(600) * 0.1
    paused = without + 3600.0 * (np.arange(600) >= 300)
    for rows, same in zip(stretches(paused), stretches(without), strict=True):
        assert np.abs(rows[[0, -1]] - same[[0, -1]]).max() <= 1


def test_an_assessment_is_of_all_frames_and_of_what_is_claimed(plain):
    found = assess(plain, rng=np.random.default_rng(2))
    flown = list(replay(plain, samples=400, rng=np.random.default_rng(2)))
    assert found.frames == len(flown)
    assert found.error_m == pytest.approx(
        np.mean([np.hypot(*(each.position - truth)) for truth, each in flown])
    )
    assert 0 <= found.lost_share <= 1 and 0 <= found.coverage_90 <= 1


@dataclass
class Named:
    """A map of which only the method matters."""

    method: str
    provenance: dict = field(default_factory=dict)
    positions: tuple = ()
    period_s: float = 0.1


class TestTrain:
    """What is trained for flying unless a method is named; judged by four stretches, not eight."""

    @pytest.fixture(autouse=True)
    def four_stretches(self, monkeypatch):
        monkeypatch.setattr(held_out, "MOST_STRETCHES", 4)

    def trained(self, folder, tmp_path, *words):
        assert main(["train", str(folder), "-o", str(tmp_path / "map.npz"), *words]) == 0
        return load_map(tmp_path / "map.npz")

    def test_histograms_are_trained_for_the_field(self, tmp_path, capsys):
        write_flight(histogram_flight("hall", frames=160, turns=6.0), tmp_path / "hall")
        made = self.trained(tmp_path / "hall", tmp_path)
        said = capsys.readouterr().err
        assert made.method == "field" and "method field, chosen for flying: " in said
        found = made.provenance["assessment"]
        assert f"{found['coverage_90']:.0%} of the others" in said
        assert (found["coverage_90"] < 0.8) == ("OVERCONFIDENT" in said)

    def test_the_papers_by_name_or_by_what_only_it_reads(self, tmp_path):
        write_flight(histogram_flight("hall", frames=160, turns=6.0), tmp_path / "hall")
        for words in (
            ["--method", "paper"],
            ["--set", "measurement.neighbors=3"],
            ["--set", "motion=random-walk"],
        ):
            assert self.trained(tmp_path / "hall", tmp_path, *words).method == "paper"

    def test_images_and_a_camera_are_trained_for_what_errs_less(
        self, tmp_path, capsys, monkeypatch
    ):
        monkeypatch.setattr(held_out, "MOST_STRETCHES", 2)
        room = {"camera": CAMERA, "floor": narrow_floor()}
        record_flight(tmp_path / "room", frames=120, every=2, **room)
        made = self.trained(tmp_path / "room", tmp_path, "--textons", "8")
        said = capsys.readouterr().err
        other = {"field": "fine", "fine": "field"}[made.method]
        assert f"({other} " in said and made.provenance["assessment"]["frames"] > 50

    @pytest.mark.parametrize(
        ("of_field", "of_fine", "chosen"),
        [
            ((0.4, 0.1, 0.85), (0.01, 0.0, 0.7), "field"),
            ((0.4, 0.1, 0.85), (0.5, 0.0, 0.9), "field"),
            ((0.4, 0.1, 0.85), (0.01, 0.0, 0.9), "fine"),
            ((0.4, 0.9, 0.85), (0.01, 0.0, 0.7), "fine"),  # what is always lost is no use
            ((0.4, 1.0, None), (0.5, 0.0, 0.7), "field"),
        ],
    )
    def test_an_honest_method_is_chosen_before_a_nearer_one(
        self, tmp_path, monkeypatch, of_field, of_fine, chosen
    ):
        """The nearer was taken for flying, of which the same lines said not to steer by it."""
        shown = {"field": of_field, "fine": of_fine}
        monkeypatch.setattr(train, "train_map", lambda flight, method, **more: Named(method))
        monkeypatch.setattr(
            train, "assess", lambda made, *frames, rng: Assessment(99, *shown[made.method])
        )
        monkeypatch.setattr(train, "save_map", lambda made, path: saved.append(made.method))
        saved = []
        colourful_flight(tmp_path / "room", frames=6)
        assert main(["train", str(tmp_path / "room"), "-o", str(tmp_path / "map.npz")]) == 0
        assert saved == [chosen]

    def test_a_map_that_was_renewed_is_judged_anew(self, tmp_path, capsys):
        """It went on with what the old map was worth."""
        folder, old, new = tmp_path / "hall", tmp_path / "map.npz", tmp_path / "new.npz"
        write_flight(histogram_flight("hall", frames=160, turns=6.0), folder)
        before = self.trained(folder, tmp_path).provenance["assessment"]
        later = histogram_flight("later", frames=160, turns=6.0, noise=5)
        write_flight(later, tmp_path / "later")
        capsys.readouterr()
        assert main(["train", "--update", str(old), str(tmp_path / "later"), "-o", str(new)]) == 0
        found = load_map(new).provenance["assessment"]
        assert found != before
        assert f"{100 * found['error_m']:.0f} cm mean error" in capsys.readouterr().err

    def test_a_flight_too_short_to_tell_is_trained_all_the_same(self, tmp_path, capsys):
        write_flight(histogram_flight("hall", frames=40), tmp_path / "hall")
        made = self.trained(tmp_path / "hall", tmp_path)
        assert "too short to tell" in capsys.readouterr().err
        assert made.method == "field" and "assessment" not in made.provenance
