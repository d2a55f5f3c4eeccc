"""jupytext and nbformat, loaded without what takes most of their time.

nbformat loads jsonschema, which, where it finds a package for them, builds a grammar of IRIs: two
seconds in each process, for a format that no notebook has.
"""

from __future__ import annotations

import sys

_GRAMMAR = "rfc3987_syntax"
if _GRAMMAR in sys.modules:
    import nbformat
else:
    sys.modules[_GRAMMAR] = None  # type: ignore[assignment]  # as if it were not installed
    try:
        import nbformat
    finally:
        del sys.modules[_GRAMMAR]

import jupytext  # noqa: E402

__all__ = ["jupytext", "nbformat"]
