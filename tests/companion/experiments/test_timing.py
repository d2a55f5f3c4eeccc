"""Time for one frame and the speed page: what is measured and shown. No time is asserted."""

from __future__ import annotations

import numpy as np
import pytest
from small_room import histogram_flight, picture_flight

from trexton.base.files import canonical_json
from trexton.base.records import Record
from trexton.companion.checks.bench import Row
from trexton.companion.checks.timing import Times
from trexton.companion.claims.ledger import judge_all, load_claims
from trexton.companion.experiments import speed, timing
from trexton.companion.experiments.printed import published

OPTIONS = {
    "samples": 40,
    "textons": 5,
    "particles": 10,
    "passes": 2,
    "full_frames": 3,
    "homography_frames": 3,
}


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """Of flights with images, and of flights that came as histograms."""
    folder = tmp_path_factory.mktemp("room")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TREXTON_CACHE", str(tmp_path_factory.mktemp("cache")))
        pictures = (
            picture_flight(folder / "a", "survey"),
            picture_flight(folder / "b", "again", frames=12, turns=2.0),
        )
        return timing.run(*pictures, timing.Parameters(**OPTIONS)), timing.run(
            histogram_flight("s"), histogram_flight("t"), timing.Parameters(**OPTIONS)
        )


def test_stages_of_every_frame(records):
    with_images, without = (record.timings for record in records)
    assert list(with_images["stages_ms"]) == ["histogram", "neighbors", "filter", "estimate"]
    assert list(without["stages_ms"]) == ["neighbors", "filter", "estimate"]
    assert {len(values) for values in with_images["frames_ms"].values()} == {12}
    for timings in (with_images, without):
        for name, stage in (timings["stages_ms"] | {"total": timings["total_ms"]}).items():
            assert stage["median"] == pytest.approx(np.median(timings["frames_ms"][name]))
            assert stage["p99"] == pytest.approx(np.percentile(timings["frames_ms"][name], 99))
            assert 0 < stage["low"] <= stage["median"] <= stage["high"]
    assert 0 < with_images["histogram_share"] < 1
    assert with_images["homography_ms"]["median"] > 0 and "homography_ms" not in without
    assert "full_sampling_hz" in with_images and "full_sampling_hz" not in without


def test_values_hold_no_times(records, tmp_path, monkeypatch):
    with_images, without = (record.values for record in records)
    assert (
        with_images["applies"] == {"histogram": True, "homography": True}
        and with_images["patches_per_image"] == 31 * 43
    )
    assert without["applies"] == {"histogram": False, "homography": False} and without[
        "camera_hz"
    ] == pytest.approx(4)
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    again = timing.run(histogram_flight("s"), histogram_flight("t"), timing.Parameters(**OPTIONS))
    assert canonical_json(again.values) == canonical_json(without)


def test_claims_find_their_values(records):
    with_images, _ = records
    claims = [claim for claim in load_claims() if claim.experiment == "timing"]
    findings = [finding for _, (finding,) in judge_all({"survey": {"timing": with_images}}, claims)]
    assert len(findings) >= 5 and not any(
        "this flight has no" in finding.reason for finding in findings
    )


def test_figures_show_the_record(records, tmp_path):
    for record in records:
        loaded = Record.load(record.save(tmp_path / record.flight))
        plot, times = timing.stages(loaded).axes[0], timing.times(loaded)
        dots = [line for line in plot.lines if line.get_marker() == "o"]
        assert [line.get_xdata()[0] for line in dots] == [
            time["median"] for time in reversed(times.values())
        ]
        diamonds = [line.get_xdata()[0] for line in plot.lines if line.get_marker() == "D"]
        assert published()["timing"]["total_ms"] in diamonds
        plot = timing.frames(loaded).axes[0]
        assert len(plot.collections) == len(record.timings["stages_ms"])


@pytest.fixture
def bench_record(monkeypatch, rng):
    """The speed page over rows that are made up, which is all its figures need."""
    ours = Times.of([0.01])

    def rows(*, quick, seed):
        yield Row.compare("full histogram", "640x480", 1, ours, "sgemm's rate", 0.02, 0.87)
        yield Row.compare("neighbours", 800, 1, ours, "SciPy cKDTree", 0.005, 1.2)
        yield Row.compare("sampled histogram", 400, 1, ours, "SciPy cdist", 0.03)
        for size in (10, 1000):
            yield Row.compare("growth, samples", size, 1, ours, "fit, exponent 0.00", 0.01)

    monkeypatch.setattr(speed, "measure", rows)
    monkeypatch.setattr(speed, "_COPIED", 2**20)
    return speed.run(histogram_flight("s"), histogram_flight("t"), speed.Parameters())


def test_the_speed_page(bench_record, tmp_path):
    loaded = Record.load(bench_record.save(tmp_path))
    assert loaded.values["limits"] == 2 and loaded.timings["held"] == 1
    (share,) = speed.limits(loaded).axes[0].collections[1:]
    np.testing.assert_allclose(share.get_offsets()[:, 0], [0.5 / 0.87, 2 / 1.2])
    points = [
        line for line in speed.roofline(loaded).axes[0].lines if line.get_linestyle() == "None"
    ]
    assert [line.get_ydata()[0] for line in points] == pytest.approx(
        [1.303e9 / 0.01 / 1e9, 32_000 / 0.01 / 1e9, 1_728_000 / 0.01 / 1e9]
    )
    (plot,) = [axis for axis in speed.growth(loaded).axes if axis.get_title(loc="left")]
    assert (
        plot.lines[0].get_xdata().tolist() == [10, 1000]
        and plot.get_title(loc="left") == "exponent 0.00"
    )
    shown = speed.rows(loaded)
    assert shown["Stage"].tolist() == ["full histogram", "neighbours", "sampled histogram"]
    assert shown.iloc[:, -1].tolist() == ["holds", "missed", ""]
