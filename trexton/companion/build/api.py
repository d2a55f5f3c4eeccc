"""The book: prose from ``book/``, executed notebooks as pages, every number from a record."""

from trexton.companion.build.make import build_small_book, make_book

__all__ = ["build_small_book", "make_book"]
