"""Claims against errors, alone and fused: what the record counts, and that the figures show it."""

from dataclasses import replace

import numpy as np
import pytest
from small_room import histogram_flight

from trexton.companion.experiments import uncertainty
from trexton.companion.experiments.receivers import RECEIVERS
from trexton.companion.experiments.track import Track, tracks
from trexton.companion.experiments.uncertainty import METHODS, SENT


def flights(frames):
    train = histogram_flight("hall", frames=160, turns=6.0)
    return train, histogram_flight("again", frames=frames, turns=6.0, noise=5)


@pytest.fixture(scope="module")
def record():
    return uncertainty.run(*flights(100), uncertainty.Parameters(repeats=2, vehicles=3))


def test_every_method_is_judged_by_its_own_claims(record):
    assert list(record.values) == list(METHODS)
    for name in METHODS:
        values = record.values[name]
        assert len(record.series[name]) == 10
        held = values["within_90"]
        assert held["low"] <= held["value"] <= held["high"]
        assert values["nees"]["value"] > 0
        claimed = [group["claimed_cm"] for group in record.series[name]]
        assert claimed == sorted(claimed)
    field, paper = record.values["field"], record.values["paper"]
    assert paper["independent_s"] is None and field["independent_s"] > 0
    off = {name: abs(record.values[name]["within_90"]["value"] - 0.9) for name in METHODS}
    assert off["field"] <= off["paper"] + 0.05


def test_growing_what_is_sent_makes_receivers_less_sure(record):
    for receiver in RECEIVERS:
        sent, plain = (record.values["field"][receiver][each]["inside"] for each in SENT)
        assert sent["value"] >= plain["value"]
        assert sent["low"] <= sent["value"] <= sent["high"]
    paper = record.values["paper"]
    assert paper["ekf2"]["sent"] == paper["ekf2"]["plain"]  # it has nothing but its own word
    assert paper["ekf2"]["sent"]["inside"]["value"] < record.values["field"]["ekf2"]["sent"][
        "inside"
    ]["value"] + 1e-9  # fmt: skip


def test_figures_and_sentence_come_from_the_record(record):
    plot, _ = uncertainty.error_against_claim(record).axes
    for line, name in zip(plot.lines, METHODS, strict=False):
        drawn = [group["error_cm"] for group in record.series[name]]
        np.testing.assert_allclose(line.get_ydata(), drawn)
    assert plot.get_xscale() == plot.get_yscale() == "log"  # one wild claim hides no other
    axes = uncertainty.truth_in_the_region(record).axes
    assert [plot.get_title(loc="left") or plot.get_title() for plot in axes] == [
        "like EKF2", "like EKF3"
    ]  # fmt: skip
    text = uncertainty.finding(record)
    assert text.startswith("The paper's filter has 90 % regions") and text.count("cover") == 2
    assert text.count("where an autopilot fuses them as PX4 does") == 2


@pytest.mark.parametrize("always", [["field"], ["paper", "field"]])
def test_a_method_that_is_lost_all_the_time_sends_nothing(monkeypatch, always):
    def flown(method, *words, **known):
        lost = method.method in always
        return [
            Track.of([replace(said, lost=said.lost or lost) for said in run.estimates], run.step_s)
            for run in tracks(method, *words, **known)
        ]

    monkeypatch.setattr(uncertainty, "tracks", flown)
    record = uncertainty.run(*flights(110), uncertainty.Parameters(repeats=1, vehicles=2))
    assert [name for name in METHODS if "ekf2" not in record.values[name]] == always
    assert uncertainty.finding(record).endswith("It is always lost, and sends nothing to fuse.")
    assert len(uncertainty.truth_in_the_region(record).axes) == 2


def test_the_error_of_all_frames_stands_at_full_availability(record):
    _, plot = uncertainty.error_against_claim(record).axes
    lines = {line.get_label(): line for line in plot.lines}
    for name, label in METHODS.items():
        values, line = record.values[name], lines[label]
        every = np.sqrt(2) * values["axis_cm"]
        assert line.get_ydata()[-1] == pytest.approx(every, rel=0.05)
        assert values["far_auc"] is None or 0 <= values["far_auc"] <= 1
