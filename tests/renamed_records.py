"""Records of before a renaming under their new keys: ``python tests/renamed_records.py OLD NEW``.

OLD and NEW are folders of records, such as two builds of the book. Keys of OLD are renamed by
``data/reference/renamed.tsv``; then every value that both have is compared to the bit, timings and
provenance apart. ``--write FILE...`` renames the keys of kept records in place.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TABLE = Path(__file__).resolve().parent.parent / "data" / "reference" / "renamed.tsv"
APART = ("timings", "provenance")


def renamed(record: dict[str, Any]) -> dict[str, Any]:
    """The record with new keys."""
    with TABLE.open(encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream, delimiter="\t")]
    for row in rows:
        if row["experiment"] == record.get("experiment"):
            _rename(record, row["old"].split("/"), row["new"].split("/"))
    return record


def _rename(tree: Any, old: list[str], new: list[str]) -> None:
    if isinstance(tree, list):
        for each in tree:
            _rename(each, old, new)
    if not isinstance(tree, dict):
        return
    key, *rest = old
    for name in list(tree) if key == "*" else [key]:
        if name in tree and rest:
            _rename(tree[name], rest, new[1:])
        elif name in tree:
            tree[new[0]] = tree.pop(name)


def leaves(tree: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and values of a record."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from leaves(value, f"{path}/{key}")
    else:
        yield path, tree


def compare(old: Path, new: Path) -> list[str]:
    """A line for each record of both folders: how many values are equal, and which differ."""
    lines = []
    for file in sorted(old.glob("*/*.json")):
        other = new / file.relative_to(old)
        if not other.is_file() or file.name.startswith("."):
            continue
        before = dict(leaves(renamed(json.loads(file.read_text()))))
        after = dict(leaves(json.loads(other.read_text())))
        paths = [path for path in before if path.split("/")[1] not in APART]
        gone = [path for path in paths if path not in after]
        differ = [path for path in paths if path in after and before[path] != after[path]]
        more = [path for path in after if path not in before and path.split("/")[1] not in APART]
        lines.append(
            f"{file.parent.name}/{file.stem}: {len(paths) - len(gone) - len(differ)} equal, "
            f"{len(differ)} differ {differ[:4]}, {len(gone)} gone {gone[:4]}, {len(more)} new"
        )
    return lines


if __name__ == "__main__":
    if sys.argv[1] == "--write":
        for name in sys.argv[2:]:
            text = Path(name).read_text()
            Path(name).write_text(json.dumps(renamed(json.loads(text)), indent=1) + "\n")
    else:
        print("\n".join(compare(Path(sys.argv[1]), Path(sys.argv[2]))))
