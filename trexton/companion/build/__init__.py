"""From flights to pages. Steps run where anything changed, the book is made of their results."""

import atexit
import gc
import sys

atexit.register(gc.freeze)  # to free at its end all that was imported takes a kernel half a second

# As if it were not installed: where it is, nbformat's validator builds a grammar of IRIs, a second
# in each process, for a format that no notebook has.
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]
