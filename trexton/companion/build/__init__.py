"""From flights to pages: steps that run where anything changed, and the book of their results."""

import sys

# As if it were not installed: where it is, nbformat's validator builds a grammar of IRIs, a second
# in each process, for a format that no notebook has.
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]
