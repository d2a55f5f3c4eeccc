"""An RO-Crate of what a run left: records, data hashes, environment, code and book in one zip.

``make crate`` writes ``results/trexton-crate.zip`` and reads it back. Every file has its SHA-256,
and every record says which code and which data made it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from rocrate.model.contextentity import ContextEntity
from rocrate.rocrate import ROCrate

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = (
    "README.md", "LICENSE", "CITATION.cff", "codemeta.json", "codecheck.yml", "environment.lock",
    "pyproject.toml", "data/registry.toml",
)  # fmt: skip


def write(results: Path, book: Path, out: Path) -> Path:
    """The crate of a folder of results, and of the built book where it is there."""
    crate = ROCrate()
    crate.name = "trexton: results"
    crate.description = "Records of every experiment, with the code, data hashes and environment."
    licence = {"@type": "CreativeWork", "name": "MIT"}
    crate.license = crate.add(ContextEntity(crate, "https://spdx.org/licenses/MIT", licence))
    authors = json.loads((ROOT / "codemeta.json").read_text())["author"]
    crate.creator = [
        crate.add(ContextEntity(crate, f"#author-{number}", each))
        for number, each in enumerate(authors)
    ]
    for name in DOCUMENTS:
        _add(crate, ROOT / name, name)
    records = sorted(results.rglob("*.json"))
    for path in records:
        record, place = json.loads(path.read_text()), path.relative_to(results)
        if "schema" in record:
            made = {"about": record["experiment"], "isBasedOn": json.dumps(record["provenance"])}
            _add(crate, path, f"results/{place}", **made)
    for path in sorted(book.rglob("*")) if book.is_dir() else ():
        if path.is_file():
            _add(crate, path, f"book/{path.relative_to(book)}")
    with tempfile.TemporaryDirectory() as folder:
        code = Path(folder) / "code.zip"
        archive = ["git", "-C", str(ROOT), "archive", "--format=zip", "-o", str(code), "HEAD"]
        subprocess.run(archive, check=True)
        _add(crate, code, "code.zip")
        out.parent.mkdir(parents=True, exist_ok=True)
        crate.write_zip(out)
    return out


def _add(crate: ROCrate, path: Path, name: str, **properties: str) -> None:
    sha = hashlib.sha256(path.read_bytes()).hexdigest()
    size = str(path.stat().st_size)
    crate.add_file(
        path, name, properties={"sha256": sha, "contentSize": size, "name": name} | properties
    )


def faults(out: Path) -> list[str]:
    """What is wrong with a crate, a line each; rocrate itself refuses one that is none."""
    wrong = []
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(out) as archive:
            archive.extractall(folder)
        crate = ROCrate(folder)
        named = {entity.id: entity for entity in crate.data_entities}
        for name, entity in named.items():
            path = Path(folder) / name
            if not path.is_file():
                wrong.append(f"{name} is missing")
            elif hashlib.sha256(path.read_bytes()).hexdigest() != entity.get("sha256"):
                wrong.append(f"{name} is not the file that was described")
        if not any(name.startswith("results/") for name in named):
            wrong.append("it holds no record: run the experiments first")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, default=ROOT / "results")
    parser.add_argument("--book", type=Path, default=ROOT / "book" / "_build" / "html")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trexton-crate.zip")
    chosen = parser.parse_args()
    made = write(chosen.results, chosen.book, chosen.out)
    found = faults(made)
    print("\n".join(found) or f"{made}: {made.stat().st_size / 1e6:.1f} MB, whole")
    sys.exit(bool(found))
