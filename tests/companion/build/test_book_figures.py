"""The figures of prose: every page has one near its top, its words are text and stay inside of it,
and what it quotes stands where it says.
"""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml
from bs4 import BeautifulSoup
from conftest import ROOT
from pybtex.database import parse_file

from trexton.companion.build.prose import context, render
from trexton.companion.claims.ledger import load_claims
from trexton.companion.claims.rules import VERDICTS

BOOK = ROOT / "book"
WIDTH = 6.4  # of a character at 12.5 pixels, in the widest of the fonts
DRAWN = sorted(
    p.stem for p in (BOOK / "figures").glob("*.jinja") if p.stem not in ("draw", "tables")
)


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What a page may use, in a book of two flights with a ledger of invented verdicts."""
    flights = ("cyberzoo", "sim-survey")
    ours = {"value": 70.0, "low": 60.0, "high": 90.0}
    claims = [
        {"kind": c.kind, "unit": c.unit, "text": c.text, "printed": c.printed_value}
        | {"findings": [{"flight": flight, "ours": ours} for flight in flights]}
        for c in load_claims()
    ]
    counts = {flight: {v: 3 * n for n, v in enumerate(VERDICTS)} for flight in flights}
    return context(tmp_path_factory.mktemp("results"), {}, lambda name, words: words) | {
        "flights": [{"name": each, "experiments": ["a", "b"], "players": []} for each in flights],
        "flight": {},
        "ledger": {"claims": claims, "counts": counts},
    }


def figure(name, names, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f'{{% include "figures/{name}.jinja" %}}\n')
    return render(page, names).strip()


@pytest.mark.parametrize("name", DRAWN)
def test_its_words_are_text_inside_of_the_drawing_on_wide_pages_and_on_phones(
    name, names, tmp_path
):
    text = figure(name, names, tmp_path)
    assert text.startswith("<figure") and "\n" not in text  # or Markdown would end it
    wide, phone = BeautifulSoup(text, "html.parser").find_all("svg")
    for drawing, most in ((wide, 720), (phone, 340)):
        assert drawing["aria-label"] and drawing["width"] == str(most)
        assert drawing["role"] == ("group" if drawing.find("a") else "img")
        words = drawing.find_all("text")
        assert len(words) > 5
        for each in words:
            if each.find_parent("g", transform=re.compile("translate")) is None:
                x, length = float(each["x"]), WIDTH * len(each.get_text())
                left = (
                    x
                    - length
                    * {"start": 0, "middle": 0.5, "end": 1}[each.get("text-anchor", "start")]
                )
                assert -6 <= left and left + length <= most + 6, each.get_text()
                assert 0 < float(each["y"]) < float(drawing["height"]), each.get_text()


def test_a_book_without_a_ledger_has_none_of_its_figures(names, tmp_path):
    for name in ("claims", "paper_map"):
        assert figure(name, names | {"ledger": None}, tmp_path) == ""
        assert "Virtual hall" in figure(name, names, tmp_path)
    drawn = figure("claims", names, tmp_path)
    assert re.findall("|".join(sorted(VERDICTS, key=len)[::-1]), drawn)[: len(VERDICTS)] == [
        *VERDICTS
    ]


def test_every_page_of_prose_alone_begins_with_a_figure():
    parts = yaml.safe_load((BOOK / "_toc.yml").read_text())["parts"]
    alone = [one["file"] for part in parts for one in part["chapters"] if "notebooks" not in one]
    for name in [*alone, "claims", "hall"]:
        beginning = (BOOK / f"{name}.md").read_text().partition("\n## ")[0]
        before = re.split(r"{% include \"figures|```{image}", beginning)
        assert len(before) > 1, f"{name}: no figure before its second heading"
        assert len(before[0].split()) < 100, name


def test_public_names_all_stand_in_the_figure_of_the_library(names, tmp_path):
    drawing = BeautifulSoup(figure("library", names, tmp_path), "html.parser").find("svg")
    linked = {link["href"].removeprefix("#trexton.") for link in drawing.find_all("a")}
    assert linked == {name for name, _ in names["public_names"]}


def test_what_is_quoted_stands_in_its_source(names):
    rules = tomllib.loads((ROOT / "data" / "paper" / "protocol.toml").read_text())["rules"]
    ranking = names["quoted"]["ranking"]
    values = [*ranking["claimed"].values(), *ranking["drawn"]["values"], *ranking["exact"].values()]
    said = re.findall(r"\.\d\d", rules["ranking"])
    assert {f"{value:.2f}"[1:] for value in [*values, ranking["asked"]]} <= set(said)
    works = names["quoted"]["works"]
    assert works.keys() <= parse_file(BOOK / "references.bib").entries.keys()
    for each in names["quoted"]["tried"].values():
        assert len(each["tried"]) == len(each["instead"]) and each["name"]
