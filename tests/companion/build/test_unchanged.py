"""A book of which nothing has changed is not made again; whatever it is made of counts."""

from __future__ import annotations

import os
import shutil

import pytest

from trexton.cli import main as cli
from trexton.companion.build import make, unchanged
from trexton.companion.build.display import Outcome
from trexton.companion.build.make import Prepared
from trexton.companion.cli import book

FILES = (
    "trexton/base/errors.py", "notebooks/fine.md", "book/intro.md", "data/paper/protocol.toml",
    "README.md", "environment.lock", "data/flights/sim-survey/flight.toml",
    "results/sim-survey/fine.json", "book/_build/html/index.html",
)  # fmt: skip


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder with a file of each kind, in which making a book writes what it found."""
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("as it was")
    (tmp_path / "book" / "_toc.yml").write_text("parts: []")
    shutil.copy(tmp_path / "book" / "_toc.yml", tmp_path / "book" / "_toc_quick.yml")
    made = []

    def experiments(pairs, results, **asked):
        made.append(asked)
        return [Outcome("sim-survey", "fine", "ran")]

    for module in (make, unchanged, book):
        monkeypatch.setattr(module, "repository_root", lambda: tmp_path)
    monkeypatch.setattr(make, "prepare_flights", lambda folder, quick: Prepared())
    monkeypatch.setattr(make, "run_experiments", experiments)
    monkeypatch.setattr(make, "_build", lambda contents, html: f"built {len(made)}")
    monkeypatch.setattr(make, "records_by_name", lambda results, outcomes: {})
    monkeypatch.setattr(make, "findings", lambda *_: [{"text": "It works.", "flight": ""}])
    monkeypatch.chdir(tmp_path)
    return tmp_path, made


def test_what_has_not_changed_is_said_and_not_made_again(clone, capsys):
    folder, made = clone
    assert cli.main(["book"]) == 0 and len(made) == 1
    (folder / "tests").mkdir()
    (folder / "tests" / "test_new.py").write_text("no part of the book")
    (folder / "trexton" / "__pycache__").mkdir()
    (folder / "trexton" / "__pycache__" / "x.pyc").write_text("nor this")
    capsys.readouterr()
    assert cli.main(["book"]) == 0 and len(made) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("Nothing has changed") and printed.endswith("- It works.\n")
    assert "open book/_build/html/index.html in a browser" in printed
    assert cli.main(["book", "--explain"]) == 0 and len(made) == 2, "reasons were asked for"
    assert cli.main(["book", "--set", "seed=2"]) == 0 and len(made) == 3
    assert cli.main(["book", "--quick"]) == 0 and len(made) == 4


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("how", ["written", "newer", "copied", "gone", "beside"])
def test_whatever_a_book_is_made_of_counts(clone, name, how):
    folder, made = clone
    cli.main(["book"])
    path = folder / name
    if how == "written":
        path.write_text("as it was not")
    elif how == "newer":
        os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))
    elif how == "copied":  # as rsync does: of the same size, its time kept
        before = path.stat().st_mtime_ns
        path.write_text("otherwise")
        os.utime(path, ns=(before, before))
    elif how == "gone":
        path.unlink()
    else:
        path.with_name("another").write_text("")
    cli.main(["book"])
    assert len(made) == 2


def test_the_environment_counts(clone, monkeypatch, tmp_path_factory):
    _, made = clone
    cli.main(["book"])
    monkeypatch.setenv("TREXTON_DATA", "elsewhere")
    assert cli.main(["book"]) == 0 and len(made) == 2
    site = tmp_path_factory.mktemp("site")
    monkeypatch.setattr(unchanged.sysconfig, "get_path", lambda name: str(site))
    assert cli.main(["book"]) == 0 and len(made) == 3
    assert cli.main(["book"]) == 0 and len(made) == 3
    (site / "numpy-9.dist-info").mkdir()
    assert cli.main(["book"]) == 0 and len(made) == 4


def test_code_that_a_person_edits_in_place_is_run_again(clone, monkeypatch, tmp_path_factory):
    _, made = clone
    monkeypatch.setenv("TREXTON_PLUGINS", "json")  # a module of one's own
    assert [cli.main(["book"]) for _ in "ab"] == [0, 0] and len(made) == 2
    monkeypatch.delenv("TREXTON_PLUGINS")
    site = tmp_path_factory.mktemp("site")
    monkeypatch.setattr(unchanged.sysconfig, "get_path", lambda name: str(site))
    (site / "__editable__.trexton-1.0.0.pth").touch()
    assert [cli.main(["book"]) for _ in "ab"] == [0, 0] and len(made) == 3
    (site / "_my_features.pth").touch()
    assert [cli.main(["book"]) for _ in "ab"] == [0, 0] and len(made) == 5


def test_links_are_followed_but_not_in_a_circle(clone, tmp_path_factory):
    folder, made = clone
    disk = tmp_path_factory.mktemp("disk")
    (disk / "quoted.toml").write_text("as it was")
    (folder / "data" / "quoted").symlink_to(disk)
    (disk / "back").symlink_to(folder)
    assert [cli.main(["book"]) for _ in "ab"] == [0, 0] and len(made) == 1
    (disk / "quoted.toml").write_text("as it was not")
    assert cli.main(["book"]) == 0 and len(made) == 2


def test_what_is_edited_while_a_book_is_made_is_in_the_next(clone, monkeypatch):
    folder, made = clone

    def edited(contents, html):
        (folder / "book" / "intro.md").write_text("written meanwhile")
        return "built"

    monkeypatch.setattr(make, "_build", edited)
    cli.main(["book"])
    assert cli.main(["book"]) == 0 and len(made) == 2


@pytest.mark.parametrize("why", ["failed", "absent"])
def test_a_book_that_is_not_whole_is_made_again(clone, monkeypatch, why):
    _, made = clone
    if why == "failed":
        outcomes = [Outcome("sim-survey", "fine", "failed", ("a fault",))]
        monkeypatch.setattr(make, "run_experiments", lambda *_, **asked: made.append(0) or outcomes)
    else:
        prepared = Prepared(absent={"cyberzoo": "no network"})
        monkeypatch.setattr(make, "prepare_flights", lambda folder, quick: prepared)
    cli.main(["book"])
    cli.main(["book"])
    assert len(made) == 2


@pytest.mark.parametrize("note", ["", "{", "[]", '{"inputs": 1}'])
def test_a_damaged_note_is_none(clone, note):
    folder, made = clone
    cli.main(["book"])
    (folder / "book" / "_build" / ".unchanged").write_text(note)
    assert cli.main(["book"]) == 0 and len(made) == 2
