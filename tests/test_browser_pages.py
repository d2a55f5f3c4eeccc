"""Every page in a real browser: three widths, light and dark, with scripts and without."""

from __future__ import annotations

import re

import pytest
from browser_book import BUILT, page_names

pytest_plugins = ["browser_book"]

PAGE_BYTES = 1_000_000
SHIFT = 0.05


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "name" in metafunc.fixturenames:
        names = page_names(BUILT) if (BUILT / "index.html").is_file() else []
        absent = pytest.mark.skip("no book is built here: make book, or name one in TREXTON_BOOK")
        metafunc.parametrize("name", names or [pytest.param("", marks=absent)])


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [360, 768, 1400])
def test_a_page_loads_without_a_fault_at_any_width(open_page, name, width, dark):
    page, faults = open_page(name, width, dark)
    assert faults == []
    wide = page.evaluate("document.documentElement.scrollWidth")
    assert wide <= width, f"the page scrolls sideways: {wide} px"
    broken = page.evaluate(
        "[...document.images].filter(i => i.loading !== 'lazy' && !i.naturalWidth && "
        "i.offsetParent)"
        ".map(i => i.src)"
    )
    assert broken == []


def test_a_page_is_light_and_stays_where_it_is(open_page, name):
    page, _ = open_page(name, 1400)
    shift = page.evaluate(
        """() => new Promise(done => {
            let sum = 0;
            new PerformanceObserver(list => list.getEntries().forEach(e => { sum += e.value; }))
                .observe({ type: 'layout-shift', buffered: true });
            setTimeout(() => done(sum), 150);
        })"""
    )
    assert shift < SHIFT
    weight = page.evaluate(
        """[...performance.getEntriesByType('resource'),
         ...performance.getEntriesByType('navigation')]
        .filter(e => !e.name.includes('-player.html'))
        .reduce((sum, e) => sum + e.decodedBodySize, 0)"""
    )
    assert weight < PAGE_BYTES, f"the page weighs {weight} bytes"


def test_equations_and_figures_are_there_without_scripts(open_page, name):
    page, _ = open_page(name, scripts=False)
    text = page.inner_text("main")
    assert not re.search(r"\\(frac|sum|mathbf|mathcal)\b", text), "raw TeX on the page"
    for figure in page.query_selector_all("figure.plate"):
        assert len(figure.query_selector_all("figcaption")) == 1
        assert figure.query_selector("svg, img") is not None


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_axe_finds_nothing_serious(open_page, name, dark):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page, _ = open_page(name, dark=dark)
    found = axe.run(page).response["violations"]
    serious = [
        f"{each['id']}: {node['target']} {node['html'][:120]}"
        for each in found
        if each["impact"] in ("serious", "critical")
        for node in each["nodes"]
    ]
    assert serious == []


def test_the_first_figure_of_an_experiment_is_near_on_a_phone(open_page, name):
    page, _ = open_page(name, 360)
    if "/" not in name or page.query_selector("figure.plate") is None:
        pytest.skip("no experiment with figures")
    top = page.evaluate("document.querySelector('figure.plate').getBoundingClientRect().top")
    assert top < 2 * 780


def test_titles_are_told_apart(open_page, book, browser):
    titles: dict[str, str] = {}
    for path in sorted(book.rglob("*.html")):
        if "_static" in path.parts or path.stem.endswith("-player") or path.stem == "index":
            continue
        found = re.findall(r"<h1[^>]*>(.*?)</h1>", path.read_text(), re.DOTALL)
        if path.stem not in ("genindex", "search"):
            assert len(found) == 1, f"{path}: {len(found)} titles"
        for title in found:
            plain = re.sub(r"<[^>]+>", "", title).strip()
            assert plain not in titles, f"{path} and {titles[plain]} are both {plain!r}"
            titles[plain] = str(path)


def test_links_and_downloads_answer(book, host, browser):
    context = browser.new_context()
    asked: set[str] = set()
    for path in sorted(book.rglob("*.html")):
        if "_static" in path.parts:
            continue
        for link in re.findall(r'href="([^"#?]+)[^"]*"', path.read_text()):
            if re.match(r"[a-z]+:|//", link):
                continue
            target = (path.parent / link).resolve()
            asked.add(str(target.relative_to(book.resolve())))
    bad = [link for link in sorted(asked) if not context.request.get(host + link).ok]
    context.close()
    assert asked and bad == []
