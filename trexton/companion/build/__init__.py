"""From flights to pages. Steps run where anything changed, the book is made of their results."""

import sys

# As if it were not installed: where it is, nbformat's validator builds a grammar of IRIs, a second
# in each process, for a format that no notebook has.
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]
