"""What commands that run experiments say and hand on, the experiments themselves stood in for."""

from __future__ import annotations

import re
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import small_flight
from small_loop import make_flight

import trexton.companion.build.make
import trexton.companion.build.plan
from trexton.base.progress import set_quiet
from trexton.cli import main as cli
from trexton.companion.build.display import Display, Outcome
from trexton.companion.build.flight_pairs import load_pair
from trexton.companion.build.make import Made
from trexton.companion.experiments import assessment
from trexton.flights.writing import write_flight

OUTCOMES = [
    Outcome("room", "mocap_training", "ran", ("its code changed",), 2.0),
    Outcome("room", "map_loss", "reused", ("nothing changed",)),
    Outcome("room", "map_loss", "skipped", ("it needs images",)),
]


@pytest.fixture
def asked(monkeypatch):
    """What `run_experiments` was asked for; it answers with `OUTCOMES`."""
    seen = {}

    def stand_in(pairs, out, **options):
        seen.update(options, pairs=pairs, out=out)
        return OUTCOMES

    monkeypatch.setattr("trexton.companion.build.plan.run_experiments", stand_in)
    return seen


def test_run_hands_settings_on_and_says_why_one_was_left_out(asked, capsys):
    words = "run a b --out o --no-book --set particles=9 k=a=b --jobs 3".split()
    assert cli.main(words) == 0
    assert asked["settings"] == {"particles": "9", "k": "a=b"} and asked["jobs"] == 3
    assert [pair.flight for pair in asked["pairs"]] == ["a", "b"]
    told = capsys.readouterr().out.splitlines()
    assert told[-1] == "1 ran, 1 reused, 1 skipped"
    assert "        it needs images" in told and "        its code changed" not in told
    assert cli.main([*words, "--explain"]) == 0
    assert "        its code changed" in capsys.readouterr().out


def test_run_makes_a_small_book_of_what_there_is(asked, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(
        trexton.companion.build.make, "build_small_book", lambda *given: f"book of {given[2]}"
    )
    assert cli.main(["run", "a", "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.endswith(f"book of {tmp_path}\n")
    monkeypatch.setattr(
        sys.modules[__name__], "OUTCOMES", [Outcome("room", "x", "failed", ("no",))]
    )
    assert cli.main(["run", "a", "--out", "o"]) == 1
    said = capsys.readouterr()
    assert "book" not in said.out and said.out == "1 failed\n"
    assert said.err.splitlines()[-1] == "        no"  # where other programs look for errors


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["a", "b", "--test-flight", "c"], "--test-flight belongs to one flight"),
        (["a", "--no-book", "--set", "particles"], "--set 'particles': expected key=value"),
        (["a", "--set", "=3"], "--set '=3': expected key=value"),
        (["a", "--set", "seed=1", "k=2", "--set", "seed=1"], "--set has seed twice, '1' and '1'"),
    ],
)
def test_run_refuses_what_has_no_meaning(asked, capsys, words, told):
    assert cli.main(["run", "--out", "o", *words]) == 1
    assert told in capsys.readouterr().err and not asked


def test_book_prints_what_it_made_and_found_and_fails_with_an_experiment(monkeypatch, capsys):
    made = Made(Path("book/index.html"), ["the flight is absent"], ["It works."], list(OUTCOMES))
    asked = {}
    monkeypatch.setattr(
        "trexton.companion.build.make.make_book", lambda **given: asked.update(given) or made
    )
    monkeypatch.setattr("trexton.companion.cli.book.Unchanged.last", lambda _: None)
    assert cli.main(["book", "--set", "repeats=2", "--jobs", "2"]) == 0
    assert asked == {"settings": {"repeats": "2"}, "jobs": 2, "quick": False}
    told = capsys.readouterr().out
    assert "the flight is absent\n" in told and told.endswith("- It works.\n")
    assert "open book/index.html in a browser" in told
    made.outcomes.append(Outcome("room", "light", "failed"))
    assert cli.main(["book"]) == 1


def test_report_splits_a_flight_without_splits_and_writes_the_page(tmp_path, monkeypatch, capsys):
    flight = make_flight(1)
    lost = np.isin(np.arange(120), (20, 21, 100))[:, None]
    write_flight(replace(flight, position=flight.position + 50 * lost), tmp_path / "loop")

    ran = []

    def stand_in(pairs, out, *, only, settings):
        assert only == ("assessment",)
        ran.append(pairs)
        train, test = load_pair(pairs[0].flight, None)
        options = assessment.Parameters(methods=settings["assessment.methods"])
        assessment.run(train, test, options).save(out / pairs[0].name)
        return [Outcome(pairs[0].name, "assessment", "ran")]

    monkeypatch.setattr(trexton.companion.build.plan, "run_experiments", stand_in)
    out = tmp_path / "out"
    words = ["report", str(tmp_path / "loop"), "--no-book", "--methods", "paper"]
    assert cli.main([*words, "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "frames 0 to 71 train, the later ones test, 120 in all" in said.err
    assert said.out.endswith(f"{out / 'report.html'}\n")
    assert "the method `paper`" in said.out
    page = (out / "report.html").read_text("utf-8")
    assert page.rstrip().endswith("</html>") and "Mend the flight first" in page
    for doubt in ("2 positions lie where none can be flown to", "1 position lies where none can"):
        assert f"warning  loop: {doubt}" in said.out and f"<li>loop: {doubt}" in page

    # Nothing has changed: all is said again and nothing made, until a file is another.
    assert cli.main([*words, "--out", str(out)]) == 0 and len(ran) == 1
    before, again = said.out.splitlines(), capsys.readouterr().out.splitlines()
    assert again[0] == "Nothing has changed since the report was made."
    assert set(again[1:]) == {line for line in before if not re.match(r"(1 )?ran\b", line)}
    for path in (out / "report.html", next((tmp_path / "loop").iterdir())):
        path.write_bytes(path.read_bytes())
        assert cli.main([*words, "--out", str(out)]) == 0
    assert len(ran) == 3
    capsys.readouterr()

    failed = [Outcome("loop", "assessment", "failed", ("oops",))]
    monkeypatch.setattr(trexton.companion.build.plan, "run_experiments", lambda *_, **__: failed)
    write_flight(small_flight(), tmp_path / "small")
    again = ["report", str(tmp_path / "small"), "--no-book", "--out", str(tmp_path / "again")]
    assert cli.main(again) == 1
    assert capsys.readouterr().err.endswith("        oops\n")
    assert not (tmp_path / "again").exists()  # it has its splits, and nothing to show


@pytest.mark.parametrize(
    ("methods", "told"),
    [("", "no methods to compare"), ("paper,field", "'paper,field' is unknown")],
)
def test_report_refuses_methods_before_anything_is_touched(tmp_path, capsys, methods, told):
    write_flight(small_flight(), tmp_path / "room")
    words = ["report", str(tmp_path / "room"), "--no-book", "--methods", methods]
    assert cli.main([*words, "--out", str(tmp_path / "out")]) == 1
    assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_report_makes_its_book_of_the_pages_that_were_asked_for(tmp_path, monkeypatch, capsys):
    train, test = make_flight(1), make_flight(2)
    write_flight(train, tmp_path / "loop")
    write_flight(test, tmp_path / "other")

    def stand_in(pairs, out, *, only, **_):
        assert pairs[0].test_flight == str(tmp_path / "other")
        assert {"map_loss", "assessment"} < set(only)
        said = ""
        while "always guessing the centre" not in said:  # the verdict waits for no page
            said += capsys.readouterr().out
            time.sleep(0.01)
        assessment.run(train, test, assessment.Parameters()).save(out / pairs[0].name)
        return [Outcome(pairs[0].name, name, status)
                for name, status in (("map_loss", "failed"), ("assessment", "reused"))]  # fmt: skip

    monkeypatch.setattr(trexton.companion.build.plan, "run_experiments", stand_in)
    monkeypatch.setattr(
        trexton.companion.build.make, "build_small_book", lambda *given: f"book of {given[2]}"
    )
    words = ["report", str(tmp_path / "loop"), "--test-flight", str(tmp_path / "other")]
    assert cli.main([*words, "--out", str(tmp_path / "out")]) == 0
    assert f"book of {tmp_path / 'out'}\n" in capsys.readouterr().out


def test_a_line_tells_of_each_that_ran_and_quiet_of_none(capsys):
    display = Display()
    display.finished(OUTCOMES[1])
    display.finished(OUTCOMES[0])
    assert capsys.readouterr().err.strip() == str(OUTCOMES[0])
    set_quiet(True)
    display.finished(OUTCOMES[0])
    assert capsys.readouterr().err == ""


def test_training_says_what_is_wrong_with_the_flight_before_it_teaches(tmp_path, capsys):
    flight = make_flight(1)
    lost = np.isin(np.arange(120), (20, 21, 100))[:, None]
    write_flight(replace(flight, position=flight.position + 50 * lost), tmp_path / "lost")
    words = ["-o", str(tmp_path / "a.npz"), "--method", "paper"]
    assert cli.main(["train", str(tmp_path / "lost"), *words]) == 0
    assert "warning  3 positions lie where none can be flown to" in capsys.readouterr().err
    write_flight(replace(flight, position=1000 * flight.position + 5000), tmp_path / "mm")
    assert cli.main(["train", str(tmp_path / "mm"), "-o", str(tmp_path / "b.npz")]) == 1
    assert "120 of 120 positions far from its area_m" in capsys.readouterr().err
    assert not (tmp_path / "b.npz").exists()


def test_a_map_replaces_a_map_and_nothing_else(flight_folder, tmp_path, capsys):
    notes, output = tmp_path / "notes.npz", tmp_path / "map.npz"
    np.savez(notes, mine=np.arange(3))
    words = ["train", str(flight_folder), "--method", "paper", "-o"]
    before = notes.read_bytes()
    assert cli.main([*words, str(notes)]) == 1 and notes.read_bytes() == before
    assert "is a file that is no map: give another name" in capsys.readouterr().err
    output.touch()
    assert cli.main([*words, str(output)]) == cli.main([*words, str(output)]) == 0


def test_a_picture_has_no_layout(tmp_path, capsys):
    words = ["simulate", "--out", str(tmp_path / "f"), "--floor", "p.png", "--layout", "carpet"]
    assert cli.main(words) == 1 and not (tmp_path / "f").exists()
    assert "--layout and --floor-seed are of a painted hall" in capsys.readouterr().err


def test_a_flight_of_rare_frames_makes_a_map_that_nobody_judged(tmp_path, capsys):
    """No left-out part had a frame: training ended in a traceback."""
    flight = make_flight(1)
    write_flight(replace(flight, time=500 * np.arange(len(flight))), tmp_path / "slow")
    words = ["train", str(tmp_path / "slow"), "-o", str(tmp_path / "a.npz"), "--method", "paper"]
    assert cli.main(words) == 0
    assert "its frames are too rare" in capsys.readouterr().err
