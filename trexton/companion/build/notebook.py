"""What every notebook shows around its one library call: record, figures, tables, verdicts.

Offers `Page`, and the names that notebooks ask this module for.
"""

import importlib
import json
import shlex
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd
from IPython.display import HTML, SVG, Markdown, display
from matplotlib.figure import Figure

from trexton.base.files import write_file
from trexton.base.records import Record
from trexton.companion.build.charts import with_phone
from trexton.companion.build.flight_pairs import Given, given
from trexton.companion.claims.ledger import judge_all, load_claims, write_ledger
from trexton.companion.claims.page import claims_html, counts_html, filters_html
from trexton.companion.experiments.figure_files import for_phones, to_png, to_svg
from trexton.companion.experiments.printed import look_up, published
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.player.playback import PlayedFlight, player_html
from trexton.companion.provenance import kept_results, stale_note
from trexton.companion.wording import (
    METRES_FROM,
    as_html,
    distance,
    flight_title,
    interval,
    middle,
    number,
    template_environment,
)

__all__ = ["Given", "Page", "given", "ledger", "reference", "swept"]


class Page:
    """A record and the folder its notebook writes to.

    Parameters
    ----------
    record : Record
    given : Given
        What the notebook was given; the record goes to ``<out>/<flight>/``, relative to the working
        folder.
    """

    def __init__(self, record: Record, given: Given):
        self.record, self.given = record, given
        self.folder = Path(given.out) / record.flight
        record.save(self.folder)

    def show(self, name: str, figure: Figure) -> SVG:
        """Write ``<experiment>-<name>.svg`` and ``-<name>-print.png`` beside the record.

        Displays the SVG; one that is wide carries its layout for phones along.
        """
        svg = to_svg(figure)
        for suffix, content in ((".svg", svg), ("-print.png", to_png(figure))):
            file = self.folder / f"{self.record.experiment}-{name}{suffix}"
            write_file(file, content)
        return SVG(with_phone(svg.decode(), for_phones(figure)))

    def play(self, recording: PlayedFlight) -> HTML:
        """Write ``<experiment>-player.html`` beside the record, and show it in the page."""
        name = f"{self.record.experiment}-player.html"
        write_file(self.folder / name, player_html(recording, flight_title(self.record.flight)))
        return HTML(
            f'<iframe class="player" src="{name}" title="Flight player" loading="lazy"></iframe>'
        )

    def finding(self, sentence: str | None = None) -> HTML:
        """The finding of the experiment on this flight, in one sentence made from the record.

        Or `sentence`, where the record of a longer run says it.
        """
        if sentence is None:
            module = importlib.import_module(type(self.given.parameters).__module__)
            sentence = module.finding(self.record)
        return HTML(f'<p class="finding">{as_html(sentence)}</p>')

    def say(self, text: str, **more: object) -> Markdown:
        """A paragraph with its numbers and its verdicts from the record.

        Parameters
        ----------
        text : str
            A template as in the book's prose: values of the record by name, ``timings``,
            ``parameters``, as in ``{{ filter.mean_cm | span }} cm``.
        **more
            Further names for the template.
        """
        names = {"timings": self.record.timings, "parameters": self.record.parameters}
        template = template_environment().from_string(text.strip())
        return Markdown(template.render(self.record.values | names | more))

    def claims(self) -> HTML:
        """What is claimed of this experiment, and the verdicts of this flight."""
        own = self.record.experiment
        records = {own: self.record}
        for name in EXPERIMENTS[own].after:
            if (path := self.folder / f"{name}.json").exists():
                records[name] = Record.load(path)
        # Of this experiment alone: those of others would have all their modules loaded.
        mine = [claim for claim in load_claims(experiments=[own]) if claim.experiment == own]
        rows = judge_all({self.record.flight: records}, mine)
        return HTML(claims_html(rows, "What is claimed, and our test of it."))

    @staticmethod
    def frame(table: pd.DataFrame, caption: str, name: str = "") -> HTML:
        """A plain HTML table without an index, with its caption; text refers to it by its name:
        ``[the table](#name)``.
        """
        html = table.to_html(
            index=False, border=0, escape=False, classes="table", table_id=name or None
        )
        caption = f"<caption>{escape(caption)}</caption>\n  <thead>"
        return HTML(html.replace("<thead>", caption, 1))

    def table(self, rows: dict[str, str], caption: str, name: str = "") -> HTML:
        """Errors per axis beside the paper's: in cm, or all in metres where they are that large.

        Parameters
        ----------
        rows : dict of str to str
            Label of each row, and the place of its summary in the record's values.
        caption, name : str
            See `frame`.
        """
        keys = {"error_cm": "Error", "std_cm": "STD"}
        columns = {f"{keys[key]} in {axis}": (key, axis) for key in keys for axis in "xy"}
        printed = published().get(self.record.experiment, {})
        found: dict[str, Any] = {
            label: look_up(self.record.values, path) or {} for label, path in rows.items()
        }
        medians = [middle(each["median_cm"]) for each in found.values() if "median_cm" in each]
        metres = not printed and min(medians, default=0) >= METRES_FROM
        unit, scale = ("m", 0.01) if metres else ("cm", 1.0)
        table = []
        if "error_cm" in printed:
            cells = {name: f"{printed[key][axis]}" for name, (key, axis) in columns.items()}
            table.append({unit: "Paper", **cells})
        places = {name: "_".join(each) for name, each in columns.items()}
        places["Euclidean median"] = "median_cm"
        for label, summary in found.items():
            cells = {name: _interval(summary.get(key), scale) for name, key in places.items()}
            table.append({unit: label, **cells})
        return self.frame(pd.DataFrame(table).fillna(""), caption, name)

    def quantities(self, rows: dict[str, str], caption: str, name: str = "") -> HTML:
        """Numbers of the record: label, and place in its values; the absent are left out. Those in
        cm are in metres where all are that large.
        """
        found = {label: look_up(self.record.values, path) for label, path in rows.items()}
        values: dict[str, Any] = {key: each for key, each in found.items() if each is not None}
        lengths = [middle(each) for key, each in values.items() if key.endswith(" (cm)")]
        metres, table = min(lengths, default=0) >= METRES_FROM, []
        for label, value in values.items():
            if metres and label.endswith(" (cm)"):
                label, cell = label.removesuffix(" (cm)"), distance(value, True)
            elif isinstance(value, Mapping):
                cell = interval(value)
            else:
                cell = number(value) if abs(value) >= 100 else f"{value:.3g}"
            table.append({"": label, " ": cell})
        return self.frame(pd.DataFrame(table), caption, name)

    def footer(self) -> HTML:
        """The command that runs this experiment again, its parameters, and what it leaves."""
        name = f"{self.record.flight}/{self.record.experiment}"
        kept = {"record": f"{name}.json", "notebook": f"{name}.ipynb"}
        for path in sorted(self.folder.glob(f"{self.record.experiment}-*")):
            if path.suffix in (".svg", ".png"):
                words = path.name.removeprefix(f"{self.record.experiment}-")
                kept[words] = f"{self.record.flight}/{path.name}"
        files = [f'<a href="{file}" download="">{words}</a>' for words, file in kept.items()]
        chosen = self.record.parameters.items()
        settings = ", ".join(f"{key} = {value}" for key, value in chosen if value is not None)
        return HTML(
            f"<details class='again'><summary>Run it again: command, parameters, files</summary>"
            f'<pre class="command">{self.command()}</pre><p>Parameters: {settings}.</p>'
            f'<p class="downloads">Take home: {" · ".join(files)}</p>'
            "</details>"
        )

    def command(self) -> str:
        """The command that makes this record, with the parameters that are not the defaults."""
        defaults = {each.name: each.default for each in type(self.given.parameters).declared()}
        chosen = self.given.parameters.as_dict()
        changed = [f"{name}={value}" for name, value in chosen.items() if value != defaults[name]]
        words = ["trexton", "run", self.given.flight]
        if self.given.test_flight is not None:
            words += ["--test-flight", self.given.test_flight]
        words += ["--only", self.record.experiment]
        words += ["--set", *changed] if changed else []
        return escape(shlex.join([*words, "--out", "my-results"]))


def _interval(entry: dict[str, Any] | float | None, scale: float = 1.0) -> str:
    """A value and its interval; a decimal where the value is below ten."""
    if entry is None:
        return ""
    value = scale * middle(entry)
    digits = 1 if abs(value) < 9.95 else 0
    if not isinstance(entry, dict):
        return f"{value:.{digits}f}"
    low, high = scale * entry["low"], scale * entry["high"]
    ends = f"[{low:.{digits}f}, {high:.{digits}f}]"
    return f"{value:.{digits}f} <small>{ends}</small>"


def ledger(out: str) -> tuple[HTML, HTML]:
    """Judge all records below `out`, write ``claims.json``; counts of verdicts, and the ledger."""
    rows = write_ledger(Path(out))
    table = claims_html(rows, "Every claim, and our test of it.")
    return HTML(counts_html(rows, "Verdicts by flight.")), HTML(filters_html(rows) + table)


def reference(experiment: str) -> Record | None:
    """The record of a run too long for every book, kept with the code; None where there is none."""
    path = _kept(experiment)
    if path is None:
        return None
    record = Record.load(path)
    _say_if_stale(experiment, record.experiment, record.provenance)
    return record


def swept(plan: str) -> dict[str, Any] | None:
    """The table of a plan in ``data/sweeps``, kept with the code; None where there is none."""
    path = _kept(f"sweep-{plan}")
    if path is None:
        return None
    table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    _say_if_stale(path.stem, table["experiment"], table)
    return table


def _say_if_stale(name: str, experiment: str, made: Mapping[str, Any]) -> None:
    """On the page, where a kept result was made by other code than stands here."""
    if note := stale_note(name, made, EXPERIMENTS[experiment].module):
        display(HTML(note))


def _kept(name: str) -> Path | None:
    return next((path for path in kept_results() if path.stem == name), None)
