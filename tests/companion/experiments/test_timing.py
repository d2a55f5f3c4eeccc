"""Time for one frame: what is measured and shown. No time is asserted."""

from __future__ import annotations

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
    assert list(with_images["stages_ms"]) == [
        "histogram", "neighbors", "filter", "estimate", "rest",
    ]  # fmt: skip
    assert list(without["stages_ms"]) == ["neighbors", "filter", "estimate", "rest"]
    for timings in (with_images, without):
        parts = timings["stages_ms"]
        for stage in (*parts.values(), timings["total_ms"]):
            assert 0 < stage["low"] <= stage["median"] <= stage["high"]
        assert parts["rest"]["median"] > max(
            parts[name]["median"] for name in ("neighbors", "filter", "estimate")
        )
    assert 0 < with_images["histogram_share"] < 1
    assert with_images["homography_ms"]["median"] > 0 and "homography_ms" not in without
    assert "full_sampling_hz" in with_images and "full_sampling_hz" not in without


def test_values_hold_no_times(records, tmp_path, monkeypatch):
    with_images, without = (record.values for record in records)
    assert with_images["counts"] == {"train": 48, "test": 12}
    assert without["camera_hz"] == pytest.approx(4)
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
        plot = timing.stages(loaded).axes[0]
        shown = {line.get_marker(): list(line.get_xdata()) for line in plot.lines}
        dots = shown["o"]
        stages = record.timings["stages_ms"]
        expected = [each["median"] for each in (*stages.values(), record.timings["total_ms"])]
        assert dots[: len(expected)] == expected
        assert len(dots) == (8 if record is records[0] else 5) == len(plot.get_yticklabels())
        assert published()["timing"]["total_ms"] in shown["D"]
