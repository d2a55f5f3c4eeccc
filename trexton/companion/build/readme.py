"""The README's table of results is that of the first page: ``book/door.md`` with its numbers.

``python -m trexton.companion.build.readme`` renews it from ``results``.
"""

from __future__ import annotations

import re
from pathlib import Path

from trexton.base.cache import repository_root
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file
from trexton.companion.build.prose import door
from trexton.companion.claims.ledger import load_records
from trexton.companion.wording import Tree

__all__ = ["renewed"]

_TABLE = re.compile(r"(?<=readme -->\n).*?(?=<!-- end of results -->)", re.DOTALL)


def renewed(text: str, results: Path) -> str:
    """The README's text with the table of these results.

    Raises
    ------
    TrextonError
        The marks around the table are not there, once each.
    """
    records = load_records(results)
    values = {
        flight: Tree({n: r.values for n, r in own.items()}) for flight, own in records.items()
    }
    if len(_TABLE.findall(text)) != 1:
        raise TrextonError("README.md: the marks around its results are gone: put them back")
    return _TABLE.sub(lambda _: door(values), text)


if __name__ == "__main__":
    clone = repository_root() or Path(".")
    text = renewed((clone / "README.md").read_text(encoding="utf-8"), clone / "results")
    with atomic_file(clone / "README.md") as stream:
        stream.write(text)
