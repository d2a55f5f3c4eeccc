"""The bench: its yardsticks compute what they claim to, its rows say what was measured. No time is
asserted.
"""

from __future__ import annotations

import json
import time
from functools import cache, partial

import numpy as np
import pytest
from small_room import observations, random_walk, rank_mixture

from trexton.base.errors import ParameterError
from trexton.cli import main as cli
from trexton.companion.checks import bench, timing
from trexton.companion.checks.bench import STAGES, Scene, measure
from trexton.companion.checks.timing import Contest, interleave, table
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.timing import stage_seconds
from trexton.companion.provenance import machine
from trexton.localization.filters import ParticleFilter
from trexton.localization.localizer import Localizer
from trexton.localization.particle_parts import MaximumAPosteriori
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera, MapImage
from trexton.vision.threads import thread_count


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Of a short flight of small images over a corner of the hall."""
    scene = Scene(tmp_path_factory.mktemp("bench"), frames=40)
    corner = Floor.painted().picture.image[:1024, :1024]
    scene.flight = record_flight(
        scene.folder / "flight", frames=40, seed=1,
        camera=Camera(320, 240, 260.0), floor=Floor(MapImage.from_extent(corner, 0.0, 2.0, 512)),
    )  # fmt: skip
    return scene


@pytest.fixture(scope="module")
def contests(scene):
    """Those of a stage, whose maps and pictures are learned once."""
    return cache(lambda stage: list(STAGES[stage](scene)))


@pytest.fixture
def hurried(monkeypatch):
    """Every contestant a few times: what is measured matters here, not how long it took."""
    brief = partial(interleave, seconds=1e-4, rounds=1)
    monkeypatch.setattr(timing, "interleave", lambda *calls, **_: brief(*calls))


def test_contestants_take_turns_and_all_calls_count():
    calls = []
    taken = interleave(
        *(lambda name=name: calls.append(name) for name in "ab"), seconds=1e-4, rounds=4
    )
    assert calls[:4] == ["a", "a", "b", "b"]  # to warm up
    turns = [
        name for name, before in zip(calls[4:], [None, *calls[4:]], strict=False) if name != before
    ]
    assert turns == list("abababab")
    assert [len(each) for each in taken] == [calls.count(name) - 2 for name in "ab"]
    assert all((each >= 0).all() for each in taken)


def test_what_takes_long_is_called_once_where_one_round_is_asked():
    calls = []

    def slow():
        calls.append(time.sleep(0.02))

    (taken,) = interleave(slow, seconds=1e-3, rounds=1)
    assert len(calls) == len(taken) == 1 and taken[0] >= 0.02
    assert len(interleave(slow, seconds=1e-3, rounds=2)[0]) == 2


def test_rows_compare_medians_with_a_yardstick(monkeypatch):
    seconds = [np.array([1.0, 2.0, 6.0]), np.array([1.0, 8.0, 90.0])]
    monkeypatch.setattr(timing, "interleave", lambda *_, **__: seconds)
    held = Contest("stage", 7, print, "other", print, 0.5, threads=2, share=0.5).row()
    assert (held["ours_s"], held["yardstick_s"], held["ratio"]) == (2.0, 4.0, 0.5)
    assert held["holds"] is True and held["size"] == "7" and held["threads"] == 2
    assert held["p99_s"] == pytest.approx(5.92)
    missed = Contest("stage", 7, print, "sum", print, 0.2).row()
    assert missed["holds"] is False
    assert Contest("stage", 7, print, "other", print).row()["holds"] is None
    text = table([held, missed])
    assert "holds" in text and "MISSED" in text and "4.0 s" in text and "8.0 s" in text


def test_threads_are_limited_within_the_block(monkeypatch):
    from threadpoolctl import threadpool_info

    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with limited_threads(1):
        assert thread_count() == 1
        assert all(pool["num_threads"] == 1 for pool in threadpool_info())
    assert thread_count() == 2


def test_yardstick_of_the_filter_finds_the_same_particle(rng):
    motion, mixture = (
        random_walk(0.05 * np.eye(2)),
        rank_mixture(0.2 * np.eye(2)[None].repeat(5, axis=0)),
    )
    filter_ = ParticleFilter(motion, mixture, (0, 3, 0, 3), 40, rng=rng)
    filter_.step(*observations(1.5 + 0.2 * rng.standard_normal((1, 5, 2))))
    before = filter_.belief
    now = filter_.step(*observations(1.5 + 0.2 * rng.standard_normal((1, 5, 2))))
    inputs = (
        now.states,
        now.log_likelihood,
        before.states,
        before.weights,
        np.linalg.inv(0.05 * np.eye(2)),
    )
    expected = MaximumAPosteriori().position(now, before, motion)
    assert np.array_equal(bench._map_by_einsum(*inputs), expected)


def test_stages_together_are_the_localizer(scene):
    """The clock steps the same parts with the same random numbers."""
    made = []

    def localizer(**changes):
        rng = np.random.default_rng(1)
        made.append(Localizer(scene.map("paper"), rng=rng, **changes))
        return made[-1]

    seconds = stage_seconds(localizer, scene.views[:3])
    whole = localizer()
    for frame in scene.views[:3]:
        estimate = whole.step(frame)
    assert np.array_equal(made[0].filter.belief.states, estimate.particles)
    assert list(seconds) == ["histogram", "neighbors", "filter", "estimate"]
    assert {len(taken) for taken in seconds.values()} == {3}
    blind = stage_seconds(localizer, scene.map("paper").histograms[:1])
    assert list(blind) == ["neighbors", "filter", "estimate"]


def test_the_command_writes_rows_as_json(scene, hurried, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench, "Scene", lambda *_: scene)
    file = tmp_path / "rows.json"
    words = ["bench", "--quiet", "--quick", "--stage", "histogram", "--json", str(file)]
    assert cli.main(words) == 0
    rows = json.loads(file.read_text())
    assert [each["threads"] for each in rows] == [1, 2]
    for each in rows:
        assert each["yardstick"] == "sgemm's rate" and each["size"] == "640x480"
        assert each["ratio"] == pytest.approx(each["ours_s"] / each["yardstick_s"])
    assert "full histogram" in capsys.readouterr().out


def test_an_unknown_stage_is_a_clear_error():
    with pytest.raises(ParameterError, match="stage 'warp' is unknown: the stages are train"):
        list(measure(["warp"]))


def test_long_stages_are_measured_where_they_are_named(monkeypatch):
    ran = []
    for name in STAGES:
        monkeypatch.setitem(STAGES, name, lambda scene, name=name: ran.append(name) or ())
    assert not [*measure(quick=True), *measure(["answers"])]
    assert ran == ["train", "histogram", "filter", "frame", "start", "answers"]


def test_the_machine_is_described():
    assert machine()["processors"] >= 1 and machine()["processor"]


STAGE_ROWS = {
    "histogram": ["sgemm's rate"] * 2,
    "filter": ["einsum, MAP alone"] * 2,
    "frame": [*["SIFT of the frame"] * 5, "homography"],
}


@pytest.mark.parametrize("stage", STAGE_ROWS)
def test_a_stage_is_beside_its_yardsticks(stage, contests, hurried, monkeypatch):
    monkeypatch.setattr(bench, "_PARTICLES", bench._PARTICLES[:2])  # the third takes seconds
    rows = [contest.row(quick=True) for contest in contests(stage)]
    assert [each["yardstick"] for each in rows] == STAGE_ROWS[stage]
    assert all(each["ours_s"] > 0 and each["yardstick_s"] > 0 for each in rows)


def test_homographies_are_of_the_floor_that_is_flown_over(contests):
    *_, whole, half = contests("frame")
    for contest in (whole, half):
        assert np.isfinite(contest.ours()).all()


@pytest.mark.slow
def test_every_stage_runs():
    rows = list(measure(STAGES, quick=True))
    assert len({each["stage"] for each in rows}) == 19
    assert all(each["ours_s"] > 0 and each["yardstick_s"] > 0 for each in rows)


def test_started_processes_have_bytecode_whatever_the_environment(scene, monkeypatch):
    """Where Python writes none every source would be compiled anew, and that be measured."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    told, run = [], bench.subprocess.run
    monkeypatch.setattr(
        bench.subprocess, "run", lambda *a, env, **b: told.append(env) or run(["true"], **b)
    )
    contests = list(bench.start(scene))
    assert [each.yardstick for each in contests] == ["import NumPy and OpenCV"] * 2
    contests[0].ours()
    (env,) = told
    assert "PYTHONDONTWRITEBYTECODE" not in env and env["PYTHONPYCACHEPREFIX"]


def test_a_board_is_a_line_of_numbers():
    found = bench.measure_board(frames=40)
    assert found["frames"] == 40 and 0 < found["latency_ms"]["p50"] <= found["latency_ms"]["p99"]
    assert found["memory_mib"] > 10 and found["first_position_s"] > 0.01
    assert found["machine"]["processor"]


def test_a_board_is_written_where_it_was_asked_for(tmp_path, monkeypatch, capsys):
    """A file to be sent in was named, and never made."""
    measured = "trexton.companion.cli.bench.measure_board"
    monkeypatch.setattr(measured, lambda frames, seed: {"frames": frames})
    assert cli.main(["bench", "--board", "--quick", "--json", str(tmp_path / "board.json")]) == 0
    assert json.loads((tmp_path / "board.json").read_text()) == {"frames": 200}
    assert json.loads(capsys.readouterr().out) == {"frames": 200}
