"""Figures as files: SVG for a page, wide and for a phone, and a picture.

A page shows the layout that fits its width; the words keep their size in both. It can also show one
`layer` of a figure in place of another.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.legend import Legend
from matplotlib.pyplot import setp
from matplotlib.ticker import LogLocator

PHONE_WIDTH = 4.2  # inches: at this width words stay readable across 330 pixels
_ONE_COLUMN = 4  # panels that are stacked; more stand in two columns
_SHORT = 24  # characters of a label, of which two fit
_GRID = 3  # columns, from which on a figure is a sheet of pictures

# Scales are small numbers of many digits that count, and no coordinates.
_HIDDEN = re.compile(r'(?=id="step-\d+-\d+-hidden")')
_NUMBER = re.compile(r"scale\([^)]*\)|(?<=[ MLQCz\"(,])(-?\d+\.\d{3,})")


def to_svg(figure: Figure, **options: Any) -> bytes:
    """The figure as SVG, its coordinates to a tenth of a point."""
    stream = io.BytesIO()
    # Identifiers are made from a salt when the figure is written; without it every run has others.
    with matplotlib.rc_context({"svg.hashsalt": "trexton", "image.composite_image": False}):
        figure.savefig(stream, format="svg", metadata={"Date": None}, **options)
    text = _HIDDEN.sub('display="none" ', stream.getvalue().decode())
    return _NUMBER.sub(lambda it: f"{round(float(it[1]), 1):g}" if it[1] else it[0], text).encode()


@contextmanager
def layer(figure: Figure, step: int, shown: bool) -> Iterator[None]:
    """What is drawn meanwhile is a step that a page can show in place of the `shown` one."""
    before = _drawn(figure)
    yield
    for count, artist in enumerate(_drawn(figure)):
        if artist not in before:
            artist.set_gid(f"step-{step}-{count}" + ("" if shown else "-hidden"))


def _drawn(figure: Figure) -> list[Artist]:
    return [artist for axes in figure.axes for artist in axes.get_children()]


def for_phones(figure: Figure) -> bytes | None:
    """SVG of a figure for a narrow page; None if it is narrow already, or a sheet of pictures.

    Panels beside one another come to stand below one another. The figure itself is changed.
    """
    width, height = figure.get_size_inches()
    panels = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    grid = panels[0].get_gridspec()
    assert grid is not None
    rows, columns = grid.get_geometry()
    if width <= PHONE_WIDTH or columns > _GRID:
        return None
    shown = [axes for axes in panels if axes.axison]
    across = 1 if len(shown) <= _ONE_COLUMN else 2
    down = -(-len(shown) // across)
    grid = GridSpec(down, across, figure)
    labelled = [columns == 1 and axes.get_position().x0 > 0.25 for axes in shown]
    left: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1)}
    for count, axes in enumerate(shown):
        row, column = divmod(count, columns)
        # What panels shared is said at each, where it is said at all.
        axes.tick_params(labelleft=True, labelbottom=True)
        axes.set_ylabel(axes.get_ylabel() or panels[row * columns].get_ylabel())
        axes.set_xlabel(axes.get_xlabel() or panels[(rows - 1) * columns + column].get_xlabel())
    for count, axes in enumerate(shown):
        axes.set_subplotspec(grid[count])
        if isinstance(axes.xaxis.get_major_locator(), LogLocator):
            axes.xaxis.set_major_locator(LogLocator())  # few, so that they stay apart
        # Where long labels take the left, a legend that begins there would squeeze the plot.
        place = {"loc": "lower right", "bbox_to_anchor": (1, 1)} if labelled[count] else left
        _stack(axes, axes.get_legend(), borderaxespad=0.2, **place)
    for legend in figure.legends:
        _stack(figure, legend, loc="outside lower center")
    high = min(height / rows, 1.1 * PHONE_WIDTH / across)  # of a row
    figure.set_size_inches(PHONE_WIDTH, down * high)
    figure.draw_without_rendering()
    return to_svg(figure, bbox_inches="tight", pad_inches=0.03)


def _stack(owner: Axes | Figure, legend: Legend | None, **place: Any) -> None:
    """A legend of several columns in so few that it fits a phone."""
    if legend is not None and legend._ncols > 1:  # type: ignore[attr-defined]
        labels = [text.get_text() for text in legend.get_texts()]
        handles = [handle for handle in legend.legend_handles if handle is not None]
        if isinstance(owner, Axes):
            handles, labels = owner.get_legend_handles_labels()
        legend.remove()
        short = max(map(len, labels)) <= _SHORT
        owner.legend(
            handles,
            labels,
            ncols=2 if short else 1,
            columnspacing=1.2,
            frameon=False,
            fontsize=9,
            **place,
        )


def to_png(figure: Figure) -> bytes:
    """The figure as a picture of 150 dots an inch."""
    stream = io.BytesIO()
    hidden = [each for each in _drawn(figure) if str(each.get_gid()).endswith("-hidden")]
    setp(hidden, visible=False)
    figure.savefig(stream, format="png", dpi=150)
    setp(hidden, visible=True)
    return stream.getvalue()
