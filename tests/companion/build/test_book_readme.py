"""The README: its table is that of the book's first page, its picture is small."""

from __future__ import annotations

import pytest
from conftest import ROOT
from PIL import Image

from trexton.base.errors import TrextonError
from trexton.base.records import Record
from trexton.companion.build.prose import renewed_readme as renewed


def test_the_table_of_the_readme_has_the_numbers_of_the_records(tmp_path):
    text = (ROOT / "README.md").read_text()
    assert len(text.split()) <= 450
    error = {"value": 86.9, "low": 57.3, "high": 122.0}
    values = {"filter": {"mean_cm": error}, "knn": {"mean_cm": error | {"value": 33.4}}}
    Record("mocap_training", "cyberzoo", {}, values).save(tmp_path / "cyberzoo")
    held = {"value": 0.9051, "low": 0.88, "high": 0.93}
    field = {"field": {"mean_cm": error, "held": held}}
    Record("beyond", "cyberzoo", {}, field).save(tmp_path / "cyberzoo")
    old, new = text.splitlines(), renewed(text, tmp_path).splitlines()
    changed = {a: b for a, b in zip(old, new, strict=True) if a != b}
    assert len(changed) == 3  # the rows of the real flight; the kept runs are as they were
    paper, neighbors, better = changed.values()
    assert paper == "| the paper's filter | 86.9 [67.5, 106] cm | 86.9 [57.3, 122] cm |"
    assert neighbors.endswith("| 33.4 [57.3, 122] cm |")
    assert better.endswith("| 86.9 [57.3, 122] cm, 90 % region covers 91 % [88, 93] |")
    assert "1/256 m" in new[new.index(paper) - 2]  # beside every number of that flight
    with pytest.raises(TrextonError, match="put them back"):
        renewed("no marks", tmp_path)


@pytest.mark.skipif(not (ROOT / "results" / "cyberzoo").is_dir(), reason="no results: make book")
def test_the_readme_has_the_numbers_of_the_book():
    text = (ROOT / "README.md").read_text()
    advice = "python -m trexton.companion.build.prose renews it"
    assert renewed(text, ROOT / "results") == text, f"README.md has other numbers: {advice}"


def test_the_picture_of_the_readme_moves_and_is_small():
    path = ROOT / "book" / "_static" / "flight.webp"
    assert path.stat().st_size < 300_000 and Image.open(path).n_frames > 10
