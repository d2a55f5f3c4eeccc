"""Prose pages are templates: ``{{ sim.mocap_training.knn.mean_cm.value | fixed }}`` is a number.

None is typed. A name that no record has stops the build with the page and the line; what may be
absent stands in ``{% if %}``.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jinja2

from trexton.base.errors import DataError
from trexton.base.records import Record
from trexton.companion.build.display import Outcome
from trexton.companion.experiments.printed import published
from trexton.companion.wording import Tree, template_environment
from trexton.flights.importers import describe
from trexton.localization.landing import TouchdownZone

__all__ = ["records_by_name", "render"]


def records_by_name(results: Path, outcomes: Iterable[Outcome]) -> dict[str, Tree]:
    """``{flight: {experiment: values}}`` of the outcomes that left a record, ``timings`` too."""
    values_by_flight: dict[str, dict[str, Any]] = {}
    for outcome in outcomes:
        path = results / outcome.flight / f"{outcome.experiment}.json"
        if outcome.good and outcome.flight and path.is_file():
            record = Record.load(path)
            values = record.values | {"parameters": record.parameters, "timings": record.timings}
            values_by_flight.setdefault(outcome.flight, {})[outcome.experiment] = values
    return {flight: Tree(experiments) for flight, experiments in values_by_flight.items()}


def render(path: Path, context: dict[str, Any], pages: set[str], pictures: dict[str, str]) -> str:
    """The page `path` with its numbers filled in.

    Parameters
    ----------
    context : dict
        Names that the page may use; ``paper`` (the published values) and ``touchdown`` (a zone with
        its defaults) are added.
    pages : set of str
        Pages that are in the book: ``{{ see("page", "text") }}`` links to one, or is plain text.
    pictures : dict of str to str
        The first figure of each experiment, for ``{{ picture("overview") }}``.

    Raises
    ------
    DataError
        The page names something that is not there, or its template is broken.
    """

    def see(page: str, text: str) -> str:
        return f"{{doc}}`{text} </{page}>`" if page in pages else text

    environment = template_environment()
    try:
        template = environment.from_string(path.read_text(encoding="utf-8"))
        return template.render(
            context
            | {
                "paper": Tree(published()),
                "see": see,
                "picture": pictures.get,
                "importers": describe,
                "touchdown": TouchdownZone((0.0, 0.0)),  # what it asks for by default
            }
        )
    except jinja2.TemplateSyntaxError as error:
        raise DataError(
            f"{path}, line {error.lineno}: {error.message}: correct the template"
        ) from None
    except (jinja2.UndefinedError, KeyError, TypeError, ValueError) as error:
        line = _line(error)
        raise DataError(
            f"{path}, line {line}: {error}: name a value that the records have, or guard it with "
            "{% if %}"
        ) from None


def _line(error: BaseException) -> int | str:
    """The line of the template in which `error` arose."""
    trace = error.__traceback__
    line: int | str = "?"
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == "<template>":
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
