"""Time for one frame: what is measured and shown. No time is asserted."""

from __future__ import annotations

import numpy as np
import pytest
from small_room import histogram_flight, picture_flight

from trexton.base.files import canonical_json
from trexton.base.records import Record
from trexton.companion.claims.ledger import judge_all, load_claims
from trexton.companion.experiments import timing
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
