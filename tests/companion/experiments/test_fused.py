"""Receivers of positions: against those of `onboard_consumers`; what the record says of them."""

from dataclasses import replace

import numpy as np
import pytest
from onboard_consumers import ekf2, ekf3
from small_room import histogram_flight

from trexton.base.errors import ParameterError
from trexton.companion.experiments import evaluation, fused
from trexton.companion.experiments.receivers import RECEIVERS, Receiver, readings
from trexton.companion.experiments.track import Track, tracks
from trexton.localization.estimate import Estimate

DT = 0.08
LOST = np.zeros(2), np.eye(2)


def track(frames: int) -> tuple[np.ndarray, np.ndarray]:
    time = DT * np.arange(frames)
    return time, 2 + 1.5 * np.column_stack([np.sin(0.9 * time), np.sin(0.61 * time)])


@pytest.mark.parametrize(("name", "make"), [("ekf2", ekf2), ("ekf3", ekf3)])
def test_a_receiver_believes_what_an_independent_one_does(rng, name, make):
    """Step by step, outliers that both gates refuse among them."""
    time, truth = track(300)
    pushes = readings(truth, time, 1, rng)
    ours, theirs = Receiver(RECEIVERS[name], 1), make()
    for row, place in enumerate(truth):
        if row:
            ours.drive(pushes[row - 1], DT)
            theirs.drive(pushes[row - 1, 0], DT)
        told = place + rng.normal(0, 0.3, 2) + (50.0 if row % 40 == 39 else 0.0)
        variances = np.array([0.09, 0.16])
        ours.fuse(time[row], told, variances)
        theirs.tell(time[row], told, variances)
        np.testing.assert_allclose(ours.position[0], theirs.state[:2], atol=1e-9)
        np.testing.assert_allclose(ours.velocity[0], theirs.state[2:], atol=1e-9)
        np.testing.assert_allclose(ours.variance[0], np.diagonal(theirs.covariance)[:2])
    assert np.hypot(*(ours.position[0] - truth[-1])) < 1


def test_the_accelerometer_follows_the_track(rng):
    time, truth = track(50)
    pushes = readings(truth, time, 20000, rng).mean(axis=1, keepdims=True)  # noise averages out
    receiver = Receiver(RECEIVERS["ekf2"], 1)
    receiver.fuse(0.0, truth[0], np.full(2, 1e-6))
    receiver.velocity = (truth[1] - truth[0])[None] / DT
    for push in pushes:
        receiver.drive(push, DT)
    np.testing.assert_allclose(receiver.position[0], truth[-1], atol=0.1)


def test_refusals_end_with_a_reset_to_what_is_told():
    receiver = Receiver(RECEIVERS["ekf3"], 2)
    for row in range(200):
        place = np.zeros(2) if row < 50 else np.array([100.0, 0.0])
        receiver.fuse(DT * row, place, np.full(2, 0.04))
        if row == 60:
            assert np.abs(receiver.position).max() < 1  # refused: it cannot have moved so far
        receiver.drive(np.zeros((2, 2)), DT)
    np.testing.assert_allclose(receiver.position, [[100, 0], [100, 0]], atol=0.5)


@pytest.fixture(scope="module")
def record():
    train = histogram_flight("hall", frames=130, turns=5.0)
    test = histogram_flight("again", frames=110, turns=5.0, noise=5)
    return fused.run(train, test, fused.Parameters(repeats=1, vehicles=3))


def test_growing_what_is_sent_makes_receivers_less_sure(record):
    for name in ("guarded", "field"):
        entry = record.values[name]
        assert entry["alike"] > 1 and 0 < entry["usable_rate"] <= 1
        for receiver in RECEIVERS:
            sent, plain = entry[receiver]["sent"], entry[receiver]["plain"]
            assert sent["claimed_cm"] > plain["claimed_cm"]
            assert sent["inside"]["value"] >= plain["inside"]["value"]
            assert sent["nees"] < plain["nees"]
            assert sent["inside"]["low"] <= sent["inside"]["value"] <= sent["inside"]["high"]
    paper = record.values["paper"]
    assert paper["alike"] == 1
    assert paper["ekf2"]["sent"] == paper["ekf2"]["plain"]  # it has nothing but its own word
    assert paper["ekf2"]["sent"]["inside"]["value"] < record.values["field"]["ekf2"]["sent"][
        "inside"
    ]["value"] + 1e-9  # fmt: skip


def test_figures_and_sentence_come_from_the_record(record):
    axes = fused.truth_in_the_region(record).axes
    assert [plot.get_title(loc="left") or plot.get_title() for plot in axes] == [
        "like EKF2", "like EKF3"
    ]  # fmt: skip
    plots = fused.believed_over_time(record).axes
    for plot, name in zip(plots, record.values["order"], strict=True):
        drawn = plot.lines[0].get_ydata()
        shown = np.array(record.series[name]["error_cm"], dtype=float)
        np.testing.assert_allclose(np.asarray(drawn, dtype=float), shown)
    text = fused.finding(record)
    assert text.startswith("Fed with the paper's filter") and text.count("90 % region") == 3


def test_a_method_that_is_lost_all_the_time_is_named_and_drawn_nowhere(monkeypatch):
    def flown(method, *words, **known):
        lost = method.parts["filter"].__class__.__name__ == "Tracks"
        return [
            Track([replace(said, lost=said.lost or lost) for said in run.estimates], run.step_s)
            for run in tracks(method, *words, **known)
        ]

    monkeypatch.setattr(evaluation, "tracks", flown)
    train = histogram_flight("hall", frames=130, turns=5.0)
    test = histogram_flight("again", frames=110, turns=5.0, noise=5)
    record = fused.run(train, test, fused.Parameters(repeats=1, vehicles=2))
    assert record.values["silent"] == ["field"] and "field" not in record.values["order"]
    assert fused.finding(record).endswith("says of every frame that it is lost, and sends nothing.")
    assert len(fused.believed_over_time(record).axes) == len(record.values["order"])
    assert len(fused.truth_in_the_region(record).axes) == 2
    unknown = Track([Estimate(*LOST, lost=True)] * 110, np.zeros(110))
    monkeypatch.setattr(evaluation, "tracks", lambda *words, **known: [unknown])
    with pytest.raises(ParameterError, match="every method says of every frame of again"):
        fused.run(train, test, fused.Parameters(repeats=1, vehicles=2))
