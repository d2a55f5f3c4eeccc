"""Beyond the paper: the record agrees with itself, its figures with the record."""

import re

import numpy as np
import pytest
from matplotlib.image import AxesImage
from matplotlib.text import Text
from small_room import histogram_flight, picture_flight

from trexton.companion.experiments import beyond
from trexton.companion.wording import interval, percent


@pytest.fixture(scope="module")
def record():
    train, test = histogram_flight("hall", frames=160), histogram_flight("later", 80, noise=2)
    return beyond.run(train, test, beyond.Parameters(repeats=2, particles=20))


def test_every_variant_is_flown_and_summed_up(record):
    flown = [
        name for name, variant in beyond.VARIANTS.items() if not (variant.whole or variant.odometry)
    ]
    for name in flown:
        values = record.values[name]
        assert 0 < values["median_cm"] <= values["p95_cm"]
        for entry in (values["mean_cm"], values["held"]):
            assert entry["low"] <= entry["value"] <= entry["high"]
        assert values["mean_cm"]["low"] < values["mean_cm"]["high"]
    assert set(record.series["errors_cm"]) == set(flown)


def test_the_field_errs_less_than_the_filter_it_is_compared_with(record):
    field, paper = (record.values[name]["mean_cm"] for name in ("field", "paper"))
    assert field["high"] < paper["low"]
    ratio = field["value"] / paper["value"]
    assert record.values["ratio"] == pytest.approx(ratio)


def test_the_lag_is_where_the_error_is_least(record):
    lag = record.values["lag"]
    assert lag["error_cm"] <= lag["unshifted_cm"] and lag["s"] >= 0
    assert (lag["s"] == 0) == (lag["error_cm"] == lag["unshifted_cm"])


def test_every_look_says_what_followed(record):
    protocol = record.values["protocol"]
    assert protocol["count"] == len(protocol["evaluations"]) > 0
    assert all(look["followed"] for look in protocol["evaluations"])
    # a look at landings counts them in words
    assert all(look["mean_m"] or "land" in look["state"] for look in protocol["evaluations"])


def test_equal_seeds_give_equal_values(record):
    train, test = histogram_flight("hall", frames=160), histogram_flight("later", 80, noise=2)
    again = beyond.run(train, test, beyond.Parameters(repeats=2, particles=20))
    assert again.values == record.values


def test_the_finding_quotes_the_record(record):
    sentences = beyond.finding(record)
    assert interval(record.values["field"]["mean_cm"], "cm") in sentences
    for name in ("field", "paper"):
        assert percent(record.values[name]["held"]["value"]) in sentences


def test_the_figures_show_the_record(record):
    plot = beyond.errors(record).axes[0]
    drawn = [name for name in beyond._DRAWN if name in record.series["errors_cm"]]
    assert len(beyond._DRAWN) <= 5
    for line, name in zip(plot.lines, drawn, strict=True):
        np.testing.assert_allclose(line.get_ydata(), record.series["errors_cm"][name])
    labels = {each.get_text(): each.get_color() for each in plot.texts}
    assert labels == {line.get_label(): line.get_color() for line in plot.lines}


def test_one_frame_is_drawn_as_the_field_saw_it(record):
    frames = record.series["frames"]
    counts = [len(seen["after"]) for seen in frames]
    still = counts.index(max(counts))
    assert counts[0] == 1 < counts[still]  # several while it is lost
    steps = np.diff([seen["number"] for seen in frames])
    assert np.flatnonzero(steps != 1).tolist() == [beyond.BEFORE - 1] and len(frames) == 8
    moved = np.diff([seen["truth_m"] for seen in frames], axis=0)
    assert np.hypot(*moved.T).argmax() == beyond.BEFORE - 1
    off = [np.hypot(*np.subtract(seen["estimate_m"], seen["truth_m"])) for seen in frames]
    assert off[0] < 0.3 > off[-1] and all(np.max(seen["likelihood"]) == 1 for seen in frames)
    figure = beyond.one_frame(record)
    for step, seen in enumerate(frames):
        for name in ("before", "after"):
            assert 0.9 < sum(each["weight"] for each in seen[name]) <= 1 + 1e-9
        layer = re.compile(f"step-{step}-[0-9]+" + ("$" if step == still else "-hidden"))
        histogram, likely, before, after = (
            [each for each in axes.get_children() if layer.match(str(each.get_gid()))]
            for axes in figure.axes
        )
        (steps,) = histogram
        np.testing.assert_allclose(steps.get_data().values, 100 * np.array(seen["histogram"]))
        (picture,) = (each for each in likely if isinstance(each, AxesImage))
        np.testing.assert_array_equal(picture.get_array(), seen["likelihood"])
        for drawn, name in ((before, "before"), (after, "after")):
            assert sum(isinstance(each, Text) for each in drawn) == len(seen[name])


def test_parts_of_the_image_are_flown_where_there_are_images(tmp_path):
    train = picture_flight(tmp_path / "a", "train")
    test = picture_flight(tmp_path / "b", "test", frames=20, turns=2.5)
    parameters = beyond.Parameters(repeats=1, particles=10, textons=4, samples=60, neighbors=2)
    assert "field_whole" in beyond.run(train, test, parameters).values
