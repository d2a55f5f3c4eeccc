"""Names that prose may use beside the records: the headlines, the paper map, the version."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import nbformat

from trexton.companion.build.headlines import headlines
from trexton.companion.build.paper_map import map_table
from trexton.companion.claims.ledger import load_records
from trexton.flights.registry import flight_title
from trexton.localization.training_set import EXCLUDED_SECONDS
from trexton.onboard.edges import Edge, classes_of_options, edge_classes
from trexton.onboard.sinks import SINKS
from trexton.onboard.sources import SOURCES

__all__ = [
    "name_figures",
    "page_names",
    "refer_by_number",
    "with_flight",
]

_TABLE = re.compile(r'<table[^>]* id="(\w+)"[^>]*>\s*<caption>Table (\d+)\.')


def page_names(results: Path, values: Mapping[str, Mapping[str, Any]]) -> dict[str, object]:
    """``headlines``, ``paper_map`` (a function of ``see``), ``version``, ``excluded_s``, and the
    tables of ``sinks`` and ``sources`` as they declare themselves.

    Parameters
    ----------
    results : Path
        Folder of records.
    values : mapping
        Values by flight and experiment of the pages that the book has.
    """

    def paper_map(see: Callable[[str, str], str]) -> str:
        records = {
            flight: {name: each for name, each in own.items() if name in values[flight]}
            for flight, own in load_records(results).items()
            if flight in values
        }
        return map_table(records, see)

    return {
        "headlines": headlines(values),
        "paper_map": paper_map,
        "version": version("trexton"),
        "excluded_s": EXCLUDED_SECONDS,
        "sinks": _table(edge_classes("sinks", SINKS), "--output"),
        "sources": _table(edge_classes("sources", SOURCES), "--camera"),
    }


def _table(edges: Iterable[type[Edge]], flag: str) -> str:
    """A table of sinks or sources: addresses and what they mean, then the options."""
    edges = list(dict.fromkeys(edges))
    rows = [f"| `{flag}` | |", "|---|---|"]
    rows += [f"| `{address}` | {meaning} |" for edge in edges
             for address, meaning in edge.addresses.items()]  # fmt: skip
    options = [(kind, each) for kind in classes_of_options(edges) for each in kind.declared()]
    if options:
        rows += ["", "| option | default | |", "|---|---|---|"]
    for kind, each in options:
        default = "" if each.default in (None, "", False) else f"`{each.default}`"
        rows.append(f"| `{kind.flag(each.name)}` | {default} | {each.meaning} |")
    return "\n".join(rows) + "\n"


def name_figures(notebook: nbformat.NotebookNode, page: str) -> list[str]:
    """Give each captioned figure of an executed notebook the name by which text refers to it.

    Returns
    -------
    list of str
        The names, in order: the page's and the figure's, as in ``cyberzoo-mocap-training-floor``.
    """
    names = []
    for cell in notebook.cells:
        figure = cell.metadata.get("mystnb", {}).get("figure")
        shown = re.search(r"""page\.show\(\s*["'](\w+)["']""", cell.source)
        drawn = any("image/svg+xml" in output.get("data", {}) for output in cell.get("outputs", ()))
        if figure is not None and shown and drawn:
            figure["name"] = _figure_name(page, shown[1])
            names.append(figure["name"])
    return names


def refer_by_number(notebook: nbformat.NotebookNode, page: str, figures: Sequence[str]) -> None:
    """Make links to a page's own figures and tables numbered references: ``[the plan](#floor)``.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
        Changed in place: its text, and the text that its cells show.
    figures : sequence of str
        Names of the figures that are there; a link to what is not becomes the words it stands on.
    """
    shown = (
        output.get("data", {}).get("text/html", "")
        for cell in notebook.cells
        for output in cell.get("outputs", ())
    )
    tables = {name: number for html in shown for name, number in _TABLE.findall(html)}

    def refer(match: re.Match[str]) -> str:
        name = match["name"]
        if (figure := _figure_name(page, name)) in figures:
            return f"{{numref}}`{figure}`"
        return f'<a href="#{name}">Table {tables[name]}</a>' if name in tables else match["words"]

    def referred(text: str) -> str:
        return re.sub(r"\[(?P<words>[^\]]+)\]\(#(?P<name>\w+)\)", refer, text)

    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = referred(cell.source)
        for output in cell.get("outputs", ()):
            if said := output.get("data", {}).get("text/markdown"):
                output.data["text/markdown"] = referred(said)


def _figure_name(page: str, figure: str) -> str:
    return re.sub(r"[/_]", "-", f"{page}-{figure}").lower()


def with_flight(
    notebook: nbformat.NotebookNode,
    flight: str,
    twins: Mapping[str, str],
) -> None:
    """End the heading of an experiment's page with its flight, and the page with its twins.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
        Changed in place.
    twins : mapping of str to str
        The page of the same experiment on other flights, by flight.
    """
    first = notebook.cells[0] if notebook.cells else None
    if not flight or first is None or not first.source.startswith("# "):
        return
    heading, _, rest = first.source.partition("\n")
    between = "" if heading.endswith("?") else ":"
    first.source = f"{heading}{between} {flight_title(flight)}\n{rest}"
    links = ", ".join(f"{{doc}}`{flight_title(each)} </{page}>`" for each, page in twins.items())
    if links:
        notebook.cells.append(
            nbformat.v4.new_markdown_cell(f"The same on another flight: {links}.", id="twins")
        )
