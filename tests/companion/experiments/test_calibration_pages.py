"""Claims against errors: what the record counts, and that the figures show it."""

import numpy as np
import pytest
from small_room import histogram_flight

from trexton.companion.experiments import calibration


@pytest.fixture(scope="module")
def record():
    train = histogram_flight("hall", frames=160, turns=6.0)
    test = histogram_flight("again", frames=100, turns=6.0, noise=5)
    return calibration.run(train, test, calibration.Parameters(repeats=2))


def test_every_method_is_judged_by_its_own_claims(record):
    assert record.values["order"] == ["paper", "guarded", "field"]
    for name in record.values["order"]:
        values = record.values[name]
        assert len(values["quarters"]) == 4 and len(record.series[name]) == 10
        held = values["within_90"]
        assert held["low"] <= held["value"] <= held["high"]
        assert np.mean(values["quarters"]) == pytest.approx(held["value"], abs=0.03)
        assert values["nees"]["value"] > 0 and 0 <= values["landing_allowed_rate"] <= 1
        claimed = [group["claimed_cm"] for group in record.series[name]]
        assert claimed == sorted(claimed)
    guarded, paper = record.values["guarded"], record.values["paper"]
    assert paper["single_frame"]["nees"] is None and paper["independent_s"] is None
    assert guarded["single_frame"]["within_90"] > 0.5 and guarded["independent_s"] > 0
    off = {name: abs(record.values[name]["within_90"]["value"] - 0.9) for name in METHODS}
    assert off["guarded"] <= off["paper"] + 0.05


def test_a_quarter_is_judged_by_what_chance_alone_does():
    few, many = calibration._by_chance(9.6), calibration._by_chance(400)
    assert few["independent_frames"] == 10 and few["low"] == pytest.approx(0.7) and few["high"] == 1
    assert 0.86 < many["low"] < 0.9 < many["high"] < 0.94
    assert calibration._by_chance(0.1)["independent_frames"] == 1


METHODS = ("paper", "guarded")


def test_figures_and_sentence_come_from_the_record(record):
    (plot,) = calibration.error_against_claim(record).axes
    for line, name in zip(plot.lines, record.values["order"], strict=False):
        drawn = [group["error_cm"] for group in record.series[name]]
        np.testing.assert_allclose(line.get_ydata(), drawn)
    assert plot.get_xscale() == plot.get_yscale() == "log"  # one wild claim hides no other
    (bars,) = calibration.regions_by_quarter(record).axes
    heights = [bar.get_height() for bar in bars.patches]
    shares = [
        100 * share for name in record.values["order"] for share in record.values[name]["quarters"]
    ]
    np.testing.assert_allclose(heights, shares)
    assert len(bars.collections) == 2 and record.values["paper"]["chance"] is None
    (first, *_) = bars.collections[-1].get_segments()
    chance = record.values["field"]["chance"]
    np.testing.assert_allclose(first[:, 1], [100 * chance["low"], 100 * chance["high"]])
    text = calibration.finding(record)
    assert text.startswith("The paper's filter claims") and text.count("90 % regions") == 3
