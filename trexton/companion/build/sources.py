"""Gather everything that becomes a page: prose with its numbers, executed notebooks, downloads."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import nbformat
import yaml

import trexton
from trexton.base.errors import DataError
from trexton.companion.build.console_output import with_output
from trexton.companion.build.display import Outcome
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.notebooks import outputs_of
from trexton.companion.build.pages import (
    name_figures,
    page_names,
    refer_by_number,
    with_flight,
)
from trexton.companion.build.prose import records_by_name, render
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights.frames import ImageFiles

__all__ = ["Contents", "public_names", "stage"]

# Pages whose commands are run, in order, on a part of a flight with images.
_EXECUTED = {"your_flight"}


@dataclass(frozen=True)
class Contents:
    """What a book is made of.

    Attributes
    ----------
    source : Path
        Folder of prose, ``_config.yml``, ``_toc.yml`` and ``_static``.
    notebooks : Path
        Folder of the notebooks that ran.
    results : Path
    pairs : sequence of FlightPair
    outcomes : sequence of Outcome
    absent : mapping of str to str
        Flights that the book would have liked, and why they are not there.
    """

    source: Path
    notebooks: Path
    results: Path
    pairs: Sequence[FlightPair]
    outcomes: Sequence[Outcome]
    absent: Mapping[str, str] = field(default_factory=dict)

    def good(self, flight: str) -> list[str]:
        """Experiments that have results on `flight` ("" for those over every flight)."""
        ready = {o.experiment for o in self.outcomes if o.flight == flight and o.good}
        return [name for name in EXPERIMENTS if name in ready] + sorted(ready - EXPERIMENTS.keys())


def stage(contents: Contents, folder: Path, toc_file: str = "_toc.yml") -> None:
    """Fill `folder` with the sources of the book, ready for Jupyter Book.

    Raises
    ------
    DataError
        A page of the table of contents does not exist, or asks for a value no record has.
    """
    toc = _table_of_contents(contents, toc_file)
    pages = {
        toc["root"],
        *(chapter["file"] for part in toc["parts"] for chapter in part["chapters"]),
    }
    context, pictures, figures = _context(contents), _pictures(contents), _figures(contents)
    flights = (pair.test for pair in contents.pairs)
    recorded = next((one for one in flights if isinstance(one.frames, ImageFiles)), None)

    def first_figure(page: str) -> str:
        """A reference to the first figure of a page, in brackets; nothing where it has none."""
        return f" ({{numref}}`{figures[page][0]}`)" if figures.get(page) else ""

    context["first_figure"] = first_figure
    for page in sorted(pages):
        source = contents.source / f"{page}.md"
        if source.is_file():
            text = render(source, context, pages, pictures)
            if page in _EXECUTED and recorded:
                text = with_output(text, recorded, contents.results / f"{page}.json")
            (folder / f"{page}.md").write_text(text, encoding="utf-8")
    for flight in ["", *(pair.name for pair in contents.pairs)]:
        (folder / flight).mkdir(exist_ok=True)
        for name in contents.good(flight):
            for path in outputs_of(contents.results / flight, name):
                if path.suffix == ".ipynb":
                    twins = {
                        pair.name: f"{pair.name}/{name}"
                        for pair in contents.pairs
                        if flight not in ("", pair.name) and name in contents.good(pair.name)
                    }
                    notebook = nbformat.read(path, as_version=4)
                    named = name_figures(notebook, f"{flight}/{name}")
                    refer_by_number(notebook, f"{flight}/{name}", named)
                    with_flight(notebook, flight, twins)
                    _write_notebook(notebook, folder / flight / path.name, contents.good(flight))
                else:
                    shutil.copyfile(path, folder / flight / path.name)
    for name in ("_config.yml", "references.bib"):
        shutil.copyfile(contents.source / name, folder / name)
    shutil.copytree(contents.source / "_static", folder / "_static")
    (folder / "_toc.yml").write_text(yaml.safe_dump(toc, sort_keys=False), encoding="utf-8")


def _write_notebook(notebook: nbformat.NotebookNode, target: Path, pages: list[str]) -> None:
    """Write an executed notebook; links to experiments that have no page become plain text."""

    def link(match: re.Match[str]) -> str:
        return match[0] if match["page"] in pages else match["text"]

    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = re.sub(r"\[(?P<text>[^\]]*)\]\((?P<page>\w+)\.ipynb\)", link, cell.source)
    nbformat.write(notebook, target)


def _context(contents: Contents) -> dict[str, Any]:
    """The names that prose may use."""
    records = records_by_name(contents.results, contents.outcomes)
    flights = [
        {
            "name": pair.name,
            "train": pair.train,
            "test": pair.test,
            "notes": pair.train.notes,
            "experiments": [(name, _title(name)) for name in contents.good(pair.name)],
            "players": [name for name in contents.good(pair.name)
                        if (contents.results / pair.name / f"{name}-player.html").is_file()],
            "skipped": [(_title(o.experiment), o.reasons[0]) for o in contents.outcomes
                        if o.flight == pair.name and o.status in ("skipped", "failed")],
        }
        for pair in contents.pairs
    ]  # fmt: skip
    named = {flight["name"]: flight for flight in flights}
    return page_names(contents.results, records) | {
        "sim": records.get("sim-survey", {}), "cyberzoo": records.get("cyberzoo", {}),
        "records": records, "flights": flights, "flight": named, "absent": dict(contents.absent),
        "public_names": public_names(),
    }  # fmt: skip


def public_names() -> list[tuple[str, str]]:
    """The names that the library declares, each with ``class`` or ``function``, as autodoc asks."""
    names = [name for name in trexton.__all__ if callable(getattr(trexton, name))]
    kinds = {True: "class", False: "function"}
    return [(name, kinds[isinstance(getattr(trexton, name), type)]) for name in names]


def _figures(contents: Contents) -> dict[str, list[str]]:
    """Names of the figures of each experiment's page."""
    names = {}
    for pair in contents.pairs:
        for name in contents.good(pair.name):
            path = contents.results / pair.name / f"{name}.ipynb"
            if path.is_file():
                notebook = nbformat.read(path, as_version=4)
                names[f"{pair.name}/{name}"] = name_figures(notebook, f"{pair.name}/{name}")
    return names


def _pictures(contents: Contents) -> dict[str, str]:
    """The first figure of each experiment on the first flight that has one, by its path."""
    first: dict[str, str] = {}
    for pair in contents.pairs:
        for name in contents.good(pair.name):
            figures = [
                path
                for path in outputs_of(contents.results / pair.name, name)
                if path.suffix == ".svg"
            ]
            if figures:
                first.setdefault(name, f"{pair.name}/{figures[0].name}")
    return first


def _title(name: str) -> str:
    return EXPERIMENTS[name].title if name in EXPERIMENTS else name


def _table_of_contents(contents: Contents, toc_file: str) -> dict[str, Any]:
    """``_toc.yml`` with ``- flight: NAME`` replaced by the pages of that flight.

    A chapter marked ``optional: true`` is left out where its page is not there.
    """
    toc = yaml.safe_load((contents.source / toc_file).read_text(encoding="utf-8"))
    here = {pair.name for pair in contents.pairs}
    for part in toc["parts"]:
        chapters = []
        for chapter in part["chapters"]:
            if "flight" in chapter:
                names = sorted(here) if chapter["flight"] == "*" else [chapter["flight"]]
                chapters += [
                    {"file": f"{name}/{page}", "title": _title(page)}
                    for name in names
                    if name in here
                    for page in contents.good(name)
                ]
            elif (contents.source / f"{chapter['file']}.md").is_file() or chapter[
                "file"
            ] in contents.good(""):
                chapters.append({"file": chapter["file"]})
            elif not chapter.get("optional"):
                raise DataError(
                    f"{contents.source / toc_file}: the page {chapter['file']!r} does not exist: "
                    "write it or drop it"
                )
        part["chapters"] = chapters
    toc["parts"] = [part for part in toc["parts"] if part["chapters"]]
    return toc
