"""The prose of the book: it says what the records say; the paper map is complete."""

from __future__ import annotations

import json
import re

import nbformat
import pandas as pd
import pytest
from conftest import ROOT

from trexton.base.errors import ParameterError, TrextonError
from trexton.base.records import Record
from trexton.companion.build.display import Outcome
from trexton.companion.build.notebook import Page
from trexton.companion.build.pages import figure_names, joined
from trexton.companion.build.prose import (
    context,
    findings,
    records_by_name,
    render,
)
from trexton.companion.claims.ledger import load_claims
from trexton.companion.claims.page import load_map, map_table
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.wording import flight_title

LANDING = {"inside": 13, "landings": 38, "attempts": 50, "never_triggered": 12,
           "perfect": {"inside": 41, "landings": 45}, "first_flights": {"inside": 2}}  # fmt: skip


def test_the_table_of_importers_has_whole_sentences():
    names = context(ROOT / "nothing-here", {}, lambda name, words: words)
    assert "or found by their motion |" in render(ROOT / "book" / "your_flight.md", names)


def test_the_first_page_says_what_its_pages_found(results):
    records = {"sim-survey": {"triggered_landing": {}}, "cyberzoo": {}}
    said = findings(results, records)
    assert said == [
        {
            "page": "triggered_landing",
            "flight": "Virtual hall (simulated)",
            "text": "By the paper's trigger 13 of 50 flights ended in the zone.",
        }
    ]
    records["cyberzoo"]["triggered_landing"] = {}
    assert "real" in findings(results, records)[0]["flight"]
    assert findings(results, {}) == []
    kept = Record.load(ROOT / "data" / "reference" / "fine.json").values["floors"]
    (fine,) = findings(results, {"sim-survey": {"fine": {}}})
    assert fine["text"].startswith(f"Over {len(kept)} floors") and fine["flight"] == ""


@pytest.mark.parametrize("head", ["as estimated | as sent |", "EKF2 of PX4 | EKF3 of ArduPilot |"])
def test_what_was_measured_on_board_is_of_the_kept_record(head, tmp_path):
    """Each table is shown, and no number in it is typed."""
    page = ROOT / "book" / "onboard.md"
    names = context(tmp_path, {}, lambda name, words: words)
    for text in (page.read_text(encoding="utf-8"), render(page, names)):
        (table,) = (each for each in text.split("\n\n") if head in each)
        cells = re.sub(r"{{.*?}}|{%.*?%}|EKF\d|PX4|90 % region", "", table)
        assert bool(re.search(r"\d", cells)) == ("{{" not in table), cells
    assert f"{names['kept']['onboard']['floors']} " in table and "–" not in table
    assert not [line for line in table.splitlines() if line.count("|") != 4]


def test_every_claim_stands_in_one_item_of_the_paper_map(tmp_path):
    items = load_map()
    assert sorted(c for item in items for c in item.claims) == sorted(
        c.id for c in load_claims(paper_file("claims.toml"))
    )
    for item in items:
        assert item.page in EXPERIMENTS or (ROOT / "book" / f"{item.page}.md").is_file(), item.name
    (tmp_path / "map.toml").write_text('[[item]]\nname = "a"\npage = "data"\nclaims = ["moon"]\n')
    with pytest.raises(ParameterError, match="moon.*expected every claim of claims.toml in one"):
        load_map(tmp_path / "map.toml")


@pytest.fixture
def results(tmp_path):
    for flight, inside in (("sim-survey", 0.66), ("cyberzoo", None)):
        rate = None if inside is None else {"value": inside, "low": 0.5, "high": 0.8}
        values = {"inside_rate": rate, "triggered_inside_rate": rate, "outlier_mean_cm": None}
        Record("triggered_landing", flight, {}, values | LANDING).save(tmp_path / flight)
    return tmp_path


def test_the_map_shows_theirs_beside_ours_with_links_to_pages_that_are_there(results):
    outcomes = [Outcome(f, "triggered_landing", "ran", (), 1.0) for f in ("sim-survey", "cyberzoo")]
    names = context(
        results,
        records_by_name(results, outcomes),
        lambda name, words: f"<{name}: {words}>" if name == "triggered_landing" else words,
    )
    table = names["paper_map"]()
    row = next(line for line in table.splitlines() if line.startswith("| Triggered landing |"))
    cells = [cell.strip() for cell in row.strip("|").split(" | ")]
    assert cells[1] == "<triggered_landing: Triggered landing>"
    named = "share of landings inside 0.67; mean distance beyond the circle of landings outside"
    assert re.sub("<[^>]*>", "", cells[2]) == f"{named} 16 cm"
    assert "| The method |" in table
    assert '<abbr title="Four of six triggered landings end inside the zone">' in cells[2]
    assert "not testable here" in cells[3] and "0.66" in cells[4] and "reproduced" in cells[4]
    assert table.splitlines()[0].count("|") == row.count("|")
    assert names["version"] and names["findings"][0]["page"] == "triggered_landing"
    assert "Table, homography baseline" in map_table({}, lambda page, text: text)


def test_prose_does_not_read_records_of_another_schema(results):
    outcomes = [Outcome("sim-survey", "triggered_landing", "reused", (), 0.0)]
    path = results / "sim-survey" / "triggered_landing.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 1}))
    with pytest.raises(TrextonError, match="record schema 1, expected 2: run it again"):
        records_by_name(results, outcomes)


def markdown(text):
    return nbformat.v4.new_markdown_cell(text)


def code(source, *shown, figure=False):
    """A code cell, and what it shows: words, HTML or a drawing."""
    kinds = {"<p": "text/html", "<t": "text/html", "<i": "text/html", "<s": "image/svg+xml"}
    outputs = [
        nbformat.v4.new_output("display_data", {kinds.get(each[:2], "text/markdown"): each})
        for each in shown
    ]
    cell = nbformat.v4.new_code_cell(source, outputs=outputs)
    if figure:
        cell.metadata["mystnb"] = {"figure": {"caption": "A floor."}}
    return cell


def room(number):
    """The notebook of one flight, its numbers its own."""
    table = Page.frame(pd.DataFrame({"x": [number]}), "Axes.", "axes").data
    return nbformat.v4.new_notebook(
        cells=[
            markdown(
                "# A finding\n\nSee [the plan](#floor), [all](trade_off.ipynb), [this](#axes)."
            ),
            code("page.finding()", f'<p class="finding">It errs by {number} cm.</p>'),
            code('page.show("floor", x)', f"<svg>{number}</svg>", figure=True),
            code("page.frame()", table),
            markdown("```python\n# a comment\n```\n\n## How"),
            code("page.say()", "Equal, as [the plan](#floor) has it."),
            code("page.play()", '<iframe src="overview-player.html">'),
            code("secret", "told"),
        ]
    )


def test_flights_share_a_page_and_what_differs_is_labelled():
    flights = {"cyberzoo": room(5), "sim-survey": room(7)}
    for notebook in flights.values():
        notebook.cells[-1].metadata["tags"] = ["remove-cell"]
    page = joined({"overview": flights}, lambda name, words: f"<{name}: {words}>", "# Page\n\nOn.")
    texts = [cell.source for cell in page.cells if cell.cell_type == "markdown"]
    assert texts[0] == "# Page\n\nOn." and texts[1] == (
        "(overview)=\n## A finding\n\nSee {numref}`overview-cyberzoo-floor`, <trade_off: all>, "
        '<a href="#overview-cyberzoo-axes">this</a>.'
    )
    assert "```python\n# a comment\n```\n\n### How" in texts  # the page has the first rank
    shown = [list(o.data.values())[0] for c in page.cells for o in c.get("outputs", ())]
    assert shown[:2] == [f'<p class="finding">It errs by {n} cm.</p>' for n in (5, 7)]
    assert shown[2] == "<svg>5</svg>" and 'id="overview-cyberzoo-axes"' in shown[3]
    assert shown[4] == "<svg>7</svg>" and 'id="overview-sim-survey-axes"' in shown[5]
    assert shown[6] == "Equal, as {numref}`overview-cyberzoo-floor` has it."
    assert shown[7:] == [f'<iframe src="{f}/overview-player.html">' for f in flights]
    assert sum(text.startswith('<div class="flights"') for text in texts) == 2
    assert "".join(texts).count("<div") == "".join(texts).count("</div>")
    names = [c.metadata["mystnb"]["figure"]["name"] for c in page.cells if "mystnb" in c.metadata]
    assert names == figure_names("overview", flights)
    assert len({cell.id for cell in page.cells}) == len(page.cells)
    assert page == joined(
        {"overview": flights}, lambda name, words: f"<{name}: {words}>", "# Page\n\nOn."
    )  # a name that is drawn would build the pages every time


def test_a_notebook_of_one_flight_says_which_and_stands_where_prose_has_its_place():
    one = {"timing": {"sim-survey": room(3)}, "claims": {"": room(1)}}
    page = joined(one, lambda name, words: words, "# T\n\nFirst.\n\n% notebook: claims\n\nLast.")
    texts = [cell.source.strip() for cell in page.cells if cell.cell_type == "markdown"]
    assert texts[0] == "# T\n\nFirst." and texts[1].startswith("(claims)=\n## A finding")
    at = texts.index("Last.")
    assert texts[at + 1].startswith("(timing)=\n## A finding")
    assert texts[at + 2] == f'<p class="flight-name">{flight_title("sim-survey")}</p>'
    assert not any("flight-name" in text for text in texts[:at])
    assert flight_title("my-flight") == "my-flight"
    one["timing"]["sim-survey"].metadata["data"] = "Walks (real)"  # in the flight's place
    page = joined(one, lambda name, words: words)
    assert '<p class="flight-name">Walks (real)</p>' in [cell.source for cell in page.cells]


def test_figures_have_names_where_they_were_drawn():
    drawn, empty = code('page.show("a_b", x)', "<svg/>", figure=True), code('page.show("c", x)')
    notebook = nbformat.v4.new_notebook(cells=[drawn, empty])
    assert figure_names("map_loss", {"room": notebook}) == ["map-loss-room-a-b"]


@pytest.mark.parametrize("path", sorted((ROOT / "notebooks").glob("*.md")), ids=lambda p: p.stem)
def test_every_figure_and_table_that_is_referred_to_is_shown(path):
    text = path.read_text()
    referred = set(re.findall(r"\]\(#(\w+)\)", text))
    shown = set(re.findall(r"""page\.show\(\s*["'](\w+)""", text))
    tables = re.findall(r'page\.(?:frame|quantities|table)\(.*?"(\w+)",?\s*\)', text, re.S)
    assert referred <= shown | set(tables)
