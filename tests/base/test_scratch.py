"""Folders of the system's temporary ones, and texts that a terminal would obey."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from trexton.base.progress import shown
from trexton.cli.main import main
from trexton.companion.experiments.floors import scratch_folder


def test_the_next_scratch_folder_removes_what_a_killed_process_left(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    dead = subprocess.Popen(["true"])
    dead.wait()
    left = tmp_path / f".trexton-floor.new-{dead.pid}.x"
    left.mkdir()
    with scratch_folder("floor") as folder:
        assert folder.parent == tmp_path and not left.exists()
    assert not folder.exists()


def test_codes_are_shown_and_not_obeyed(tmp_path, capsys):
    assert shown("5\xa0cm\n\x1b[2J\x9b") == "5\xa0cm\n\\x1b[2J\\x9b"
    flight = tmp_path / "f\x1b]0;OWNED\x07"
    flight.mkdir()
    (flight / "flight.toml").write_text(
        'name = "a\\u001b[2J"\nnotes = ["\\u001b]0;OWNED\\u0007"]\n'
    )
    main(["check", str(flight)])
    for words in (
        ["check", "here", str(flight)],
        [f"\x1b{flight}"],
        ["check", "--odd\x1b[2J", "f"],
    ):
        with pytest.raises(SystemExit):
            main(words)
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err and "\\x1b" in said.out + said.err


def test_a_name_of_two_lines_is_one_line(tmp_path, capsys):
    flight = tmp_path / "f\nf: usable (0 faults, 0 warnings)"
    flight.mkdir()
    (flight / "flight.toml").write_text("name = 'a'\n")
    main(["check", str(flight)])
    said = capsys.readouterr().out.splitlines()
    assert said and not [line for line in said if line.startswith("f: usable")]
    main(["train", str(flight), "-o", str(tmp_path / "m.npz")])
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_verb_that_is_terminated_removes_its_own(tmp_path):
    code = (
        "import sys, time\nfrom trexton.companion.experiments.floors import scratch_folder\n"
        "from trexton.cli import check, main\n"
        "def works(arguments):\n"
        "    with scratch_folder('floor'):\n"
        "        print('begun', file=sys.stderr, flush=True)\n"
        "        time.sleep(60)\n"
        "check.run = works\nsys.exit(main.main(['check', 'flight']))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], env=os.environ | {"TMPDIR": str(tmp_path)},
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr.readline() == "begun\n" and any(tmp_path.iterdir())
    process.terminate()
    assert process.communicate()[1] == "trexton check: interrupted\n"
    assert process.returncode == 143 and not any(tmp_path.iterdir())
