"""Choosing settings: predicted errors by hand, choices by enumeration. No time is asserted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trexton import cli
from trexton.errors import ParameterError
from trexton.localizer import TextonMap
from trexton.methods import compose
from trexton.records import Record
from trexton.textons import TextonDictionary
from trexton.tuning import Setting, choose, costs, predicted_errors, tune


def trade_off(with_samples=True) -> Record:
    def rows(name, errors):
        return [{name: value, "axis_mean_cm": {"median": error}} for value, error in errors.items()]

    series = {"particles": rows("particles", {10: 45.0, 50: 40.0, 200: 36.0})}
    if with_samples:
        series["samples"] = rows("samples", {50: 55.0, 400: 40.0, None: 38.0})
    parameters = {"samples": 400, "particles": 50}
    return Record(
        experiment="trade_off", flight="room", parameters=parameters, values={}, series=series
    )


def small_map(rng, images=True) -> TextonMap:
    return TextonMap(
        dictionary=TextonDictionary(rng.integers(0, 256, (5, 3, 3, 3), dtype=np.uint8))
        if images
        else None,
        histograms=rng.dirichlet(np.ones(5), 40),
        positions=rng.uniform(0, 4, (40, 2)),
        time=0.08 * np.arange(40),
        area=(0.0, 4.0, 0.0, 4.0),
        image_shape=(24, 32) if images else None,
        period_s=0.08,
        method="paper",
        parts={},
        provenance={"flight": "room"},
    ).with_parts(compose("paper"))


def test_effects_of_samples_and_particles_add_up():
    errors = predicted_errors(trade_off())
    assert len(errors) == 9
    assert errors[400, 50] == 40 and errors[50, 50] == 55 and errors[400, 10] == 45
    assert errors[50, 200] == pytest.approx(40 + 15 - 4) and errors[None, 10] == pytest.approx(
        40 - 2 + 5
    )


def test_a_map_of_histograms_needs_no_samples():
    assert predicted_errors(trade_off(with_samples=False), with_samples=False) == {
        (400, 10): 45,
        (400, 50): 40,
        (400, 200): 36,
    }


def test_the_cheapest_of_the_good_is_chosen():
    settings = [
        Setting(400, 50, 2e-3, 40.0),
        Setting(None, 50, 9e-3, 38.0),
        Setting(None, 10, 8e-3, 38.5),
        Setting(50, 10, 1e-3, 60.0),
    ]
    assert choose(settings, 1.0) == settings[2]  # within two per cent of the best, and cheaper
    assert choose(settings, 5e-3) == settings[0]
    assert choose(settings, 1e-3) == settings[3]
    with pytest.raises(
        ParameterError,
        match="even 50 samples and 10 particles take 1 ms a frame, but 0.5 ms are to spend",
    ):
        choose(settings, 5e-4)


def test_costs_are_measured_for_every_pair(rng):
    measured = costs(small_map(rng), [50, None], [10, 30], rng=rng, repeats=3)
    assert (
        set(measured) == {(50, 10), (50, 30), (None, 10), (None, 30)} and min(measured.values()) > 0
    )
    # Each histogram and each filter is timed once.
    assert measured[50, 10] - measured[50, 30] == pytest.approx(
        measured[None, 10] - measured[None, 30]
    )


def test_tuning_returns_a_setting_of_the_record(rng):
    best = tune(small_map(rng), trade_off(), 0.1, rng=rng)
    assert (
        best.error_cm
        == predicted_errors(trade_off())[best.samples, best.particles]
        == pytest.approx(34)
    )


def test_bad_input_is_one_clear_error(rng):
    texton_map, record = small_map(rng), trade_off()
    for rate in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ParameterError, match="expected a positive number"):
            tune(texton_map, record, rate, rng=rng)
    with pytest.raises(ParameterError, match="the headroom is 1"):
        tune(texton_map, record, 1.0, headroom=1, rng=rng)
    with pytest.raises(ParameterError, match="expected one of 'trade_off'"):
        tune(texton_map, replace(record, experiment="timing"), 1.0, rng=rng)
    with pytest.raises(ParameterError, match="did not vary samples"):
        tune(texton_map, trade_off(with_samples=False), 1.0, rng=rng)


def test_the_command_prints_settings_and_how_to_fly_them(rng, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    small_map(rng).save(tmp_path / "map.npz")
    assert cli.main(["tune", "map.npz", "--rate", "1"]) == 1
    assert "results/room/trade_off.json: no trade-off record" in capsys.readouterr().err
    trade_off().save(tmp_path / "results" / "room")
    assert cli.main(["tune", "map.npz", "--rate", "1"]) == 0
    printed = capsys.readouterr().out
    assert "every patch, 200 particles" in printed and "predicted error: 34 cm" in printed
    assert "trexton onboard map.npz --samples 0 --particles 200" in printed
    assert cli.main(["tune", "map.npz", "--rate", "1e9"]) == 1
    assert "lower the rate" in capsys.readouterr().err


def test_the_command_knows_maps_of_histograms(rng, tmp_path, capsys):
    small_map(rng, images=False).save(tmp_path / "map.npz")
    record = trade_off(with_samples=False).save(tmp_path)
    assert (
        cli.main(["tune", str(tmp_path / "map.npz"), "--rate", "1", "--record", str(record)]) == 0
    )
    printed = capsys.readouterr().out
    assert printed.startswith("200 particles: ") and "--samples" not in printed
