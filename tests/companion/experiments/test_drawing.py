"""What a figure tells of itself: marks and bars, and of areas nothing."""

from __future__ import annotations

import numpy as np

from trexton.companion.experiments.drawing import chart_data
from trexton.companion.experiments.style import canvas


def told(draw) -> dict:
    with canvas() as (figure, axes):
        draw(axes[0, 0])
    (data,) = chart_data(figure)
    return data


def test_dots_are_told_without_a_label():
    lines = told(lambda plot: plot.scatter([1, 2], [3, 4]))["lines"]
    assert lines == [{"label": "", "x": [1, 2], "y": [3, 4]}]


def test_a_map_with_a_name_tells_its_cells():
    cells = np.array([[1.0, np.nan], [2.0, 2.0]])
    lines = told(
        lambda plot: plot.imshow(cells, origin="lower", extent=(0, 4, 0, 2), label="share (%)")
    )["lines"]
    assert lines == [
        {"label": "share (%): 1", "x": [1], "y": [0.5]},
        {"label": "share (%): 2", "x": [1, 3], "y": [1.5, 1.5]},
    ]


def test_an_area_has_no_point_at_its_baseline():
    def draw(plot):
        plot.stackplot([0, 1, 2], [1, 2, 3], [1, 1, 1], labels=["histogram", "filter"])
        plot.fill_between([0, 1, 2], [3, 4, 5], label="believed")
        plot.plot([0, 1, 2], [2, 3, 4], label="whole frame")

    assert [line["label"] for line in told(draw)["lines"]] == ["whole frame"]


def test_bars_and_marks_beside_a_tick_bear_its_name():
    def draw(plot):
        for offset, name in ((-0.2667, "paper"), (0.2667, "field")):
            plot.bar([offset, 1 + offset], [2, 3], 0.25, label=name)
        plot.errorbar([0.85], [2], yerr=1, fmt="o")
        plot.set_xticks([0, 1], ["first quarter", "last"])

    names = told(draw)["x"]["names"]
    assert names["-0.2667"] == names["0.2667"] == names["0"] == "first quarter"
    assert names["0.7333"] == names["0.85"] == names["1.267"] == "last"
