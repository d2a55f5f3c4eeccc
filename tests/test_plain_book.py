"""The book is written plainly: what ``make prose`` counts, and that no page breaks a bound."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT
from plain_book import BOOK, Prose, measure, pages
from pybtex.database import parse_file


@pytest.fixture(scope="module")
def book():
    return pages(ROOT)


def test_a_page_is_counted_as_it_is_read(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("""# Not counted: a heading

The error is {{ error.mean_cm | span }} cm; see {doc}`the field </beyond>` and `code here`.
{% if more is defined %}It was told nothing.{% endif %}

```bash
not counted
```

| not in the mean | but held to length |
|---|---|
| a cell | $x = 1$ |

```{code-cell} ipython3
page.say(r\"\"\"
Said by a cell.
\"\"\")
```
""")
    counted = measure(page)
    assert counted.paragraphs == [
        "The error is 7 cm; see the field and Code. It was told nothing.",
        "Said by a cell.",
    ]
    assert counted.cells == ["not in the mean", "but held to length", "a cell", "x"]
    assert counted.measures() == {
        "words": 18,
        "mean": pytest.approx(6),
        "marks": pytest.approx(1 / 3),
        "numbers": pytest.approx(100 / 18),
        "idiom": pytest.approx(1000 / 18),
    }
    assert [fault.split(":")[0] for fault in counted.faults()] == ["marks", "numbers", "idiom"]


def test_long_sentences_cells_paragraphs_and_pages_are_named():
    sentence = "Word " + "word " * 35 + "end."
    faults = Prose("page", [sentence] * 30, [sentence]).faults()
    assert sum(f"37 words, at most 35: {sentence}" == fault for fault in faults) == 31
    assert "mean: 37, at most 18.0" in faults and "words: 1110, at most 900" in faults
    short = "A word or two. " * 30
    assert Prose("page", [short], []).faults() == [f"120 words, at most 90: {short}"]
    assert Prose("README", ["Four words stand here."] * 120, []).faults() == [
        "words: 480, at most 450"
    ]
    assert not Prose("glossary", ["Four words stand here."] * 300, []).faults()


def test_what_is_cited_stands_among_the_references():
    entries = parse_file(ROOT / "book" / "references.bib").entries
    cited = {
        key
        for path in (ROOT / "book").glob("*.md")
        for keys in re.findall(r"\{cite[:a-z]*\}`([^`]+)`", path.read_text())
        for key in keys.split(",")
    }
    assert cited <= entries.keys() and len(entries) >= 30
    sources = [entry for entry in entries.values() if {"doi", "url"} & entry.fields.keys()]
    assert len(sources) >= 35
    for entry in sources:
        assert re.match(r"10\.\d{4,}/\S+$", entry.fields.get("doi", "10.0000/x")), entry.key


def test_no_page_breaks_a_bound(book):
    faults = [f"{page.name}: {fault}" for page in book for fault in page.faults()]
    assert not faults, "\n".join(faults)


def test_a_release_has_at_most_fifteen_lines():
    releases = (ROOT / "CHANGELOG.md").read_text().split("\n## ")[1:]
    assert releases and max(text.count("\n- ") for text in releases) <= 15


def test_the_book_is_not_too_long(book):
    assert sum(page.measures()["words"] for page in book[2:]) <= BOOK and len(book) <= 32
