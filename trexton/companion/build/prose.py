"""Prose pages are templates: ``{{ sim.mocap_training.knn.mean_cm.value | fixed }}`` is a number.

None is typed. A name that no record has stops the build with the page and the line; what may be
absent stands in ``{% if %}``. The README's table of results is that of the first page:
``python -m trexton.companion.build.prose`` renews it from ``results``.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from importlib.metadata import version
from math import log10
from pathlib import Path
from traceback import extract_tb
from typing import Any

import jinja2

import trexton
from trexton.base.cache import repository_root, shipped
from trexton.base.errors import DataError
from trexton.base.files import read_toml, write_file
from trexton.base.records import Record
from trexton.companion.build.display import Outcome
from trexton.companion.build.notebooks import read_content
from trexton.companion.claims.ledger import load_records
from trexton.companion.claims.page import map_table
from trexton.companion.claims.rules import VERDICTS
from trexton.companion.experiments.fine import over_floors
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.registry import EXPERIMENTS, MODULES
from trexton.companion.provenance import kept_results, stale_note
from trexton.companion.wording import flight_title, template_environment
from trexton.flights.importers import IMPORTERS, importer
from trexton.localization.landing import TouchdownZone
from trexton.localization.training_set import EXCLUDED_SECONDS
from trexton.onboard.edges import classes_of_options, edge_classes
from trexton.onboard.sinks import SINKS
from trexton.onboard.sources import SOURCES

See = Callable[[str, str], str]
Values = Mapping[str, Mapping[str, Any]]  # of the records by flight and experiment
FLIGHTS = ("cyberzoo", "sim-survey")  # of the book, the real one first
_TABLE = re.compile(r"(?<=prose -->\n).*?(?=<!-- end of results -->)", re.DOTALL)
_FINDINGS = ("mocap_training", "triggered_landing", "beyond", "fine", "uncertainty")


def records_by_name(results: Path, outcomes: Iterable[Outcome]) -> dict[str, dict[str, Any]]:
    """``{flight: {experiment: values}}`` of the outcomes that left a record, ``timings`` too."""
    values_by_flight: dict[str, dict[str, Any]] = {}
    for outcome in outcomes:
        path = results / outcome.flight / f"{outcome.experiment}.json"
        if outcome.good and outcome.flight and path.is_file():
            record = Record.load(path)
            values = record.values | {"parameters": record.parameters, "timings": record.timings}
            values_by_flight.setdefault(outcome.flight, {})[outcome.experiment] = values
    return values_by_flight


def context(results: Path, values: Values, see: See) -> dict[str, Any]:
    """The names that every page may use.

    Parameters
    ----------
    results : Path
        Folder of records.
    values : mapping
        Values by flight and experiment of the pages that the book has.
    see : callable
        ``{{ see("page", "text") }}`` links to a page or an experiment, or is plain text.
    """

    def paper_map() -> str:
        records = {
            flight: {name: each for name, each in own.items() if name in values[flight]}
            for flight, own in load_records(results).items()
            if flight in values
        }
        return map_table(records, see)

    return {
        "sim": values.get("sim-survey", {}),
        "cyberzoo": values.get("cyberzoo", {}),
        "see": see,
        "findings": findings(results, values),
        "door": partial(door, values),
        "kept": kept_records(),
        "flight_title": flight_title,
        "ledger": read_content(results / "claims.json"),
        "verdicts": VERDICTS,
        "paper": published(),
        "quoted": quoted(),
        "paper_map": paper_map,
        "version": version("trexton"),
        "excluded_s": EXCLUDED_SECONDS,
        "edges": {
            "--output": edge_classes("sinks", SINKS),
            "--camera": edge_classes("sources", SOURCES),
        },
        "options_of": classes_of_options,
        "importers": lambda: {kind: importer(kind) for kind in IMPORTERS},
        "touchdown": TouchdownZone((0.0, 0.0)),  # what it asks for by default
        "public_names": public_names(),
    }


def findings(results: Path, values: Values) -> list[dict[str, str]]:
    """The first sentences of some pages: of the kept long run, or of the real flight if it can."""
    kept, said = {path.stem: path for path in kept_results()}, []
    for name in _FINDINGS:
        flight = next((each for each in FLIGHTS if name in values.get(each, {})), None)
        if flight and (say := EXPERIMENTS[name].finding):
            record = Record.load(kept.get(name, results / flight / f"{name}.json"))
            sentence = re.split(r"(?<=[.]) (?=[A-Z0-9])", say(record))[0]
            where = "" if name in kept else flight_title(flight)
            said.append({"page": name, "flight": where, "text": sentence})
    return said


def door(values: Values) -> str:
    """The table of results that the first page shows, and the README."""
    names = {"kept": kept_records(), "cyberzoo": values.get("cyberzoo", {})}
    return render(shipped("book") / "door.md", names)


def renewed_readme(text: str, results: Path) -> str:
    """The README's text with the table of these results; raises `DataError` where its marks are
    not there, once each.
    """
    records = load_records(results).get("cyberzoo", {})
    cyberzoo = {name: record.values for name, record in records.items()}
    if len(_TABLE.findall(text)) != 1:
        raise DataError("README.md: the marks around its results are gone: put them back")
    return _TABLE.sub(lambda _: door({"cyberzoo": cyberzoo}), text)


def kept_records() -> dict[str, Any]:
    """``{experiment: values}`` of the long runs kept with the code, ``timings`` too; ``stale`` is
    what to say of one that other code made.
    """
    kept = [path for path in kept_results() if not path.stem.startswith("sweep-")]
    records = {path.stem: Record.load(path) for path in kept}
    values = {name: each.values | {"timings": each.timings} for name, each in records.items()}
    for name, each in records.items():
        modules = each.provenance.get("modules") or [MODULES[each.experiment]]
        values[name]["stale"] = stale_note(name, each.provenance, *modules)
    if "fine" in records:
        values["fine"]["over_floors_cm"] = over_floors(records["fine"], "free", "mean_cm")
    return values


def quoted() -> dict[str, Any]:
    """Tables of ``data/quoted`` by name: numbers of other works, and of studies that no command
    repeats, each with its source.
    """
    files = shipped("data/quoted").glob("*.toml")
    return {path.stem: read_toml(path) for path in files}


def public_names() -> list[tuple[str, str]]:
    """The names that the library declares, each with ``class`` or ``function``, as autodoc asks."""
    names = [name for name in trexton.__all__ if callable(getattr(trexton, name))]
    kinds = {True: "class", False: "function"}
    return [(name, kinds[isinstance(getattr(trexton, name), type)]) for name in names]


def render(path: Path, names: Mapping[str, Any]) -> str:
    """The page `path` with its numbers filled in, from the `names` that it may use.

    Raises `DataError` where it names something that is not there, or its template is broken.
    """
    environment = template_environment()
    environment.loader = jinja2.FileSystemLoader(shipped("book"))  # figures, which pages include
    environment.filters["log10"] = log10
    try:
        return environment.from_string(path.read_text(encoding="utf-8")).render(names)
    except (jinja2.TemplateError, KeyError, TypeError, ValueError) as error:
        frames = extract_tb(error.__traceback__)
        lines = [each.lineno for each in frames if each.filename == "<template>"]
        line = getattr(error, "lineno", None) or (lines[-1] if lines else "?")
        raise DataError(
            f"{path}, line {line}: {error}: name a value that the records have, guard it with "
            "{% if %}, or correct the template"
        ) from None


if __name__ == "__main__":
    clone = repository_root() or Path(".")
    readme = renewed_readme((clone / "README.md").read_text(encoding="utf-8"), clone / "results")
    write_file(clone / "README.md", readme)
