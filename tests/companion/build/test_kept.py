"""Kept results of long runs say on their page when other code made them."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import pytest
from conftest import ROOT, small_flight

from trexton.base.cache import code_hashes
from trexton.base.records import Record
from trexton.companion.build import notebook as kept
from trexton.companion.build import prose
from trexton.companion.experiments import density
from trexton.companion.provenance import made_by

MODULE = "trexton.companion.experiments.density"


@pytest.fixture
def page(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(kept, "kept_results", lambda: sorted(tmp_path.glob("*.json")))
    monkeypatch.setattr(kept, "display", lambda html: shown.append(html.data))
    return shown


def test_a_record_carries_commit_and_code():
    made = made_by(MODULE)
    assert "numpy" in made["versions"] and len(made["code"]) == 64
    if (ROOT / ".git").exists():
        said = subprocess.run(["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True)
        assert made["commit"] == said.stdout.decode().strip()
    assert made_by("trexton.companion.experiments.rooms")["code"] != made["code"]
    assert "trexton.companion.experiments.style" in code_hashes(MODULE)


def test_a_record_of_this_code_is_shown_without_a_word(page, tmp_path):
    record = Record("density", "room", {}, {"a": 1}, provenance=made_by(MODULE))
    record.save(tmp_path)
    assert kept.reference("density").values == {"a": 1} and page == []
    assert (
        density.Parameters().record(flight(), values={}).provenance["code"]
        == (record.provenance["code"])
    )


@pytest.mark.parametrize("made", [{}, {"code": "0" * 64, "commit": "abcdef0123456789"}])
def test_a_record_of_other_code_says_so(page, tmp_path, made):
    Record("density", "room", {}, {"a": 1}, provenance=made).save(tmp_path)
    assert kept.reference("density").values == {"a": 1}
    at = "at commit abcdef012345" if made else "at a commit it does not name"
    assert len(page) == 1 and f"density was made by other code, {at}. <code>make full" in page[0]


def test_so_does_a_table_of_a_sweep(page, tmp_path):
    (tmp_path / "sweep-x.json").write_text(json.dumps({"experiment": "density", "rows": []}))
    assert kept.swept("x")["rows"] == [] and "sweep-x was made by other code" in page[0]
    (tmp_path / "sweep-y.json").write_text(json.dumps({"experiment": "density"} | made_by(MODULE)))
    assert kept.swept("y") and len(page) == 1
    assert kept.swept("z") is None and kept.reference("z") is None


def test_a_page_of_prose_says_it_of_every_record(tmp_path, monkeypatch):
    monkeypatch.setattr(prose, "kept_results", lambda: sorted(tmp_path.glob("*.json")))
    made = made_by(MODULE, "trexton.onboard.loop")
    assert made["code"] != made_by(MODULE)["code"]
    for name, code in (("same", made["code"]), ("other", "0" * 64)):
        named = made | {"modules": [MODULE, "trexton.onboard.loop"], "code": code}
        Record(name, "room", {}, {}, provenance=named).save(tmp_path)
    Record("density", "room", {}, {}, provenance={}).save(tmp_path)
    records = prose.kept_records()
    assert "density was made by other code" in records["density"]["stale"]
    assert records["same"]["stale"] == "" and "other was made by" in records["other"]["stale"]


def flight():
    return replace(small_flight(), name="room")
