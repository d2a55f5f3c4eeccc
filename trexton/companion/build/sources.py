"""Everything that becomes a page is gathered here: prose with its numbers, notebooks, downloads.
Sphinx reads the folder that is made."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import nbformat
import yaml

from trexton.base.errors import DataError
from trexton.companion.build.display import Outcome
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.notebooks import outputs_of
from trexton.companion.build.pages import figure_names, joined, label_of
from trexton.companion.build.prose import FLIGHTS, context, records_by_name, render
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.wording import template_environment


@dataclass(frozen=True)
class Contents:
    """What a book is made of."""

    source: Path  # folder of prose, ``_config.yml``, tables of contents and ``_static``
    results: Path
    pairs: Sequence[FlightPair]
    outcomes: Sequence[Outcome]
    absent: Mapping[str, str] = field(default_factory=dict)  # flights, and why
    toc_file: str = "_toc.yml"  # the table of contents, see `toc`

    def good(self, flight: str) -> list[str]:
        """Experiments that have results on `flight` ("" for those over every flight)."""
        ready = {o.experiment for o in self.outcomes if o.flight == flight and o.good}
        return [name for name in EXPERIMENTS if name in ready] + sorted(ready - EXPERIMENTS.keys())

    @cached_property
    def executed(self) -> dict[str, dict[str, nbformat.NotebookNode]]:
        """Executed notebooks by experiment and flight, the book's real flight first."""
        names = [pair.name for pair in self.pairs]
        notebooks: dict[str, dict[str, nbformat.NotebookNode]] = {}
        for flight in ["", *sorted(names, key=lambda name: name not in FLIGHTS[:1])]:
            for name in self.good(flight):
                path = self.results / flight / f"{name}.ipynb"
                if path.is_file():
                    own = nbformat.read(path, as_version=4)
                    notebooks.setdefault(name, {})[flight] = own
        return notebooks

    @cached_property
    def _declared(self) -> dict[str, Any]:
        """The table of contents as it is written."""
        file = self.source / self.toc_file
        return yaml.safe_load(file.read_text(encoding="utf-8"))

    @property
    def named(self) -> list[str]:
        """The experiments that the table of contents names and that there are."""
        chapters = [chapter for part in self._declared["parts"] for chapter in part["chapters"]]
        names = [name for chapter in chapters for name in chapter.get("notebooks", ())]
        return [name for name in names if name in set(EXPERIMENTS)]

    @cached_property
    def toc(self) -> dict[str, Any]:
        """The table of contents. Each chapter has a ``file``, its prose, or ``notebooks``, or both.

        A page of notebooks none of which ran is left out. ``notebooks: "*"`` stands for a page for
        each experiment that stands on no other.

        Raises
        ------
        DataError
            A page of prose does not exist.
        """
        named, parts = self.named, []
        others = [
            {"file": each, "notebooks": [each]} for each in self.executed if each not in named
        ]
        for part in self._declared["parts"]:
            kept = []
            for chapter in part["chapters"]:
                for one in others if chapter.get("notebooks") == "*" else [chapter]:
                    ran = [name for name in one.get("notebooks", ()) if name in self.executed]
                    if ran or (self.source / f"{one['file']}.md").is_file():
                        kept.append({**one, "notebooks": ran})
                    elif "notebooks" not in one:
                        raise DataError(
                            f"{self.source / self.toc_file}: the page {one['file']!r} does not "
                            "exist: write it or drop it"
                        )
            if kept:
                parts.append({**part, "chapters": kept})
        return {**self._declared, "parts": parts}

    @cached_property
    def pages(self) -> dict[str, list[str]]:
        """The experiments of each page."""
        chapters = [chapter for part in self.toc["parts"] for chapter in part["chapters"]]
        return {self.toc["root"]: []} | {each["file"]: each["notebooks"] for each in chapters}

    def see(self, name: str, text: str) -> str:
        """A link to a page or to an experiment on one; plain text where the book has it not."""
        linked = text.replace("`", "")  # a role ends at the next one
        if name in self.pages:
            return f"{{doc}}`{linked} </{name}>`"
        shown = any(name in experiments for experiments in self.pages.values())
        return f"{{ref}}`{linked} <{name}>`" if shown else text


def stage(contents: Contents, folder: Path) -> None:
    """Fill `folder` with the sources of the book, ready for Jupyter Book.

    Raises `DataError` where a page does not exist, or asks for a value that no record has.
    """
    names = _names(contents)
    for page, experiments in contents.pages.items():
        source = contents.source / f"{page}.md"
        text = render(source, names) if source.is_file() else ""
        if experiments:
            own = {name: contents.executed[name] for name in experiments}
            nbformat.write(joined(own, contents.see, text), folder / f"{page}.ipynb")
        else:
            (folder / f"{page}.md").write_text(text, encoding="utf-8")
    put_outputs(contents, folder, notebooks=False)
    for file in ("_config.yml", "references.bib"):
        shutil.copyfile(contents.source / file, folder / file)
    shutil.copytree(contents.source / "_static", folder / "_static")
    for beside in (Path(__file__).with_name("charts.js"), paper_file("protocol.toml")):
        shutil.copy(beside, folder / "_static")
    parts = [
        {**part, "chapters": [{"file": each["file"]} for each in part["chapters"]]}
        for part in contents.toc["parts"]
    ]
    toc = {"format": "jb-book", "root": contents.toc["root"], "parts": parts}
    (folder / "_toc.yml").write_text(yaml.safe_dump(toc, sort_keys=False), encoding="utf-8")


def put_outputs(contents: Contents, folder: Path, notebooks: bool = True) -> None:
    """What the run left, as downloads beside the pages that offer them."""
    for flight in ["", *(pair.name for pair in contents.pairs)]:
        (folder / flight).mkdir(exist_ok=True)
        for name in contents.good(flight):
            for path in outputs_of(contents.results / flight, name):
                if notebooks or path.suffix != ".ipynb":
                    shutil.copyfile(path, folder / flight / path.name)


def _names(contents: Contents) -> dict[str, Any]:
    """The names that prose may use."""
    records = records_by_name(contents.results, contents.outcomes)
    flights = []
    for pair in contents.pairs:
        good, folder = contents.good(pair.name), contents.results / pair.name
        missing = [o for o in contents.outcomes if o.flight == pair.name and not o.good]
        known = {
            "name": pair.name,
            "train": pair.train,
            "test": pair.test,
            "experiments": [(name, _title(name)) for name in good],
            "players": [name for name in good if (folder / f"{name}-player.html").is_file()],
            "skipped": [(_title(o.experiment), o.reasons[0]) for o in missing],
        }
        flights.append(known)

    def first_figure(experiment: str) -> str:
        """A reference to the first figure of an experiment, in brackets, if it has one."""
        figures = figure_names(experiment, contents.executed.get(experiment, {}))
        return f" ({{numref}}`{figures[0]}`)" if figures else ""

    return context(contents.results, records, contents.see) | {
        "flights": flights,
        "flight": {flight["name"]: flight for flight in flights},
        "absent": dict(contents.absent),
        "first_figure": first_figure,
    }


def _title(name: str) -> str:
    return EXPERIMENTS[name].title if name in EXPERIMENTS else name


def lead_from_old_addresses(contents: Contents, html: Path) -> None:
    """Small pages where others once stood: one a flight and experiment, and those of ``moved``."""
    moved = {
        f"*/{name}": f"{page}.html#{label_of(name)}"
        for page, experiments in contents.pages.items()
        for name in experiments
    }
    for old, page in contents.toc.get("moved", {}).items():
        moved.setdefault(old, f"{page}.html")
    page = Path(__file__).with_name("moved.html").read_text(encoding="utf-8")
    template = template_environment().from_string(page)
    for old, new in moved.items():
        for flight in FLIGHTS if old.startswith("*") else [""]:
            path = html / f"{old.replace('*', flight)}.html"
            if new.partition("#")[0].removesuffix(".html") in contents.pages and not path.exists():
                path.parent.mkdir(exist_ok=True)
                path.write_text(template.render(target="../" * old.count("/") + new), "utf-8")
