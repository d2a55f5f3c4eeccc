"""The bench: its yardsticks compute what they claim to, its rows say what was measured. No time is
asserted.
"""

from __future__ import annotations

import json
import re
from functools import partial
from importlib import import_module

import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.base.records import machine
from trexton.cli import main as cli
from trexton.companion.checks import bench_estimation as estimation
from trexton.companion.checks import bench_images as images
from trexton.companion.checks import bench_processes
from trexton.companion.checks.bench import STAGES, Row, measure, table
from trexton.companion.checks.bench_estimation import _by_numpy, _map_by_einsum, exponent
from trexton.companion.checks.bench_images import _by_cdist, operations
from trexton.companion.checks.bench_processes import onboard
from trexton.companion.checks.scene import Scene, crowd, observations
from trexton.companion.checks.timing import Times, interleave
from trexton.companion.executor import limited_threads
from trexton.companion.wording import duration
from trexton.evaluation.runtime import StageTimer
from trexton.localization.estimation import MaximumAPosteriori
from trexton.localization.filters import ParticleFilter
from trexton.localization.measurement import RankMixture
from trexton.localization.motion import RandomWalk
from trexton.localization.neighbors import NearestHistograms
from trexton.vision.histograms import texton_histogram
from trexton.vision.textons import TextonDictionary
from trexton.vision.threads import thread_count


@pytest.fixture(scope="module")
def scene():
    return Scene()


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
    assert {name: times[name].repeats for name in "ab"} == {
        name: calls.count(name) - 2 for name in "ab"
    }
    assert 0 <= times["a"].median <= times["a"].p99


def test_rows_compare_with_times_and_with_seconds():
    ours, theirs = Times.of([1.0, 2.0, 3.0]), Times.of([4.0])
    row = Row.compare("stage", 7, 2, ours, "other", theirs, 0.5)
    assert (row.ours_s, row.yardstick_s, row.ratio, row.size, row.holds) == (
        2.0,
        4.0,
        0.5,
        "7",
        True,
    )
    assert Row.compare("stage", 7, 1, ours, "sum", 1.0, 1.9).holds is False
    assert Row.compare("stage", 7, 1, ours, "other", theirs).holds is None
    text = table([row, Row.compare("stage", 7, 1, ours, "sum", 1e-3, 1.0)])
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


def test_the_exponent_of_a_power_law_is_found():
    sizes = np.array([10.0, 100, 1000])
    slope, constant = exponent(sizes, 3 * sizes**1.5)
    assert slope == pytest.approx(1.5) and np.exp(constant) == pytest.approx(3)


def test_the_work_of_an_image_is_the_issue_of_counting():
    assert operations((480, 640, 3), 20, 6) == 301_625 * 20 * 108 * 2


def test_yardsticks_of_the_histogram_compute_the_histogram(rng):
    dictionary = TextonDictionary(rng.integers(0, 256, (20, 6, 6, 3), dtype=np.uint8))
    image = rng.integers(0, 256, (40, 50, 3), dtype=np.uint8)
    assert np.allclose(_by_cdist(image, dictionary), texton_histogram(image, dictionary))


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
    assert np.array_equal(_map_by_einsum(*inputs), expected)


def test_yardstick_of_the_neighbours_finds_the_same_rows(rng):
    histograms = crowd(rng.dirichlet(np.ones(20), 30), 300, rng)
    assert np.allclose(histograms.sum(axis=1), 1) and (histograms >= 0).all()
    nearest = NearestHistograms(histograms, np.zeros((300, 2)))
    for query in crowd(histograms, 20, rng):
        assert _by_numpy(histograms, query).tolist() == nearest.query(query).index.tolist()


def test_stages_together_are_the_localizer(scene):
    """The clock steps the same parts with the same random numbers."""
    clock, whole = StageTimer(scene.map, rng=scene.rng("flight")), scene.localizer()
    for frame in scene.views[0][:3]:
        clock.step(frame)
        estimate = whole.step(frame)
    assert np.array_equal(clock.localizer.filter.belief.states, estimate.particles)
    assert {name: len(taken) for name, taken in clock.seconds.items()} == dict.fromkeys(
        clock.seconds, 3
    )
    blind = StageTimer(scene.map, rng=np.random.default_rng(1))
    blind.step(scene.histograms[0])
    assert list(blind.medians()) == ["neighbors", "filter", "estimate"]


def test_the_command_writes_rows_as_json(tmp_path, capsys):
    file = tmp_path / "rows.json"
    assert cli.main(["bench", "--quiet", "--quick", "--stage", "sampled", "--json", str(file)]) == 0
    rows = json.loads(file.read_text())
    assert [row["yardstick"] for row in rows] == ["SciPy cdist"]
    for row in rows:
        assert {"stage", "size", "threads", "ours_s", "yardstick", "yardstick_s", "ratio"} <= set(
            row
        )
        assert (
            row["ratio"] == pytest.approx(row["ours_s"] / row["yardstick_s"])
            and row["threads"] == 1
        )
    assert "sampled histogram" in capsys.readouterr().out


def test_the_onboard_loop_tells_cpu_time_and_memory(scene):
    (row,) = onboard(scene, quick=True)
    cpu, memory = re.fullmatch(r"([0-9.]+) ms CPU, ([0-9]+) MiB resident", row.note).groups()
    assert float(cpu) == pytest.approx(1e3 * row.ours_s, abs=0.006) and row.yardstick_s > 0
    assert int(memory) > 20  # an interpreter with NumPy and OpenCV alone takes more


def test_unknown_stages_and_missing_packages_are_clear_errors(monkeypatch):
    with pytest.raises(ParameterError, match="stage 'warp' is unknown: the stages are full"):
        list(measure(["warp"]))
    monkeypatch.setitem(STAGES, "broken", ("no_such_module", "f"))
    with pytest.raises(ParameterError, match="not installed"):
        list(measure(["broken"]))


def test_the_machine_is_described():
    assert machine()["processors"] >= 1 and machine()["processor"]


STAGE_ROWS = {
    "neighbors": ["NumPy brute force", "SciPy cKDTree", "scikit-learn"] * 3,
    "simulator": ["warpPerspective"],
    "start": ["import NumPy and OpenCV"] * 2,
}


@pytest.fixture
def hurried(monkeypatch):
    """Every contestant once or twice: what is measured matters here, not how long it took."""
    for module in (estimation, images):
        brief = partial(interleave, seconds=1e-4, rounds=1)
        monkeypatch.setattr(module, "interleave", lambda turns, *_, brief=brief, **__: brief(turns))


@pytest.mark.parametrize("stage", STAGE_ROWS)
def test_a_stage_is_beside_its_yardsticks(stage, scene, hurried):
    module, function = STAGES[stage]
    rows = list(
        getattr(import_module(f"trexton.companion.checks.{module}"), function)(scene, quick=True)
    )
    assert [row.yardstick for row in rows] == STAGE_ROWS[stage]
    assert all(row.ours_s > 0 and row.yardstick_s > 0 for row in rows)
    if stage == "neighbors":
        assert [row.size for row in rows[::3]] == ["800", "10000", "100000"]


def test_growth_of_every_size_is_fitted(scene, hurried):
    rows = list(estimation.growth(scene, quick=True))
    stages = dict.fromkeys(row.stage for row in rows)
    assert len(stages) == 6 and all(stage.startswith("growth, ") for stage in stages)
    for stage in stages:
        fitted = [row for row in rows if row.stage == stage]
        sizes, seconds = zip(*((float(row.size), row.yardstick_s) for row in fitted), strict=True)
        slope, _ = exponent(sizes, seconds)  # the fit itself is a power law
        assert f"exponent {slope:.2f}" in fitted[0].yardstick


@pytest.mark.slow
def test_every_stage_runs():
    rows = list(measure(quick=True))
    assert {row.stage.split(",")[0] for row in rows} >= {
        "full histogram",
        "sampled histogram",
        "neighbours",
        "filter step",
        "whole frame",
        "homography",
        "simulator",
        "start",
        "growth",
        "onboard loop",
    }
    assert all(row.ours_s > 0 and row.yardstick_s > 0 for row in rows)


def test_started_processes_have_bytecode_whatever_the_environment(scene, monkeypatch):
    """Where Python writes none every source would be compiled anew, and that be measured."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    told = []
    monkeypatch.setattr(bench_processes.subprocess, "run", lambda *_, env, **__: told.append(env))
    list(bench_processes.start(scene, quick=True))
    assert told and all(
        "PYTHONDONTWRITEBYTECODE" not in env and env["PYTHONPYCACHEPREFIX"] for env in told
    )
