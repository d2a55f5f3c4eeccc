"""A browser and a built book for tests of what a reader sees: a plugin of those tests alone.

The book is the folder that ``TREXTON_BOOK`` names, as ``make browser`` does; without it the tests
are skipped, for they take minutes.
"""

from __future__ import annotations

import functools
import http.server
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

BUILT = Path(os.environ.get("TREXTON_BOOK") or "no-book-is-named")
NO_BOOK = "no built book is named in TREXTON_BOOK: make book, then make browser"
NAMES = ("chromium", "chromium-browser", "google-chrome")
# The browser's own errands are no requests of a page.
QUIET = (
    "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


def page_names(book: Path) -> list[str]:
    """Every page of the book by its path, but the players and what only leads to another page."""
    return sorted(
        str(path.relative_to(book))
        for path in book.rglob("*.html")
        if "_static" not in path.parts
        and not path.name.endswith("-player.html")
        and 'http-equiv="refresh"' not in path.read_text(encoding="utf-8")[:400].lower()
    )


@pytest.fixture(scope="session")
def book() -> Path:
    if not (BUILT / "index.html").is_file():
        pytest.skip(NO_BOOK)
    return BUILT


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no chromium on this machine: apt install chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(QUIET))
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def axe():
    """``axe(page)``: what the accessibility checker calls serious or critical, as sentences."""
    tool = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    # It would load the style sheets once more, from addresses that they do not have.
    serious = {"resultTypes": ["violations"], "preload": False}

    def axe(page) -> list[str]:
        return [
            f"{each['id']}: {node['target']} {node['html'][:120]}"
            for each in tool.run(page, options=serious).response["violations"]
            if each["impact"] in ("serious", "critical")
            for node in each["nodes"]
        ]

    return axe


@pytest.fixture(scope="session")
def host(book: Path) -> Iterator[str]:
    """The book served on this machine."""
    quiet = type("Quiet", (http.server.SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    handler = functools.partial(quiet, directory=str(book))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture
def open_page(browser, host):
    """``open_page(name, width=1400, dark=False, scripts=True)``: a page, and what went wrong."""
    contexts = []

    def open_page(name: str, width: int = 1400, dark: bool = False, scripts: bool = True):
        theme = "dark" if dark else "light"
        context = browser.new_context(
            viewport={"width": width, "height": 900},
            color_scheme=theme,
            java_script_enabled=scripts,
        )
        contexts.append(context)
        context.set_default_timeout(120_000)  # a busy machine is slow, not at fault
        context.add_init_script(
            f"localStorage.setItem('mode', '{theme}'); localStorage.setItem('theme', '{theme}')"
        )
        page, faults = context.new_page(), []
        page.on("pageerror", lambda error: faults.append(f"error: {error}"))
        page.on("console", lambda said: said.type == "error" and faults.append(said.text))
        page.on("requestfailed", lambda request: faults.append(f"failed: {request.url}"))
        page.on(
            "request",
            lambda request: (
                not request.url.startswith((host, "data:", "blob:"))
                and faults.append(f"foreign: {request.url}")
            ),
        )
        page.on(
            "response",
            lambda answer: answer.status >= 400 and faults.append(f"{answer.status}: {answer.url}"),
        )
        page.goto(host + name, wait_until="load")
        return page, faults

    yield open_page
    for context in contexts:
        context.close()
