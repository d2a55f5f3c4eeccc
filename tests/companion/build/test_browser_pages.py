"""Every page in a real browser: three widths, light and dark, with scripts and without.

A page is loaded twice, and each load answers all that can be asked of it. Without scripts it is
what its file holds.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from browser_book import BUILT, NO_BOOK, page_names
from bs4 import BeautifulSoup

pytest_plugins = ["browser_book"]

PAGE_BYTES = 1_350_000  # of two experiments on two flights; half is the theme, loaded once
SHIFT = 0.05
PAGES = 30
WIDTHS = (1400, 768, 360)
PHONE = 780  # pixels of a phone's screen from top to bottom
# Kept as pictures where TREXTON_SCREENSHOTS names a folder.
LOOKED_AT = (
    "intro", "paper_map", "claims", "hall", "trust", "mocap_training", "beyond", "fine",
    "uncertainty", "rooms",
)  # fmt: skip

COLUMNS = 6  # of a table, at most
WIDEST = """Math.max(0, ...[...document.querySelectorAll('.bd-article tr')]
    .map(row => row.cells.length))"""
SHIFTED = """() => new Promise(done => {
    let sum = 0;
    new PerformanceObserver(list => list.getEntries().forEach(e => { sum += e.value; }))
        .observe({ type: 'layout-shift', buffered: true });
    setTimeout(() => done(sum), 100);
})"""
WEIGHT = """[...performance.getEntriesByType('resource'),
    ...performance.getEntriesByType('navigation')]
    .filter(e => !e.name.includes('-player.html')).reduce((sum, e) => sum + e.decodedBodySize, 0)"""
BROKEN = """[...document.images]
    .filter(i => i.loading !== 'lazy' && !i.naturalWidth && i.offsetParent).map(i => i.src)"""
TOP = "s => (e => e ? e.getBoundingClientRect().top + scrollY : null)(document.querySelector(s))"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "name" in metafunc.fixturenames:
        names = page_names(BUILT) if (BUILT / "index.html").is_file() else []
        metafunc.parametrize("name", names or [pytest.param("", marks=pytest.mark.skip(NO_BOOK))])


def picture(page, name: str, width: int, dark: bool) -> None:
    """Keep what the page looks like, if it is one to be looked at."""
    folder = os.environ.get("TREXTON_SCREENSHOTS")
    if folder and Path(name).stem in LOOKED_AT and width in (WIDTHS[0], WIDTHS[-1]):
        file = f"{name.removesuffix('.html').replace('/', '-')}-{width}"
        path = Path(folder) / f"{file}-{'dark' if dark else 'light'}.png"
        page.screenshot(path=path, full_page=True, animations="disabled")  # no sidebar half gone


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_page_is_sound_at_any_width(open_page, axe, name, dark):
    # The first load is a desktop's in the light and a phone's in the dark.
    widths = WIDTHS[::-1] if dark else WIDTHS
    page, faults = open_page(name, widths[0], dark)
    if (shift := page.evaluate(SHIFTED)) >= SHIFT:
        faults.append(f"moves while it loads: {shift:.3f}")
    if (weight := page.evaluate(WEIGHT)) >= PAGE_BYTES:
        faults.append(f"weighs {weight} bytes")
    if (columns := page.evaluate(WIDEST)) > COLUMNS:
        faults.append(f"has a table of {columns} columns")
    faults += axe(page)
    for width in widths:
        page.set_viewport_size({"width": width, "height": 900})
        if (wide := page.evaluate("document.documentElement.scrollWidth")) > width:
            faults.append(f"scrolls sideways: {wide} px at {width}")
        faults += [f"broken at {width}: {source}" for source in page.evaluate(BROKEN)]
        if width == WIDTHS[-1]:  # a page that begins with what was found has its figure next
            begin, top = (page.evaluate(TOP, each) for each in (".finding", "figure.plate"))
            if begin is not None and begin < PHONE and top is not None and top >= 2 * PHONE:
                faults.append(f"the first figure begins at {top:.0f} px on a phone")
        picture(page, name, width, dark)
    assert not faults, "\n".join(faults)


def test_equations_and_figures_are_there_without_scripts(book, name):
    page = BeautifulSoup((book / name).read_text(encoding="utf-8"), "html.parser")
    for script in page.select("script"):
        script.decompose()
    text = page.select_one("main").get_text()
    assert not re.search(r"\\(frac|sum|mathbf|mathcal)\b", text), "raw TeX on the page"
    assert [
        plate.get("id") or plate.get_text()[:80]
        for plate in page.select("figure.plate")
        if len(plate.select("figcaption")) != 1 or not plate.select_one("svg, img")
    ] == []


def test_titles_are_told_apart(book):
    titles: dict[str, str] = {}
    assert len(page_names(book)) <= PAGES + 1  # and the search
    for path in (book / name for name in page_names(book)):
        found = re.findall(r"<h1[^>]*>(.*?)</h1>", path.read_text(), re.DOTALL)
        if path.stem != "search":
            assert len(found) == 1, f"{path}: {len(found)} titles"
        for title in found:
            plain = re.sub(r"<[^>]+>", "", title).strip()
            assert plain not in titles, f"{path} and {titles[plain]} are both {plain!r}"
            titles[plain] = str(path)


def test_links_and_downloads_answer(book, host, browser):
    context = browser.new_context()
    pages = {path.resolve(): path.read_text() for path in book.rglob("*.html")}
    anchors = {path: set(re.findall(r'\b(?:id|name)="([^"]+)"', pages[path])) for path in pages}
    asked: set[str] = set()
    dead: list[str] = []
    for path, text in pages.items():
        if "_static" in path.parts:
            continue
        for link, anchor in re.findall(r'href="([^"#?]*)(?:#([^"]+))?"', text):
            if re.match(r"[a-z]+:|//", link):
                continue
            target = (path.parent / link).resolve() if link else path
            asked.add(str(target.relative_to(book.resolve())))
            if anchor and anchor not in anchors.get(target, {anchor}):
                dead.append(f"{path.name}: {link}#{anchor}")
    bad = [link for link in sorted(asked) if not context.request.head(host + link).ok]
    context.close()
    assert asked and bad == [] and dead == []
