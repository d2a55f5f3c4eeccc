"""The map evaluation as an experiment: every value against its plain definition."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr
from small_room import histogram_flight, picture_flight

from trexton.base.errors import MapError
from trexton.base.files import canonical_json
from trexton.base.records import Record
from trexton.companion.claims.ledger import judge_all, load_claims
from trexton.companion.experiments import map_loss
from trexton.companion.experiments.correlation import pair_correlation, rank_correlation
from trexton.companion.experiments.similarity import cosine_similarity, local_losses
from trexton.localization.training_set import EXCLUDED_SECONDS


@pytest.fixture(scope="module")
def flights():
    return histogram_flight("survey"), histogram_flight("again", turns=4.0, noise=2)


@pytest.fixture(scope="module")
def record(flights, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TREXTON_CACHE", str(tmp_path_factory.mktemp("cache")))
        return map_loss.run(*flights, map_loss.Parameters(sigma=0.7))


def test_loss_and_similarity(record, flights):
    train, _ = flights
    values = record.values
    assert values["global_loss"] == pytest.approx(
        local_losses(train.histograms, train.position, 0.7).mean()
    )
    alike = cosine_similarity(train.histograms)
    assert values["similarity"]["lowest"] == alike.min()
    upper = np.triu_indices(len(train), 1)
    distance = np.hypot(*(train.position[:, None] - train.position).transpose(2, 0, 1))
    expected = spearmanr(alike[upper], distance[upper]).statistic
    assert values["similarity"]["distance_correlation"]["value"] == pytest.approx(expected)


def leave_out_error(flight, k=5):
    """Error of the k-NN's mean, frames within half a second left out."""
    errors = []
    for i in range(len(flight)):
        far = np.flatnonzero(np.abs(flight.time - flight.time[i]) > EXCLUDED_SECONDS)
        distance = np.linalg.norm(flight.histograms[far] - flight.histograms[i], axis=1)
        nearest = far[np.argsort(distance, kind="stable")[:k]]
        errors.append(np.linalg.norm(flight.position[nearest].mean(axis=0) - flight.position[i]))
    return np.array(errors)


def test_prediction(record, flights):
    train, _ = flights
    errors, losses = leave_out_error(train), local_losses(train.histograms, train.position, 0.7)
    np.testing.assert_allclose(record.series["error_m"], errors, atol=1e-9)
    np.testing.assert_allclose(record.series["local_loss"], losses)
    prediction = record.values["prediction"]
    assert prediction["correlation"]["value"] == pytest.approx(spearmanr(losses, errors).statistic)
    assert (
        prediction["correlation"]["low"]
        <= prediction["correlation"]["value"]
        <= prediction["correlation"]["high"]
    )


def test_sigma(record, flights):
    train, _ = flights
    half, double = (local_losses(train.histograms, train.position, sigma) for sigma in (0.35, 1.4))
    sigma = record.values["sigma"]
    assert sigma["rank_correlation"]["value"] == pytest.approx(spearmanr(half, double).statistic)
    assert (sigma["half_sigma_loss"], sigma["double_sigma_loss"]) == pytest.approx(
        (half.mean(), double.mean())
    )


def test_equal_seeds_equal_bytes(record, flights, monkeypatch, tmp_path):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    again = map_loss.run(*flights, map_loss.Parameters(sigma=0.7))
    assert canonical_json(again.values) == canonical_json(record.values)
    assert canonical_json(again.series) == canonical_json(record.series)


def test_claims_find_their_values(record):
    claims = [claim for claim in load_claims() if claim.experiment == "map_loss"]
    rows = judge_all({"survey": {"map_loss": record}}, claims)
    assert len(rows) >= 5 and all(finding.ours is not None for _, (finding,) in rows)


def test_runs_on_images(tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path / "cache"))
    train, test = (
        picture_flight(tmp_path / name, name, turns=turns) for name, turns in (("a", 3), ("b", 4))
    )
    record = map_loss.run(train, test, map_loss.Parameters(textons=6, samples=60))
    assert record.images["floor"].shape[2] == 3
    assert record.values["counts"] == {"train": 48, "test": 48, "textons": 6}
    map_loss.heat_maps(record)


def test_zero_histogram_is_an_error(flights, monkeypatch, tmp_path):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    train, test = flights
    histograms = train.histograms.copy()
    histograms[7] = 0
    with pytest.raises(MapError, match="row 7"):
        map_loss.run(replace(train, histograms=histograms), test, map_loss.Parameters())


def test_figures_show_the_record(record, tmp_path):
    loaded = Record.load(record.save(tmp_path))
    left, right = map_loss.heat_maps(loaded).axes[:2]
    heat = record.series["heat"]
    for plan, key, scale in ((left, "loss", 1), (right, "error_m", 100)):
        shown = np.ma.filled(plan.images[-1].get_array(), np.nan)
        np.testing.assert_allclose(shown, scale * np.array(heat[key], dtype=float))


@pytest.mark.parametrize("count", [18, 30, 75])
def test_a_short_flight_is_evaluated_and_drawn(count, flights, tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    whole, again = flights
    rows = np.linspace(0, len(whole) - 1, count).astype(int)
    picked = {key: getattr(whole, key)[rows] for key in ("position", "histograms")}
    train = replace(whole, frame=np.arange(count), time=np.arange(count) * 1.0, **picked)
    half = replace(again.select(np.arange(count // 2)), time=np.arange(count // 2) * 1.0)
    record = map_loss.run(train, half, map_loss.Parameters())
    assert map_loss.heat_maps(record).axes


def test_rank_correlation(rng):
    a = rng.normal(size=200)
    b = a + rng.normal(size=200)
    found = rank_correlation(a, b, rng=rng)
    assert found["value"] == pytest.approx(spearmanr(a, b).statistic)
    assert found["low"] < found["value"] < found["high"]
    # Against the interval of independent rows (Fisher's z): about as wide.
    width = 2 * 1.96 / np.sqrt(197) * (1 - found["value"] ** 2)
    single = rank_correlation(a, b, rng=rng, block=1)
    assert single["high"] - single["low"] == pytest.approx(width, rel=0.4)
    assert np.isnan(rank_correlation(a, np.ones(200), rng=rng)["value"])


def test_pair_correlation_counts_pairs(rng):
    points = rng.uniform(size=(30, 2))
    a = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    noise = rng.normal(scale=0.2, size=a.shape)
    b = a + noise + noise.T
    upper = np.triu_indices(30, 1)
    found = pair_correlation(a, b, rng=rng)
    assert found["value"] == pytest.approx(spearmanr(a[upper], b[upper]).statistic)
    assert found["low"] < found["value"] < found["high"]


def test_over_a_field_sigma_grows_with_it_and_what_is_chosen_holds(flights, tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    fields = [
        replace(flight, position=100 * flight.position, area=tuple(100 * np.array(flight.area)))
        for flight in flights
    ]
    record = map_loss.run(*fields, map_loss.Parameters())
    assert record.values["sigma"]["used_m"] == pytest.approx(0.1 * fields[0].diagonal, rel=0.5)
    assert "the paper's loss" in map_loss.finding(Record.load(record.save(tmp_path / "near")))
    far = map_loss.run(*fields, map_loss.Parameters(sigma=0.01))
    assert far.values["sigma"]["used_m"] == 0.01
    sentence = map_loss.finding(Record.load(far.save(tmp_path / "far")))
    assert "farther apart than sigma reaches, which was 0.01 m" in sentence


def test_over_a_field_sigma_is_a_tenth_of_its_diagonal():
    found = [map_loss.usual_sigma(diagonal) for diagonal in (7.07, 14.1, 597.3)]
    assert found == [0.8, 1.0, 60.0]
