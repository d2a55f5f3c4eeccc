"""Speed against accuracy: errors against direct runs, what sweeps hold, the stored histograms."""

import re
from dataclasses import replace

import numpy as np
import pytest
from small_room import histogram_flight, picture_flight

from trexton.base.files import canonical_json
from trexton.base.records import Record
from trexton.companion.claims.ledger import judge_all, load_claims
from trexton.companion.experiments import sweeps, trade_off
from trexton.companion.experiments.declaration import MapParameters
from trexton.companion.experiments.evaluation import frames_of, map_of
from trexton.companion.experiments.rates import frequency, milliseconds
from trexton.companion.experiments.track import tracks
from trexton.vision.histograms import texton_histogram

SWEPT = {"samples": (20, 80, None), "particles": (5, 30)}
OPTIONS = {"samples": 40, "particles": 20, "neighbors": 4, "repeats": 3, "stored": 300}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TREXTON_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(trade_off, "SWEPT", SWEPT)
        patch.setattr(sweeps, "SWEPT", SWEPT)
        patch.setattr(sweeps, "GRID", {"particles": (10,), "neighbors": (1, 3)})
        yield


@pytest.fixture(scope="module")
def pair(tmp_path_factory, small):
    folder = tmp_path_factory.mktemp("room")
    return tuple(
        picture_flight(folder / name, name, turns=turns)
        for name, turns in (("train", 3.0), ("test", 4.0))
    )


@pytest.fixture(scope="module")
def record(pair):
    return trade_off.run(*pair, trade_off.Parameters(textons=6, **OPTIONS))


@pytest.fixture(scope="module")
def without_images(small):
    flights = histogram_flight("survey"), histogram_flight("again", turns=4.0, noise=2)
    return trade_off.run(*flights, trade_off.Parameters(**OPTIONS))


def test_sweeps_hold_all_values_in_order(record):
    expected = {
        "samples": [20, 40, 80, None],
        "particles": [5, 20, 30],
    }
    for name, values in expected.items():
        assert [row[name] for row in record.series[name]] == values
        assert [row[name] for row in record.timings[name]] == values
        for row in record.series[name]:
            others = {"samples": 40, "particles": 20, "neighbors": 4}
            others.pop(name)
            assert {key: row[key] for key in others} == others
    assert [row["patches"] for row in record.series["samples"]] == [20, 40, 80, 31 * 43]


def test_errors_are_those_of_direct_runs(record, pair):
    train, test = pair
    texton_map = map_of(train, MapParameters(textons=6, neighbors=4))
    runs = tracks(texton_map, frames_of(test), repeats=3, seed=1, samples=80, particles=20)
    direct = [100 * np.abs(run.position - test.position)[:, 0].mean() for run in runs]
    row = record.series["samples"][2]
    assert row["error_cm_x"]["value"] == pytest.approx(np.median(direct))


def test_full_sampling_is_the_localizer_with_all_patches(record, pair):
    train, test = pair
    texton_map = map_of(train, MapParameters(textons=6, neighbors=4))
    runs = tracks(texton_map, frames_of(test), repeats=3, seed=1, samples=None, particles=20)
    direct = [100 * np.abs(run.position - test.position)[:, 0].mean() for run in runs]
    assert record.values["full_sampling_error_cm"]["value"] == pytest.approx(np.median(direct))


def test_headlines_are_the_ends(record):
    rows, clocks = record.series, record.timings
    assert record.values["fewest_samples_error_cm"] == rows["samples"][0]["error_cm_x"]
    assert record.values["full_sampling_error_cm"] == rows["samples"][-1]["error_cm_x"]
    assert record.values["most_particles_error_cm"] == rows["particles"][-1]["error_cm_x"]
    assert clocks["fewest_samples_ms"] == clocks["samples"][0]["frame_ms"]
    assert clocks["full_sampling_ms"] == clocks["samples"][-1]["frame_ms"]
    before, after = (rows["samples"][i]["error_cm_x"]["value"] for i in (1, 3))
    assert record.values["plateau_gain"]["value"] == pytest.approx(1 - after / before)
    assert record.values["camera_hz"] == pytest.approx(4.0)


def test_claims_find_their_values(record):
    claims = [claim for claim in load_claims() if claim.experiment == "trade_off"]
    rows = judge_all({"train": {"trade_off": record}}, claims)
    # Twelve seconds of training flight are needed to choose by replay; this one has fewer.
    found = {claim.id: finding.ours for claim, (finding,) in rows}
    assert found.pop("tuned") is None and record.values["tuned_error_cm"] is None
    assert len(found) >= 8 and None not in found.values()


def test_values_repeat_and_hold_no_time(record, pair):
    again = trade_off.run(*pair, trade_off.Parameters(textons=6, **OPTIONS))
    assert canonical_json(again.values) == canonical_json(record.values)
    assert canonical_json(again.series) == canonical_json(record.series)
    assert canonical_json(again.timings) != canonical_json(record.timings)


def test_histograms_only(without_images):
    assert (
        "samples" not in without_images.series
        and "fewest_samples_error_cm" not in without_images.values
    )
    assert without_images.values["applies"] == {"samples": False}
    assert {row["samples"] for row in without_images.series["grid"]} == {None}
    claims = [claim for claim in load_claims() if claim.id in ("scalable", "particles-accuracy")]
    found = {
        claim.id: finding
        for claim, (finding,) in judge_all({"f": {"trade_off": without_images}}, claims)
    }
    assert found["scalable"].ours is None and "needs camera images" in found["scalable"].reason
    assert found["particles-accuracy"].ours is not None


def test_what_the_replay_chooses_is_measured_on_the_test_flight(without_images):
    grid, values = without_images.series["grid"], without_images.values
    chosen = min(grid, key=lambda row: row["replayed_cm"])
    assert values["tuned_error_cm"] == values["tuned"]["axis_mean_cm"]
    assert values["tuned_setting"].items() <= chosen.items()
    claims = [claim for claim in load_claims() if claim.id == "tuned"]
    ((_, (judged,)),) = judge_all({"f": {"trade_off": without_images}}, claims)
    assert judged.ours.value == values["tuned_error_cm"]["value"]
    assert len({row["replayed_cm"] for row in grid}) > 1
    assert "Of 2 settings a replay of the training flight chooses" in trade_off.finding(
        without_images
    )


@pytest.fixture(scope="module")
def bench(pair):
    given = trade_off.Parameters(textons=6, samples=40, particles=20, neighbors=4)
    return sweeps.Bench(*pair, given, 1)


def test_multiplied_histograms(rng):
    still = np.tile([0.2, 0.3, 0.5], (4, 1))
    copies, rows = sweeps.multiplied(still, 50, rng=rng)
    np.testing.assert_allclose(copies, still[rows])  # nothing changes from frame to frame: no noise
    walk = np.abs(np.cumsum(rng.normal(size=(200, 3)), axis=0)) + 40
    walk /= walk.sum(axis=1, keepdims=True)
    copies, rows = sweeps.multiplied(walk, 4000, rng=rng)
    assert copies.min() >= 0 and set(rows) <= set(range(200))
    np.testing.assert_allclose(copies.sum(axis=1), 1)
    change, noise = np.diff(walk, axis=0).std(axis=0), (copies - walk[rows]).std(axis=0)
    np.testing.assert_allclose(noise, change, rtol=0.3)  # sums of one take a little of it


def test_stored_histograms(record):
    assert [clock["stored"] for clock in record.timings["stored"]] == [100, 300]
    for clock in record.timings["stored"]:
        for method in ("brute", "tree"):
            assert (
                clock[method]["query_ms"]["median"] > 0
                and clock[method]["frequency_hz"]["median"] > 0
            )


def test_clock():
    found = milliseconds([np.r_[np.full(20, 0.001), np.full(20, 0.003)], np.full(20, 0.003)])
    assert found["median"] == pytest.approx(3)
    assert 1 <= found["low"] < 3 and found["high"] == pytest.approx(3)
    assert frequency({"median": 10, "low": 5, "high": 20}) == {
        "median": 100,
        "low": 50,
        "high": 200,
    }


def test_full_histograms_are_those_of_every_patch(bench, pair):
    np.testing.assert_array_equal(
        bench.full[5], texton_histogram(pair[1].image(5), bench.map.dictionary)
    )


def test_figures_show_the_record(record, without_images, tmp_path):
    loaded = Record.load(record.save(tmp_path))
    axes = np.reshape(trade_off.error_and_rate(loaded).axes, (2, 2)).T
    for (error, rate), name in zip(axes, ("samples", "particles"), strict=True):
        rows, clocks = record.series[name], record.timings[name]
        for line, axis in zip(error.lines, "xy", strict=False):
            medians = [row[f"error_cm_{axis}"]["value"] for row in rows]
            np.testing.assert_allclose(line.get_ydata(), medians)
        rates = [row["frequency_hz"]["median"] for row in clocks]
        np.testing.assert_allclose(rate.lines[0].get_ydata(), rates)
        x = [row["patches" if name == "samples" else name] for row in rows]
        np.testing.assert_allclose(rate.lines[0].get_xdata(), x)
    (plot,) = trade_off.stored(loaded).axes
    tree = [row["tree"]["frequency_hz"]["median"] for row in record.timings["stored"]]
    np.testing.assert_allclose(plot.lines[1].get_ydata(), tree)
    assert len(trade_off.error_and_rate(without_images).axes) == 2
    assert not without_images.series.get("samples")


def test_a_finding_has_one_unit(record):
    def scaled(entry, factor):
        if isinstance(entry, dict):
            return {key: scaled(each, factor) for key, each in entry.items()}
        return entry * factor if isinstance(entry, float) else entry

    near = trade_off.finding(record)
    assert " cm" in near and not re.search(r"\d m\b", near)
    far = trade_off.finding(replace(record, values=scaled(record.values, 100.0)))
    assert re.search(r"\d m\b", far) and " cm" not in far
