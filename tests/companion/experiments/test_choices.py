"""What the open choices cost: one changes at a time."""

from __future__ import annotations

import pytest
from conftest import small_flight

from trexton.companion.experiments import choices


@pytest.fixture(scope="module")
def record():
    flight = small_flight(120)
    return choices.run(
        flight.part("train"), flight.part("test"), choices.Parameters(repeats=2, particles=30)
    )


def test_every_choice_is_measured_beside_the_paper(record):
    variants, order = record.values["variants"], record.values["order"]
    assert (
        order[0] == "paper" and len(order) == len(set(order)) == 11 and set(order) == set(variants)
    )
    assert all(
        variant["mean_cm"]["low"] <= variant["mean_cm"]["value"] <= variant["mean_cm"]["high"]
        for variant in variants.values()
    )


def test_the_variants_differ_from_the_paper_and_repeat_with_the_seed(record):
    flight = small_flight(120)
    again = choices.run(
        flight.part("train"), flight.part("test"), choices.Parameters(repeats=2, particles=30)
    )
    assert again.values == record.values
    paper = record.values["variants"]["paper"]["mean_cm"]
    # This one changes covariances a little, which random histograms need not show.
    same = {
        key for key, variant in record.values["variants"].items() if variant["mean_cm"] == paper
    }
    assert same <= {"paper", "near_in_time"}


def test_the_figure_shows_the_numbers_of_the_record(record):
    axes = choices.costs(record).axes[0]
    order = record.values["order"]
    points = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"]
    assert points == [record.values["variants"][key]["mean_cm"]["value"] for key in order]
    assert [" ".join(label.get_text().split()) for label in axes.get_yticklabels()] == [
        record.values["variants"][key]["label"] for key in order
    ]
    filled = [
        line.get_markerfacecolor() != "white" for line in axes.lines if line.get_marker() == "o"
    ]
    code = [record.values["variants"][key]["flight_code"] for key in order]
    assert filled == [True, *code[1:]]
