"""Prose pages are templates: a number is written ``{{ sim.mocap_training.knn.error_cm_x.median | fixed }}``.

None is typed. A name that no record has stops the build with the page and the line; what may be absent
stands in ``{% if %}``.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import jinja2

from trexton.errors import DataError
from trexton.paper import published

__all__ = ["records_by_name", "render"]


class Tree(dict):
    """Nested values of a record; a name is always an entry, even where dict has a method of that name."""

    def __init__(self, values: dict):
        super().__init__(
            {
                key: Tree(value) if isinstance(value, dict) else value
                for key, value in values.items()
            }
        )

    def __getattribute__(self, name: str):
        if not name.startswith("_") and name in self:
            return self[name]
        return super().__getattribute__(name)


def records_by_name(results: Path, outcomes) -> dict[str, Tree]:
    """``{flight: {experiment: values}}`` of the outcomes that left a record; timings under ``timings``."""
    found: dict[str, dict] = {}
    for outcome in outcomes:
        path = results / outcome.flight / f"{outcome.experiment}.json"
        if outcome.status in ("ran", "reused") and outcome.flight and path.is_file():
            record = json.loads(path.read_text(encoding="utf-8"))
            values = {
                **record["values"],
                "parameters": record["parameters"],
                "timings": record["timings"],
            }
            found.setdefault(outcome.flight, {})[outcome.experiment] = values
    return {flight: Tree(experiments) for flight, experiments in found.items()}


def fixed(value: float, digits: int = 0) -> str:
    """A number with so many decimals and thousands apart."""
    return f"{value:,.{digits}f}"


def span(entry: dict, digits: int = 0) -> str:
    """The median (or value) of an entry with its interval in brackets."""
    middle = entry["median"] if "median" in entry else entry["value"]
    return (
        f"{fixed(middle, digits)} [{fixed(entry['low'], digits)}, {fixed(entry['high'], digits)}]"
    )


def text(words: str) -> str:
    """Words from a flight's header, with everything that Markdown would take for markup made harmless."""
    return re.sub(r"([^\w\s.,;:'()/-])", r"\\\1", " ".join(str(words).split()))


def render(path: Path, context: dict, pages: set[str], pictures: dict[str, str]) -> str:
    """The page `path` with its numbers filled in.

    Parameters
    ----------
    context : dict
        Names that the page may use; ``paper`` (the published values) is added.
    pages : set of str
        Pages that are in the book: ``{{ see("page", "text") }}`` links to one of them, or is plain text.
    pictures : dict of str to str
        The first figure of each experiment, for ``{{ picture("overview") }}``.

    Raises
    ------
    DataError
        The page names something that is not there, or its template is broken.
    """

    def see(page: str, text: str) -> str:
        return f"{{doc}}`{text} </{page}>`" if page in pages else text

    # "{#" would swallow attributes of MyST, so comments get marks of their own.
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True,
        comment_start_string="{##", comment_end_string="##}", autoescape=False,
    )  # fmt: skip
    environment.filters |= {"fixed": fixed, "span": span, "text": text}
    try:
        template = environment.from_string(path.read_text(encoding="utf-8"))
        return template.render(
            context | {"paper": Tree(published()), "see": see, "picture": pictures.get}
        )
    except jinja2.TemplateSyntaxError as error:
        raise DataError(
            f"{path}, line {error.lineno}: {error.message}: correct the template"
        ) from None
    except (jinja2.UndefinedError, KeyError, TypeError, ValueError) as error:
        line = _line(error)
        raise DataError(
            f"{path}, line {line}: {error}: name a value that the records have, or guard it with {{% if %}}"
        ) from None


def _line(error: BaseException) -> int | str:
    """The line of the template in which `error` arose."""
    trace, line = error.__traceback__, "?"
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == "<template>":
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
