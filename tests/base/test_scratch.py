"""Folders of the system's temporary ones, and texts that a terminal would obey."""

from __future__ import annotations

import subprocess

from trexton.base.files import atomic_file, scratch_folder
from trexton.base.progress import shown
from trexton.cli.main import main


def test_the_next_scratch_folder_removes_what_a_killed_process_left(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    dead = subprocess.Popen(["true"])
    dead.wait()
    left = tmp_path / f".trexton-floor.new-{dead.pid}.x"
    left.mkdir()
    with scratch_folder("floor") as folder:
        assert folder.parent == tmp_path and not left.exists()
    assert not folder.exists()


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "far").mkdir()
    (link := tmp_path / "map.npz").symlink_to(tmp_path / "far" / "map.npz")
    with atomic_file(link) as stream:
        stream.write("new")
    assert link.is_symlink() and (tmp_path / "far" / "map.npz").read_text() == "new"


def test_codes_are_shown_and_not_obeyed(tmp_path, capsys):
    assert shown("5\xa0cm\n\x1b[2J\x9b") == "5\xa0cm\n\\x1b[2J\\x9b"
    flight = tmp_path / "f\x1b]0;OWNED\x07"
    flight.mkdir()
    (flight / "flight.toml").write_text(
        'name = "a\\u001b[2J"\nnotes = ["\\u001b]0;OWNED\\u0007"]\n'
    )
    main(["check", str(flight)])
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err and "\\x1b" in said.out + said.err
