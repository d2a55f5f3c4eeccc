"""The last hand at pages: figures in the page, tables for phones, mathematics without scripts."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from html import unescape

import numpy as np
import pytest
from IPython.display import SVG

from trexton.base.errors import DataError
from trexton.companion.build.charts import inline_figure, is_figure, with_phone
from trexton.companion.build.mathematics import mathml
from trexton.companion.build.postprocessing import finish_page
from trexton.companion.experiments.figure_files import for_phones, layer, to_png, to_svg
from trexton.companion.experiments.style import COLORS, canvas


@pytest.fixture
def figure():
    return draw()


def draw():
    with canvas(1, 2, size=(6, 3)) as (figure, axes):
        axes[0, 0].plot(
            [1, 10, 100], [3.0, np.nan, 1.5], "o-", label="filter", color=COLORS["neighbors"]
        )
        axes[0, 0].axhline(2)  # a line through two points tells nothing
        axes[0, 0].set(xscale="log", xlabel="samples", ylabel="error (cm)")
        axes[0, 1].bar(["a & b", "c"], [2, 4], label="<costs>")
        axes[0, 1].errorbar([0, 1], [2, 4], yerr=1, fmt="s", label="bars")
        axes[0, 1].scatter([0.5], [3], label="dots")
    return figure


def test_svg_is_whole_equal_in_every_run_and_keeps_the_scale_of_its_letters(figure):
    svg = to_svg(figure)
    assert svg == to_svg(draw()) and is_figure(svg.decode())
    ET.fromstring(svg)
    assert "scale(0.015625)" in svg.decode()
    assert to_png(figure).startswith(b"\x89PNG")


def test_a_figure_in_a_page_follows_its_theme_and_names_nothing_twice(figure):
    svg = to_svg(figure).decode()
    one, other = (inline_figure(svg, name, 'says "so"') for name in ("f1", "f2"))
    assert f"var(--fig-{COLORS['neighbors'][1:].lower()}, {COLORS['neighbors'].lower()})" in one
    assert 'aria-label="says &quot;so&quot;"' in one and "<metadata" not in one
    assert 'width="576"' in one  # six inches
    ids = [set(re.findall(r'\bid="([^"]+)"', text)) for text in (one, other)]
    assert ids[0] and not ids[0] & ids[1]
    used = set(re.findall(r'href="#([^"]+)"', one)) | set(re.findall(r"url\(#([^)]+)\)", one))
    assert used and used <= ids[0]
    with pytest.raises(DataError, match="no SVG"):
        inline_figure("nothing", "f1", "")
    with canvas(size=(4, 3)) as (small, axes):
        axes[0, 0].plot([1, 2])
    drawn = inline_figure(to_svg(small).decode(), "f1", "")
    assert 'svg class="chart narrow"' in drawn and "xlink:href" not in drawn


def test_layers_are_hidden_in_every_file_and_a_page_chooses_one(tmp_path):
    with canvas(1, 2, size=(6, 3)) as (figure, axes):
        for step in range(3):
            with layer(figure, step, shown=step == 1):
                axes[0, 0].imshow(np.full((2, 2), step))
                axes[0, 1].plot([0, step], [0, 1], label="line")
    alone, svg = to_png(figure), to_svg(figure).decode()
    assert alone == to_png(figure)  # what was hidden for it is there again
    hidden = re.findall(r'display="none" id="step-(\d)-', svg)
    assert sorted(hidden) == ["0", "0", "2", "2"] and len(re.findall('id="step-1-', svg)) == 2
    (tmp_path / "_images").mkdir()
    (tmp_path / "_images" / "a.svg").write_text(with_phone(svg, for_phones(figure)))
    (tmp_path / "page.html").write_text(
        '<head></head><article><figure><img src="_images/a.svg" alt="a"><figcaption>A.</figcaption>'
        "</figure></article>"
    )
    text = finish_page(tmp_path / "page.html")
    choices = re.findall(r"<input[^>]*>", text)
    assert ["checked" in choice for choice in choices] == [False, True, False]
    assert len({re.search('name="[^"]+"', choice)[0] for choice in choices}) == 1
    for step in range(3):  # on the desk and on the phone
        assert len(re.findall(rf'id="f1p?-step-{step}-', text)) == 4


def test_a_wide_figure_is_laid_out_anew_for_phones_and_both_are_in_the_page(figure):
    letters = re.search(r"scale\([^)]*\)", wide := to_svg(figure).decode())[0]
    figure.axes[0].legend(*figure.axes[1].get_legend_handles_labels(), ncols=2)
    phone = for_phones(figure)
    above, below = (axes.get_position() for axes in figure.axes)
    assert above.y0 > below.y1 and letters in phone.decode()  # words keep their size
    width = float(re.search(rb'width="([\d.]+)pt"', phone)[1])
    assert width < 72 * 4.5
    ET.fromstring(both := with_phone(wide, phone))
    shown = SVG(both).data  # as a notebook keeps it
    drawn = inline_figure(shown, "f1", "costs")
    assert [kind in drawn for kind in ("chart wide", "chart phone narrow")] == [True, True]
    ids = re.findall(r'\bid="([^"]+)"', drawn)
    assert len(ids) == len({*ids})


def test_narrow_figures_and_sheets_of_pictures_are_one_for_all_pages():
    with canvas(size=(4, 3)) as (narrow, _):
        pass
    with canvas(2, 5, size=(7, 3)) as (sheet, _):
        pass
    assert for_phones(narrow) is None and for_phones(sheet) is None
    assert with_phone("<svg></svg>", None) == "<svg></svg>"


def test_a_style_of_many_marks_is_said_once():
    with canvas() as (figure, axes):
        axes[0, 0].plot(np.arange(300), ".", color=COLORS["field"])
    drawn = inline_figure(to_svg(figure).decode(), "f", "dots")
    marks, color = re.findall(r'<use [^>]*class="(f-\d+)"', drawn), COLORS["field"].lower()
    assert len(marks) >= 300 and re.search(rf"\.{marks[-1]} {{[^}}]*{color}", drawn)
    assert drawn.count(color) < 10  # not with each mark


def test_pictures_in_a_figure_get_lighter():
    noise = np.random.default_rng(1).integers(0, 256, (200, 200, 3), np.uint8)
    with canvas() as (figure, axes):
        axes[0, 0].imshow(noise)
    svg = to_svg(figure).decode()
    assert len(inline_figure(svg, "f", "noise")) < 0.6 * len(svg)


@pytest.mark.parametrize(
    "tex", [r"\frac{a}{b}_{t-1}^{[m]}", r"\arg\max_x p(x)", r"\!\left(z\right)"]
)
def test_mathematics_is_set_when_the_book_is_built(tex):
    element = mathml(tex, "block")
    assert ET.fromstring(unescape(element)).tag.endswith("math") and "\\" not in element


def test_mathematics_that_is_not_understood_stops_the_build():
    with pytest.raises(ValueError, match="unheardof"):
        mathml(r"\unheardof{x}")


PAGE = """<html><head><script>const THEBE_JS_URL = "https://x"</script><script src="mathjax/a.js">
</script></head><body><article><h1>Title#</h1><p class="finding">It errs by 5 cm.</p>
<table id="axes"><caption>Axes.</caption>
<thead><tr><th></th><th>cm</th></tr></thead><tbody><tr><td>a</td><td>1
<small>[0, 2]</small></td>
</tr></tbody></table><img alt="a curve" src="_images/curve.svg"><pre>code --a 5 cm</pre>
<a href="#axes">the table</a>
<a href="#no">none</a>
</article></body></html>"""


def test_a_page_is_finished(tmp_path, figure):
    (tmp_path / "_images").mkdir()
    (tmp_path / "_images" / "curve.svg").write_bytes(to_svg(figure))
    (tmp_path / "page.html").write_text(PAGE)
    text = finish_page(tmp_path / "page.html")
    assert "THEBE" not in text and "mathjax" not in text
    assert 'aria-label="Axes."' in text and 'role="region"' in text
    assert '<a href="#axes">the table</a>\nnone' in text
    assert "<figcaption>a curve.</figcaption>" in text and 'aria-label="a curve"' in text
    assert '<pre tabindex="0">' in text and "errs by 5\N{NO-BREAK SPACE}cm" in text
    assert "[0,\N{NO-BREAK SPACE}2]" in text
    assert "a 5 cm" in text  # what is typed in is copied as it is typed


def test_a_table_of_sentences_is_told_apart_from_one_of_numbers(tmp_path):
    head = "<thead><tr><th>fault</th><th>what is done</th></tr></thead>"
    rows = {"said": "it is opened again after half a second", "numbers": "8.5 [7, 9] cm"}
    (tmp_path / "page.html").write_text(
        "<html><head></head><body><article><h1>T</h1>"
        + "".join(
            f'<table class="table" id="{name}">{head}<tbody><tr>'
            f"<td>a label of eight words, not a sentence</td><td>{cell}</td></tr></tbody></table>"
            for name, cell in rows.items()
        )
        + "</article></body></html>"
    )
    text = finish_page(tmp_path / "page.html")
    assert re.findall(r'<table class="stacked table" id="(\w+)"', text) == ["said"]
    assert text.count('data-label="what is done"') == 1


def test_a_table_wider_than_long_is_cards_on_a_phone(tmp_path):
    def table(columns: int, rows: int) -> str:
        head, row = ("".join(f"<{tag}>1</{tag}>" for _ in range(columns)) for tag in ("th", "td"))
        body = f"<tr>{row}</tr>" * rows
        return f'<table class="c{columns}r{rows}"><thead><tr>{head}</tr></thead>{body}</table>'

    shapes = ((6, 2), (7, 2), (9, 6), (9, 20))
    (tmp_path / "page.html").write_text(
        f"<html><head></head><body><article><h1>T</h1>{''.join(table(*each) for each in shapes)}"
        "</article></body></html>"
    )
    text = finish_page(tmp_path / "page.html")
    assert re.findall(r'<table class="(\w+) stacked"', text) == ["c7r2", "c9r6"]


def test_the_first_picture_of_the_book_scrolls_where_it_is_too_wide(tmp_path, figure):
    (tmp_path / "_images").mkdir()
    (tmp_path / "_images" / "hero.svg").write_bytes(to_svg(figure))
    (tmp_path / "page.html").write_text(
        "<html><head></head><body><article>"
        '<a class="image-reference" href="x"><img class="hero" alt="all" '
        'src="_images/hero.svg"></a>'
        "</article></body></html>"
    )
    text = finish_page(tmp_path / "page.html")
    assert '<div aria-label="all" class="hero" role="group" tabindex="0"><svg' in text
    assert "<figcaption" not in text and "<a " not in text
