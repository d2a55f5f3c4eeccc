"""What is made of a log: the replay."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest
from onboard_tools import make_fix

from trexton.cli.main import main
from trexton.onboard.sinks.files import JsonLines
from trexton.onboard.tally import flush, say


@pytest.fixture
def log(tmp_path) -> Path:
    sink = JsonLines(f"{tmp_path}/log", events=True)
    sink.open()
    sink.write(make_fix(1.0, (1.5, 2.5)))
    sink.event({"time_s": 1.1, "event": "answer", "command": 21, "result": 2})
    sink.event({"time_s": 1.1, "event": "status", "line": "not repeated"})
    sink.write(make_fix(2.0, (9.0, 9.0), lost=True))
    sink.write(make_fix(3.0, (1.0, 1.0), fault="dark", observed=False))
    sink.write(make_fix(4.0, (3.0, 3.5), resets=1))
    sink.close()
    return tmp_path / "log"


def test_what_was_usable_stands_beside_what_was_answered(log, capsys):
    assert main(["replay", str(log)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "usable x 1.50 y 2.50" in lines[0] and "answer: command 21, result 2" in lines[0]
    assert "silence: lost" in lines[1] and "usable x 3.00 y 3.50" in lines[2]
    assert "reset 1: the position jumped" in lines[3]
    assert "no end: the log is broken off, or still written" in lines[4]
    assert lines[5] == "fixes 4, usable 2, event answer 1, event status 1, fault dark 1"


def test_a_log_may_come_through_a_pipe(log, tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=(tmp_path / "pipe").write_bytes, args=[log.read_bytes()])
    writer.start()
    assert main(["replay", str(tmp_path / "pipe")]) == 0
    writer.join()
    assert capsys.readouterr().out.splitlines()[-1].startswith("fixes 4, usable 2, event answer 1")


def test_a_mark_that_an_editor_put_before_a_log_costs_no_line(log, capsys):
    log.write_bytes(b"\xef\xbb\xbf" + log.read_bytes())
    assert main(["replay", str(log)]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("fixes 4, usable 2")


def test_what_an_autopilot_says_commands_no_terminal(log, capsys):
    said = {"event": "autopilot says", "text": "\x1b[2Jlanded\n9.99  forged"}
    odd = {"event": "\x1b]0;x\x07", "\x1b[1m": "bold"}
    with open(log, "a", encoding="utf-8") as stream:
        stream.writelines(json.dumps(event) + "\n" for event in (said, odd))
    say(f"trexton onboard: {said['text']}")
    flush()
    assert main(["replay", str(log)]) == 0
    printed = capsys.readouterr()
    assert r"text \x1b[2Jlanded\n9.99  forged" in printed.out
    assert r"trexton onboard: \x1b[2Jlanded\n9.99  forged" in printed.err.splitlines()
    assert "\x1b" not in printed.out + printed.err and "\x07" not in printed.out


@pytest.mark.parametrize("half", [b'{"time_s": 5.0, "fra', b"\0\0\0", b"\xff\xfe", b"[1, 2]"])
def test_what_a_loss_of_power_left_is_told_and_the_rest_is_read(half, log, capsys):
    sink = JsonLines(f"{log}2", events=True)
    sink.open()
    sink.write(make_fix(6.0, (0.5, 0.5)))
    sink.event({"time_s": 6.1, "event": "answer", "command": 21, "result": 0})
    sink.event({"time_s": 6.2, "event": "end", "frames": 1})
    sink.close()
    log.write_bytes(log.read_bytes() + half + b"\n" + Path(f"{log}2").read_bytes())
    assert main(["replay", str(log)]) == 0
    *_, damaged, answer, _, counts = capsys.readouterr().out.splitlines()
    assert "damaged line: number 7, why" in damaged
    assert "usable x 0.50 y 0.50" in answer and "result 0" in answer
    assert counts.startswith("fixes 5, usable 3, event answer 2") and "damaged line 1" in counts


@pytest.mark.parametrize("text", ["not json\n", "[1, 2]\n"])
def test_another_file_gets_a_sentence(text, tmp_path, capsys):
    (tmp_path / "other").write_text(text)
    assert main(["replay", str(tmp_path / "other")]) == 1
    assert "line 1 is none of a log" in capsys.readouterr().err
    assert main(["replay", str(tmp_path / "none")]) == 1
    assert "No such file" in capsys.readouterr().err
    (tmp_path / "empty").touch()
    assert main(["replay", str(tmp_path / "empty")]) == 1
    assert "empty: give what --log wrote" in capsys.readouterr().err
