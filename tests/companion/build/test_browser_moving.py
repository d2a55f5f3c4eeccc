"""What moves: the player, charts that enlarge, filters of the ledger."""

from __future__ import annotations

import json
import re

import pytest

pytest_plugins = ["browser_book"]


def first_page(book, pattern: str) -> str:
    found = sorted(book.rglob(pattern) if "player" in pattern else book.glob(pattern))
    if not found:
        pytest.skip(f"this book has no {pattern}")
    return str(found[-1].relative_to(book))


def recording(book, name: str) -> dict:
    text = (book / name).read_text()
    return json.loads(re.search(r'type="application/json">(.*?)</script>', text, re.DOTALL)[1])


@pytest.mark.parametrize("width", [360, 1400])
def test_the_player_shows_the_numbers_of_its_frame(open_page, book, width):
    name = first_page(book, "*-player.html")
    data = recording(book, name)
    page, faults = open_page(name, width)
    for row in (0, len(data["frames"]) // 2, len(data["frames"]) - 1):
        page.evaluate(
            "row => { const s = document.getElementById('scrub'); s.value = row;"
            " s.dispatchEvent(new Event('input')); }",
            row,
        )
        kept, said = data["frames"][row], page.inner_text("#readout")
        assert said.startswith(f"Frame {kept['frame']}, {kept['time_s']:.1f} s.")
        for method, error in kept["errors_cm"].items():
            assert f"{method} {error:g} cm" in said
    assert faults == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_player_plays_stops_and_steps_by_keys(open_page, book):
    name = first_page(book, "*-player.html")
    page, _ = open_page(name)
    page.select_option("#speed", "10")
    page.click("#play")
    page.wait_for_function("Number(document.getElementById('scrub').value) > 2")
    page.click("#play")
    assert page.inner_text("#play") == "Play"
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Home")
    assert page.input_value("#scrub") == "0"
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert page.input_value("#scrub") == "2"
    page.keyboard.press("End")
    assert int(page.input_value("#scrub")) == len(recording(book, name)["frames"]) - 1


def test_layers_of_the_player_change_what_is_drawn(open_page, book):
    page, _ = open_page(first_page(book, "*-player.html"))
    drawn = "document.getElementById('floor').toDataURL()"
    before = page.evaluate(drawn)
    page.click("#layers label:has-text('particles') input")
    assert page.evaluate(drawn) != before


def test_without_scripts_the_player_says_so(open_page, book):
    page, _ = open_page(first_page(book, "*-player.html"), scripts=False)
    assert "allow scripts" in page.inner_text("main")


@pytest.mark.parametrize("width", [360, 1400])
def test_a_page_gives_its_player_the_height_that_it_takes(open_page, book, width):
    page, _ = open_page(first_page(book, "mocap_training.html"), width)
    page.eval_on_selector("iframe.player", "frame => frame.scrollIntoView({behavior: 'instant'})")
    page.wait_for_function("document.querySelector('iframe.player').style.height")
    room = "f => f.clientHeight - f.contentDocument.documentElement.offsetHeight"
    assert page.eval_on_selector("iframe.player", room) == 0


def test_a_player_is_under_two_megabytes(book):
    first_page(book, "*-player.html")
    assert all(path.stat().st_size < 2_000_000 for path in book.rglob("*-player.html"))


def test_a_chart_enlarges_and_closes(open_page, book):
    page, _ = open_page(first_page(book, "mocap_training.html"))
    page.hover("figure.plate:has(svg.chart)")
    page.click("figure.plate:has(svg.chart) .enlarge")
    whole = page.get_attribute("dialog.enlarged svg", "viewBox")
    page.click("dialog.enlarged button:has-text('Closer')")
    assert page.get_attribute("dialog.enlarged svg", "viewBox") != whole
    page.keyboard.press("Escape")
    page.wait_for_selector("dialog.enlarged", state="detached")


@pytest.mark.parametrize("scripts", [False, True])
def test_a_figure_steps_through_its_frames_and_prints_the_still(open_page, book, scripts):
    page, _ = open_page(first_page(book, "field.html"), scripts=scripts)
    figure = page.locator("figure:has(fieldset.steps):visible").first
    seen = """figure => [...new Set([...figure.querySelectorAll('[id*="-step-"]')]
        .filter(each => getComputedStyle(each).display !== 'none')
        .map(each => each.id.match(/-step-(\\d+)-/)[1]))]"""
    still = figure.locator("input:checked").get_attribute("value")
    assert figure.evaluate(seen) == [still]
    figure.locator("label").nth(1).click()
    assert figure.evaluate(seen) == ["1"]
    if scripts:
        figure.locator("button:has-text('Play')").click()
        assert figure.evaluate(seen) == ["2"]
        figure.locator("button:has-text('Stop')").click()
    page.emulate_media(media="print")
    assert figure.evaluate(seen) == [still] and not figure.locator("fieldset").is_visible()


def test_tabs_show_one_flight_without_scripts_and_the_one_chosen_everywhere_with(open_page, book):
    name = first_page(book, "mocap_training.html")
    page, _ = open_page(name, scripts=False)
    groups = page.query_selector_all("div.flights")
    if not groups:
        pytest.skip("this book has one flight")
    shown = "g => [...g.querySelectorAll(':scope > .of-flight')].map(f => f.offsetHeight > 0)"
    assert [group.evaluate(shown) for group in groups] == [[True, False]] * len(groups)
    groups[0].query_selector("label:nth-of-type(2)").click()
    assert groups[0].evaluate(shown) == [False, True]
    page.emulate_media(media="print")
    assert groups[0].evaluate(shown) == [True, True]
    page, _ = open_page(name)
    groups = page.query_selector_all("div.flights")
    groups[0].query_selector("label:nth-of-type(2)").click()
    assert [group.evaluate(shown) for group in groups] == [[False, True]] * len(groups)


def test_filters_of_the_ledger_change_what_is_counted(open_page, book):
    page, _ = open_page(first_page(book, "claims.html"))
    controls = page.query_selector_all("select, .filters input, .filters button")
    if not controls:
        pytest.skip("this ledger has no filters")
    rows = "[...document.querySelectorAll('article table tbody tr')]"
    shown = f"{rows}.filter(r => r.offsetParent).length"
    before = page.evaluate(shown)
    select = page.query_selector("article select")
    values = select.evaluate("s => [...s.options].map(o => o.value)")
    counts = set()
    for value in values:
        select.select_option(value)
        counts.add(page.evaluate(shown))
    assert before in counts and len(counts) > 1


def test_a_phone_folds_the_ledger_to_claims_and_verdicts(open_page, book):
    page, _ = open_page(first_page(book, "claims.html"), 360)
    card = page.locator("table.ledger tbody tr:has(details)").first
    if not card.locator("summary").count():
        pytest.skip("this ledger does not fold")
    rest = card.locator("small").first
    assert card.locator(".verdict").first.is_visible() and not rest.is_visible()
    heights = page.eval_on_selector_all(
        "table.ledger tbody tr:has(details)", "rows => rows.map(r => r.offsetHeight)"
    )
    assert max(heights) < 120
    card.locator("summary").click()
    assert rest.is_visible()
    card.locator("summary").click()
    assert not rest.is_visible()
    page.set_viewport_size({"width": 1400, "height": 900})
    assert rest.is_visible() and not card.locator("summary").is_visible()


def test_without_scripts_the_ledger_is_whole(open_page, book):
    page, _ = open_page(first_page(book, "claims.html"), 360, scripts=False)
    small = page.locator("table.ledger small").all()
    assert small and all(each.is_visible() for each in small)
