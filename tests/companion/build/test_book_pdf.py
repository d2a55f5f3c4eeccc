"""The book for print: every page once, in the order of its contents, on paper."""

from __future__ import annotations

import shutil

import pytest

from trexton.base.errors import TrextonError
from trexton.companion.build.pdf import print_book, whole_book


@pytest.fixture
def book(tmp_path):
    nav = '<nav class="bd-links"><a class="internal" href="a/one.html">1</a></nav>'
    page = "<html><head></head><body>{nav}<article><h1>{title}</h1>{more}</article></body></html>"
    (tmp_path / "a").mkdir()
    (tmp_path / "intro.html").write_text(page.format(nav=nav, title="First", more=""))
    more = '<img src="x.png"><iframe src="p.html"></iframe><a href="gone.html">see</a>'
    (tmp_path / "a" / "one.html").write_text(page.format(nav="", title="Second", more=more))
    return tmp_path


def test_all_pages_are_in_it_once_and_in_order(book):
    text = whole_book(book)
    assert text.count("First") == text.count("Second") == 1
    assert text.index("First") < text.index("Second")
    assert 'src="a/x.png"' in text and "iframe" not in text and "gone.html" not in text


def test_a_folder_without_a_book_is_said(tmp_path):
    with pytest.raises(TrextonError, match="no book is built here"):
        whole_book(tmp_path)


def test_without_a_browser_it_says_so(book, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(TrextonError, match="no chromium"):
        print_book(book, tmp_path / "book.pdf")


@pytest.mark.skipif(not shutil.which("chromium"), reason="no chromium on this machine")
def test_it_prints(book, tmp_path):
    made = print_book(book, tmp_path / "book.pdf")
    assert made.read_bytes().startswith(b"%PDF") and not (book / ".print.html").exists()
