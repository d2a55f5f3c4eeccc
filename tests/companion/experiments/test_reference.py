"""Kept records of long runs: the pages that show them still can, whatever else has changed."""

from __future__ import annotations

import json
import re
import tomllib
from importlib import import_module

import jupytext
import pytest
from conftest import ROOT, small_flight

from trexton.base.records import Record
from trexton.companion.build import notebook
from trexton.companion.experiments import suitability
from trexton.companion.experiments.trade_off import run as fly_trade_off

PAGES = {
    path.stem: path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "notebooks").glob("*.md"))
    if re.search(r"notebook\.(reference|swept)\(", path.read_text(encoding="utf-8"))
}

SMALL = {"trade_off": {"repeats": 1, "stored": 1000}}


def kept_record(name: str, given: notebook.Given) -> Record:
    """In place of the page's own run: nothing is flown here."""
    if name == "trade_off":
        return fly_trade_off(small_flight(), small_flight(), given.parameters)
    if name != "suitability":
        record = notebook.reference(name)
        assert record is not None
        return record
    floors = suitability.kept_rows(notebook.swept(name))
    validation = suitability.validation(floors.values(), 1)
    values = {"floors": floors, "validation": validation}
    return given.parameters.record(given.train, values=values)


@pytest.mark.parametrize("name", PAGES)
def test_the_page_can_show_what_is_kept(name, tmp_path, monkeypatch):
    """Its own cells are run, with the kept record as that of this run too."""
    module = import_module(f"trexton.companion.experiments.{name}")
    monkeypatch.setattr(notebook.Given, "_pair", (small_flight(), small_flight()))
    monkeypatch.setattr(notebook.Page, "show", lambda page, name, figure: figure.canvas.draw())
    monkeypatch.setattr(module, "run", lambda *given: kept_record(name, names["given"]))
    names = {"display": lambda shown: shown}
    for cell in jupytext.reads(PAGES[name], "md:myst").cells:
        if cell.cell_type != "code":
            continue
        if "figure" in cell.metadata.get("mystnb", {}):  # which one picture fits, and no words
            assert not re.search(r"notebook\.(reference|swept)\(", cell.source)
        exec(compile(cell.source, f"{name}.md", "exec"), names)
        if "parameters" in cell.metadata.get("tags", ()):
            names["out"] = str(tmp_path)
            names |= SMALL.get(name, {})
    assert names.get("reference") or names.get("kept")


def test_every_kept_record_of_a_page_is_shown():
    files = {path.stem for path in (ROOT / "data" / "reference").glob("*.json")}
    named = re.findall(r"notebook\.reference\(\"(.+?)\"\)", "".join(PAGES.values()))
    swept = re.findall(r"notebook\.swept\(\"(.+?)\"\)", "".join(PAGES.values()))
    prose = (ROOT / "book" / "onboard.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"kept\.(\w+)", prose))
    assert files == {*named, *shown, *(f"sweep-{name}" for name in swept)}


def test_a_kept_sweep_is_that_of_its_plan():
    """What the page says of its settings is what the plan says."""
    for kept in sorted((ROOT / "data" / "reference").glob("sweep-*.json")):
        rows = json.loads(kept.read_text(encoding="utf-8"))["rows"]
        plan = ROOT / "data" / "sweeps" / f"{kept.stem.removeprefix('sweep-')}.toml"
        planned = tomllib.loads(plan.read_text(encoding="utf-8"))["set"]
        for name, values in planned.items():
            assert {row[name] for row in rows} <= set(values), f"{kept.name}: {name}"
