"""The README and what to cite: its table is that of the numbers kept, its picture is small."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

from trexton.base.errors import TrextonError
from trexton.base.records import Record
from trexton.companion.build.readme import (
    is_current,
    kept_numbers,
    moving_picture,
    results_table,
    with_table,
)


def test_the_table_of_the_readme_is_that_of_the_numbers_kept():
    text = (ROOT / "README.md").read_text()
    kept = json.loads((ROOT / "data" / "reference" / "readme.json").read_text())
    assert with_table(text, results_table(kept)) == text
    assert {"cyberzoo", "floors"} == set(kept) and len(text.split()) <= 450


def test_the_picture_of_the_readme_moves_and_is_small():
    path = ROOT / "book" / "_static" / "flight.webp"
    assert path.stat().st_size < 300_000 and Image.open(path).n_frames > 10


def test_numbers_are_kept_with_their_provenance(tmp_path):
    error = {"value": 86.9, "low": 57.3, "high": 122.0}
    values = {"filter": {"mean_cm": error}, "knn": {"mean_cm": error | {"value": 33.4}}}
    Record("mocap_training", "cyberzoo", {"seed": 3}, values, provenance={"of": "a test"}).save(
        tmp_path / "cyberzoo"
    )
    kept = kept_numbers(tmp_path)
    assert kept["cyberzoo"]["from"]["mocap_training"]["provenance"] == {"of": "a test"}
    table = results_table(kept)
    lines = table.splitlines()
    assert "1/256 m" in lines[0]  # beside every number of that flight
    assert lines[2].startswith("| the paper's filter | 86.9 cm [67.5, 106] | 86.9 cm [57.3, 122] |")
    assert [line.split(" | ")[0] for line in lines[2:]] == [
        "| the paper's filter", "| its neighbours alone", "| `field`", "| `field`, with a velocity",
        "| `fine`, which registers images",
    ]  # fmt: skip
    readme = tmp_path / "README.md"
    readme.write_text(
        "<!-- results: python -m trexton.companion.build.readme -->\n<!-- end of results -->\n"
    )
    assert not is_current(readme, tmp_path) and is_current(readme, tmp_path / "nothing")
    readme.write_text(with_table(readme.read_text(), table))
    assert is_current(readme, tmp_path)
    with pytest.raises(TrextonError, match="make book first"):
        kept_numbers(tmp_path / "nothing")
    with pytest.raises(TrextonError, match="put them back"):
        with_table("no marks", table)


def test_a_flight_without_pictures_moves_too():
    frame = {"time_s": 0.0, "truth_cm": [100, 100], "particles_cm": [[90, 100]], "image": None,
             "estimates_cm": {"a": [120, 100]}, "errors_cm": {"a": 20}}  # fmt: skip
    frames = [frame | {"truth_cm": [100 + 5 * i, 100]} for i in range(4)]
    data = moving_picture({"frames": frames, "area": [0, 3, 0, 3], "floor": None})
    picture = Image.open(io.BytesIO(data))
    assert picture.n_frames == 4
    first = np.asarray(picture.convert("RGB")).copy()
    picture.seek(3)
    assert (first != np.asarray(picture.convert("RGB"))).any()
