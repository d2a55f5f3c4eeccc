"""The built book as one PDF, printed by a headless browser.

``python -m trexton.companion.build.pdf`` writes it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from bs4 import BeautifulSoup

from trexton.base.cache import repository_root
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file

__all__ = ["print_book", "whole_book"]

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def whole_book(html: Path) -> str:
    """All pages of the book in their order, as one page to be put beside its index.

    Raises
    ------
    TrextonError
        There is no book in the folder.
    """
    index = html / "intro.html"
    index = index if index.is_file() else html / "small.html"
    if not index.is_file():
        raise TrextonError(f"{html}: no book is built here: make book first")
    first = BeautifulSoup(index.read_text("utf-8"), "lxml")
    names = [index.name]
    for link in first.select("nav.bd-links a.internal"):
        name = str(link["href"]).split("#")[0]
        if name and name not in names:
            names.append(name)
    parts = []
    for name in names:
        page = BeautifulSoup((html / name).read_text("utf-8"), "lxml")
        article = page.find("article")
        if article is None:
            continue
        for element in article.find_all(src=True):  # relative to the top of the book
            element["src"] = str((Path(name).parent / str(element["src"])).as_posix())
        for frame in article.find_all(["iframe", "script"]):
            if "chart-data" not in frame.get_attribute_list("class"):
                frame.decompose()
        for link in article.find_all("a", href=True):
            del link["href"]
        parts.append(f'<section style="break-before: page">{article}</section>')
    for element in first.find_all("script"):
        element.decompose()
    body = first.body
    assert body is not None
    body.clear()
    body.append(BeautifulSoup("".join(parts), "html.parser"))
    return str(first)


def print_book(html: Path, target: Path) -> Path:
    """Print the book below `html` to `target`; returns it.

    Raises
    ------
    TrextonError
        No book, no browser, or the browser gave no PDF.
    """
    browser = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        raise TrextonError("no chromium on this machine: install it, or print from your browser")
    page = html / ".print.html"
    try:
        with atomic_file(page) as stream:
            stream.write(whole_book(html))
        with tempfile.TemporaryDirectory() as profile:
            made = Path(profile) / "book.pdf"
            command = [
                browser, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer",
                "--disable-background-networking", f"--user-data-dir={profile}/profile",
                f"--print-to-pdf={made}", page.resolve().as_uri(),
            ]  # fmt: skip
            run = subprocess.run(command, capture_output=True, text=True, timeout=600)
            if not made.is_file():
                raise TrextonError(f"{browser} gave no PDF: {run.stderr.strip()[-300:]}")
            with atomic_file(target, "wb") as stream:
                stream.write(made.read_bytes())
    finally:
        page.unlink(missing_ok=True)
    return target


def main() -> int:
    """Print the book of this clone."""
    built = (repository_root() or Path()) / "book" / "_build"
    try:
        print(print_book(built / "html", built / "trexton.pdf"))
    except TrextonError as error:
        print(f"pdf: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
