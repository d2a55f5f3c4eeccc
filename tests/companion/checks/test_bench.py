"""The bench: its yardsticks compute what they claim to, its rows say what was measured. No time is
asserted.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from small_room import observations

from trexton.base.errors import ParameterError
from trexton.base.records import machine
from trexton.cli import main as cli
from trexton.companion.checks import bench, processes
from trexton.companion.checks.bench import STAGES, measure
from trexton.companion.checks.scene import Scene
from trexton.companion.checks.timing import interleave, row, table
from trexton.companion.executor import limited_threads
from trexton.companion.wording import duration
from trexton.evaluation.runtime import StageTimer
from trexton.localization.estimation import MaximumAPosteriori
from trexton.localization.filters import ParticleFilter
from trexton.localization.localizer import Localizer
from trexton.localization.measurement import RankMixture
from trexton.localization.motion import RandomWalk
from trexton.simulator import record_flight
from trexton.vision.threads import thread_count


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Of a short flight, every contestant once or twice: what is measured matters, not how long it
    took.
    """
    scene = Scene(tmp_path_factory.mktemp("bench"), quick=True)
    scene.flight = record_flight(scene.folder / "flight", frames=40, seed=1)
    scene.times = lambda contestants, *_, **__: interleave(contestants, 1e-4, 1)
    return scene


def test_contestants_take_turns_and_all_calls_count():
    calls = []
    times = interleave(
        {name: lambda name=name: calls.append(name) for name in "ab"}, seconds=1e-4, rounds=4
    )
    assert calls[:4] == ["a", "a", "b", "b"]  # to warm up
    turns = [
        name for name, before in zip(calls[4:], [None, *calls[4:]], strict=False) if name != before
    ]
    assert turns == list("abababab")
    assert {name: len(times[name]) for name in "ab"} == {
        name: calls.count(name) - 2 for name in "ab"
    }
    assert all((taken >= 0).all() for taken in times.values())


def test_rows_compare_medians_with_a_yardstick():
    ours = [1.0, 2.0, 6.0]
    held = row("stage", 7, 2, ours, "other", 4.0, 0.5)
    assert (held["ours_s"], held["ratio"], held["holds"], held["size"]) == (2.0, 0.5, True, "7")
    assert held["p99_s"] == pytest.approx(5.92)
    missed = row("stage", 7, 1, ours, "sum", [1e-3, 1e-3, 9.0], 1.0)
    assert missed["holds"] is False
    assert row("stage", 7, 1, ours, "other", 4.0)["holds"] is None
    text = table([held, missed])
    assert "holds" in text and "MISSED" in text and "4 s" in text and "1 ms" in text


def test_durations_have_a_unit():
    assert [duration(seconds) for seconds in (2, 0.0123, 4.56e-5, 7e-8)] == [
        "2 s",
        "12.3 ms",
        "45.6 µs",
        "70 ns",
    ]


def test_threads_are_limited_within_the_block(monkeypatch):
    from threadpoolctl import threadpool_info

    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with limited_threads(1):
        assert thread_count() == 1
        assert all(pool["num_threads"] == 1 for pool in threadpool_info())
    assert thread_count() == 2


def test_yardstick_of_the_filter_finds_the_same_particle(rng):
    motion, mixture = (
        RandomWalk.of(0.05 * np.eye(2)),
        RankMixture.of(0.2 * np.eye(2)[None].repeat(5, axis=0)),
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


def test_histograms_of_a_crowd_are_histograms(rng):
    crowd = bench._crowd(rng.dirichlet(np.ones(20), 30), 300, rng)
    assert crowd.shape == (300, 20)
    assert np.allclose(crowd.sum(axis=1), 1) and (crowd >= 0).all()


def test_stages_together_are_the_localizer(scene):
    """The clock steps the same parts with the same random numbers."""
    clock = StageTimer(scene.map(), rng=scene.rng("flight"))
    whole = Localizer(scene.map(), rng=scene.rng("flight"))
    for frame in scene.views[:3]:
        clock.step(frame)
        estimate = whole.step(frame)
    assert np.array_equal(clock.localizer.filter.belief.states, estimate.particles)
    assert {name: len(taken) for name, taken in clock.seconds.items()} == dict.fromkeys(
        clock.seconds, 3
    )
    blind = StageTimer(scene.map(), rng=np.random.default_rng(1))
    blind.step(scene.map().histograms[0])
    assert list(blind.medians()) == ["neighbors", "filter", "estimate"]


def test_the_command_writes_rows_as_json(scene, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench, "Scene", lambda *_: scene)
    file = tmp_path / "rows.json"
    words = ["bench", "--quiet", "--quick", "--stage", "neighbors", "--json", str(file)]
    assert cli.main(words) == 0
    rows = json.loads(file.read_text())
    assert [each["size"] for each in rows] == ["800", "10000", "100000"]
    for each in rows:
        assert each["yardstick"] == "SciPy cKDTree" and each["threads"] == 1
        assert each["ratio"] == pytest.approx(each["ours_s"] / each["yardstick_s"])
    assert "neighbours" in capsys.readouterr().out


def test_the_onboard_loop_tells_cpu_time_and_memory(scene):
    (made,) = processes.onboard(scene)
    cpu, memory = re.fullmatch(r"([0-9.]+) ms CPU, ([0-9]+) MiB resident", made["note"]).groups()
    assert float(cpu) == pytest.approx(1e3 * made["ours_s"], abs=0.006) and made["yardstick_s"] > 0
    assert int(memory) > 20  # an interpreter with NumPy and OpenCV alone takes more


def test_an_unknown_stage_is_a_clear_error():
    with pytest.raises(ParameterError, match="stage 'warp' is unknown: the stages are train"):
        list(measure(["warp"]))


def test_the_machine_is_described():
    assert machine()["processors"] >= 1 and machine()["processor"]


STAGE_ROWS = {
    "histogram": ["sgemm's rate", "full histogram", "sgemm's rate"],
    "filter": ["einsum, MAP alone"] * 2,
    "frame": ["sum of its stages", *["SIFT of the frame"] * 3, "homography"],
}


@pytest.mark.parametrize("stage", STAGE_ROWS)
def test_a_stage_is_beside_its_yardsticks(stage, scene, monkeypatch):
    monkeypatch.setattr(bench, "_PARTICLES", bench._PARTICLES[:2])  # the third takes seconds
    rows = list(STAGES[stage](scene))
    assert [each["yardstick"] for each in rows] == STAGE_ROWS[stage]
    assert all(each["ours_s"] > 0 and each["yardstick_s"] > 0 for each in rows)
    if stage == "frame":
        assert rows[-1]["note"] == rows[-2]["note"] == "right within 0.3 m: 100%"


@pytest.mark.slow
def test_every_stage_runs():
    rows = list(measure(quick=True))
    assert len({each["stage"] for each in rows}) == 14
    assert all(each["ours_s"] > 0 and each["yardstick_s"] > 0 for each in rows)


def test_started_processes_have_bytecode_whatever_the_environment(scene, monkeypatch):
    """Where Python writes none every source would be compiled anew, and that be measured."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    given, run = [], processes.subprocess.run
    monkeypatch.setattr(
        processes.subprocess, "run", lambda *a, env, **b: given.append(env) or run(["true"], **b)
    )
    rows = list(processes.start(scene))
    assert [each["yardstick"] for each in rows] == ["import NumPy and OpenCV"] * 2
    assert given and all(
        "PYTHONDONTWRITEBYTECODE" not in env and env["PYTHONPYCACHEPREFIX"] for env in given
    )
