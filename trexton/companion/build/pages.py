"""A page of the book: executed notebooks of its experiments, those of all flights as one.

What flights share stands once. What differs is labelled: text one below the other, figures and
tables as tabs, which need no script. Offers `joined`.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from itertools import groupby, zip_longest
from typing import Any

import nbformat

from trexton.companion.wording import flight_title

Cells = Sequence[nbformat.NotebookNode]
_PLACE = re.compile(r"^% notebook: (\w+)$", re.M)  # where a notebook goes in the prose around it
_LINK = re.compile(r"\[(?P<words>[^\]]*)\]\((?:#(?P<here>\w+)|(?P<page>\w+)\.ipynb)\)")
_HEADING = re.compile(r"^```.*?^```|^#", re.M | re.S)  # outside of what is quoted
_TABLE = re.compile(r'(?<=<table)([^>]*) id="(\w+)"')
_PLAYER = re.compile(r'(?<=src=")(?=\w+-player\.html")')


def label_of(experiment: str) -> str:
    """The identifier of the heading of an experiment."""
    return experiment.replace("_", "-")


def joined(
    notebooks: Mapping[str, Mapping[str, nbformat.NotebookNode]],
    see: Callable[[str, str], str],
    prose: str = "",
) -> nbformat.NotebookNode:
    """One notebook for a page.

    Parameters
    ----------
    notebooks : mapping
        Executed notebooks by experiment and flight ("" for what runs over all flights).
    see : callable
        ``see(name, words)``: a link to a page or an experiment, or the words alone.
    prose : str
        What stands before them, or around: ``% notebook: NAME`` is the place of one of them.
    """
    page, left = _Page(see), dict(notebooks)
    pieces = _PLACE.split(prose)
    for text, name in zip_longest(pieces[::2], pieces[1::2]):
        if text.strip():
            page.say(text)
        if name in left:
            page.add(name, left.pop(name))
    for name, flights in left.items():
        page.add(name, flights)
    return nbformat.v4.new_notebook(cells=page.cells)


def figure_names(experiment: str, flights: Mapping[str, nbformat.NotebookNode]) -> list[str]:
    """Names of the captioned figures of an experiment, those of the first flight first."""
    return [
        _name(experiment, flight, shown)
        for flight, notebook in flights.items()
        for cell in notebook.cells
        if (shown := _figure(cell))
    ]


class _Page:
    """The cells of a page as they are put together."""

    def __init__(self, see: Callable[[str, str], str]):
        self.see = see
        self.cells: list[nbformat.NotebookNode] = []
        self._groups = 0

    def say(self, text: str) -> None:
        # A drawn id would build the page anew every time.
        self.cells.append(nbformat.v4.new_markdown_cell(text, id=f"cell-{len(self.cells)}"))

    def add(self, experiment: str, flights: Mapping[str, nbformat.NotebookNode]) -> None:
        """Append an experiment: the cells of all flights, those that are alike once."""
        below = bool(self.cells)
        columns = [
            [cell for cell in notebook.cells if "remove-cell" not in cell.metadata.get("tags", ())]
            for notebook in flights.values()
        ]
        names = set(figure_names(experiment, flights))
        prepared = {
            flight: [self._prepared(cell, experiment, flight, flights, names) for cell in column]
            for flight, column in zip(flights, columns, strict=True)
        }
        rows = list(zip(*columns, strict=True))  # as many cells: the same notebook, run twice
        at = 0
        for kind, run in groupby(rows, key=_kind):
            end = at + len(list(run))
            shown = {flight: cells[at:end] for flight, cells in prepared.items()}
            if kind == "alike":
                for number, cell in enumerate(next(iter(shown.values())), start=at):
                    self._append(cell, "" if number else experiment, below)
                    if not number and len(flights) == 1 and "" not in flights:
                        ((flight, notebook),) = flights.items()
                        self.say(_named(notebook.metadata.get("data", flight)))
            else:
                self._beside(shown, tabs=kind == "shown")
            at = end

    def _append(self, cell: Any, experiment: str = "", below: bool = False) -> None:
        """Append a cell; the first of an `experiment` is its heading, `below` the page's own."""
        if cell.cell_type == "markdown":
            if below:
                cell.source = _HEADING.sub(lambda it: "##" if it[0] == "#" else it[0], cell.source)
            if experiment and cell.source.startswith("#"):
                cell.source = f"({experiment})=\n{cell.source}"
        cell["id"] = f"cell-{len(self.cells)}"
        self.cells.append(cell)

    def _beside(self, shown: Mapping[str, Cells], tabs: bool) -> None:
        """What cells show on each flight, under its name."""
        shown = {flight: cells for flight, cells in shown.items() if any(map(_said, cells))}
        tabs = tabs and len(shown) > 1
        if tabs:
            self._groups += 1
            self.say(_tabs(f"flights-{self._groups}", list(shown)))
        for flight, cells in shown.items():
            self.say(f'<div class="of-flight">\n{_named(flight)}')
            for cell in cells:
                self._append(cell)
            self.say("</div>")
        if tabs:
            self.say("</div>")

    def _prepared(
        self,
        cell: nbformat.NotebookNode,
        experiment: str,
        flight: str,
        flights: Mapping[str, object],
        figures: set[str],
    ) -> nbformat.NotebookNode:
        """A copy whose figures, tables and links have names that are their own in the book."""
        cell = deepcopy(cell)

        def link(match: re.Match[str]) -> str:
            if match["page"]:
                return self.see(match["page"], match["words"])
            own = [_name(experiment, each, match["here"]) for each in (flight, *flights)]
            if figure := next((name for name in own if name in figures), None):
                return f"{{numref}}`{figure}`"
            return f'<a href="#{own[0]}">{match["words"]}</a>'

        if cell.cell_type == "markdown":
            cell.source = _LINK.sub(link, cell.source)
        elif name := _figure(cell):
            cell.metadata["mystnb"]["figure"]["name"] = _name(experiment, flight, name)
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "text/markdown" in data:
                data["text/markdown"] = _LINK.sub(link, data["text/markdown"])
            if "text/html" in data and flight:
                html = _PLAYER.sub(f"{flight}/", data["text/html"])
                data["text/html"] = _TABLE.sub(
                    lambda found: f'{found[1]} id="{_name(experiment, flight, found[2])}"', html
                )
        return cell


def _name(experiment: str, flight: str, shown: str) -> str:
    return re.sub(r"[/_]", "-", f"{experiment}-{flight}-{shown}").lower()


def _figure(cell: nbformat.NotebookNode) -> str | None:
    """The name under which a cell shows a captioned figure; None if it shows none."""
    captioned = "figure" in cell.metadata.get("mystnb", {})
    shown = re.search(r"""page\.show\(\s*["'](\w+)["']""", cell.source)
    drawn = any("image/svg+xml" in output.get("data", {}) for output in cell.get("outputs", ()))
    return shown[1] if captioned and shown and drawn else None


def _kind(row: Cells) -> str:
    """``alike`` on all flights; else ``text``, in words, or ``shown``, in pictures or tables."""
    first, said = row[0], [data for cell in row for data in _said(cell)]
    # A page beside it differs though its address does not.
    player = any(_PLAYER.search(str(data.get("text/html", ""))) for data in said)
    same = all(cell.source == first.source and _said(cell) == _said(first) for cell in row)
    if len(row) == 1 or (same and not player):
        return "alike"
    return "text" if all(map(_is_text, said)) else "shown"


def _said(cell: nbformat.NotebookNode) -> list[Mapping[str, Any]]:
    return [
        output.get("data", {"text/plain": output.get("text", "")})
        for output in cell.get("outputs", ())
    ]


def _is_text(data: Mapping[str, Any]) -> bool:
    html = str(data.get("text/html", ""))
    return "image/svg+xml" not in data and (not html or html.startswith('<p class="finding"'))


def _named(flight: str) -> str:
    return f'<p class="flight-name">{flight_title(flight)}</p>'


def _tabs(group: str, flights: Sequence[str]) -> str:
    """The beginning of an area with a tab for each flight, the first chosen."""
    choices = "".join(
        f'<input type="radio" name="{group}" id="{group}-{i}" value="{flight}"'
        f'{"" if i else " checked"}><label for="{group}-{i}">{flight_title(flight)}</label>'
        for i, flight in enumerate(flights)
    )
    return f'<div class="flights" role="group" aria-label="Flights">{choices}'
