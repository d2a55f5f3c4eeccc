"""Where positions go: files, and what happens when they cannot be written."""

from __future__ import annotations

import csv
import json
import os
import resource
import subprocess
import sys

import numpy as np
import pytest
from onboard_tools import Clock, make_fix, surroundings

from trexton.base.errors import ParameterError
from trexton.onboard.sinks import Guard, Sink, open_sink
from trexton.onboard.sinks.files import JsonLines
from trexton.onboard.tally import Tally

FIXES = [
    make_fix(0.08, (1.25, -2.5), number=1, latency=0.002),
    make_fix(0.16, (1.5, -2.5), number=2, lost=True, resets=1),
    make_fix(0.24, (np.nan, 0), number=3, fault="dark", observed=False),
]


def write(address: str, fixes=FIXES) -> Tally:
    tally = Tally()
    guard = Guard(open_sink(address, surroundings(tally)), tally)
    for fix in fixes:
        guard.write(fix)
    guard.close()
    return tally


def test_json_lines(tmp_path):
    write(f"json:{tmp_path}/a.jsonl")
    rows = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [(row["time_s"], row["frame"], row["x_m"], row["y_m"]) for row in rows] == [
        (0.08, 1, 1.25, -2.5), (0.16, 2, 1.5, -2.5), (0.24, 3, None, 0.0),
    ]  # fmt: skip
    assert rows[0]["covariance_m2"] == [0.04, 0.0, 0.09]
    assert (rows[0]["std_x_m"], rows[0]["std_y_m"]) == pytest.approx((0.2, 0.3))
    assert [row["lost"] for row in rows] == [False, True, False]
    assert rows[2]["fault"] == "dark" and not rows[2]["observed"]


def test_csv(tmp_path):
    write(f"csv:{tmp_path}/a.csv")
    with open(tmp_path / "a.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["x_m"] for row in rows] == ["1.25", "1.5", ""]
    assert [(row["lost"], row["observed"], row["fault"]) for row in rows] == [
        ("0", "1", ""),
        ("1", "1", ""),
        ("0", "0", "dark"),
    ]


def test_tum_holds_only_what_a_vehicle_may_steer_by(tmp_path):
    write(f"tum:{tmp_path}/a.tum")
    assert (tmp_path / "a.tum").read_text() == "0.080000 1.250000 -2.500000 0 0 0 0 1\n"


def test_events_go_into_the_log_only(tmp_path):
    for events in (True, False):
        sink = JsonLines(f"{tmp_path}/{events}", events=events)
        sink.open()
        sink.event({"event": "answer", "result": np.int64(0)})
        sink.close()
    assert json.loads((tmp_path / "True").read_text()) == {"event": "answer", "result": 0}
    assert (tmp_path / "False").read_text() == ""


@pytest.mark.parametrize(
    "address",
    [
        "xml:a",
        "csv:/no/such/folder/a.csv",
        "udpout:14550",
        "udpin:host:port",
        "udpout:h:99999",
        "serial:",
        "serial:/dev/x:12345",
    ],
)
def test_wrong_addresses_are_errors_with_a_sentence(address):
    with pytest.raises(ParameterError, match="give"):
        open_sink(address, surroundings())


class Failing(Sink):
    """Fails while told to."""

    name = "failing"

    def __init__(self):
        self.fails, self.opened, self.closed, self.written = True, 0, 0, []

    def open(self):
        self.opened += 1

    def write(self, fix):
        if self.fails:
            raise OSError(28, "No space left on device")
        self.written.append(fix.number)

    def close(self):
        self.closed += 1


def test_guard_backs_off_and_comes_back():
    tally, clock, sink = Tally(), Clock(), Failing()
    guard = Guard(sink, tally, clock)
    for _ in range(40):  # pauses of 1, 2, 4 and 8 s fit in 20
        guard.write(FIXES[0])
        clock.now += 0.5
    assert tally["output"] == sink.opened == sink.closed == 5
    sink.fails = False
    clock.now += 30
    guard.write(FIXES[1])
    assert sink.written == [2] and tally["output"] == 5
    guard.close()
    assert sink.closed == 6


def test_a_full_disk_is_counted_and_the_rest_goes_on(tmp_path):
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full to stand for a full disk")
    assert write("json:/dev/full")["output"] == 1
    assert write(f"json:{tmp_path}/fine")["output"] == 0


@pytest.mark.parametrize("standard", [False, True])
def test_a_disk_that_fills_up_in_the_middle_of_a_line_leaves_whole_lines_once_there_is_room(
    standard, tmp_path
):
    code = f"""
import resource, signal
from trexton.onboard.sinks.files import JsonLines
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
file = JsonLines({"-" if standard else str(tmp_path / "log")!r})
file.open()
resource.setrlimit(resource.RLIMIT_FSIZE, (25, {resource.RLIM_INFINITY}))
file.add("first line")
try:
    file.add("a second line that does not fit")
except OSError:
    pass
resource.setrlimit(resource.RLIMIT_FSIZE, ({resource.RLIM_INFINITY}, {resource.RLIM_INFINITY}))
file.add("third line")
"""
    with open(tmp_path / "log", "wb") as stdout:  # as a shell does it: not for adding
        subprocess.run([sys.executable, "-c", code], check=True, stdout=stdout)
    assert (tmp_path / "log").read_bytes() == b"first line\nthird line\n"


@pytest.mark.parametrize("kind", ["csv", "json", "tum"])
def test_what_the_file_held_before_is_moved_aside(tmp_path, kind):
    path = tmp_path / "positions"
    path.write_text("of yesterday")
    write(f"{kind}:{path}")
    write(f"{kind}:{path}")
    assert (tmp_path / "positions.1").read_text() == "of yesterday"
    assert (tmp_path / "positions.2").read_text() == path.read_text() != ""


def test_a_link_to_a_file_stays_one_and_a_folder_of_others_is_no_fault(tmp_path, monkeypatch):
    """An exchange that the folder forbids would have cost the whole log."""
    there, path = tmp_path / "there", tmp_path / "positions"
    there.write_text("of yesterday")
    path.symlink_to(there)
    write(f"json:{path}")
    assert path.is_symlink() and (tmp_path / "there.1").read_text() == "of yesterday"

    def refuse(old, new):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "rename", refuse)
    before = there.read_text()
    write(f"json:{path}")
    assert there.read_text().startswith(before) and len(there.read_text()) > len(before)


def test_a_reader_that_went_away_or_does_not_read_is_an_error_and_no_wait(monkeypatch):
    reader, writer = os.pipe()

    class Out:
        def flush(self): ...

        def fileno(self):
            return writer

    monkeypatch.setattr(sys, "stdout", Out())
    file = JsonLines("-")
    file.open()
    with pytest.raises(BlockingIOError):
        for _ in range(100_000):
            file.add("x" * 100)
    os.close(reader)
    with pytest.raises(OSError):
        for _ in range(3):
            file.add("x")
    file.close()
    os.close(writer)


def test_a_deleted_log_is_counted_and_begun_anew(tmp_path):
    tally, clock = Tally(), Clock()
    guard = Guard(JsonLines(f"{tmp_path}/log", events=True), tally, clock)
    guard.event({"event": "first"})
    (tmp_path / "log").unlink()
    guard.event({"event": "lost"})
    assert tally["output"] == 1
    clock.now += 2
    guard.event({"event": "second"})
    guard.close()
    assert json.loads((tmp_path / "log").read_text()) == {"event": "second"}


def test_a_pipe_that_nobody_reads_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    code = "import sys\nfrom trexton.onboard.sinks.files import JsonLines\nJsonLines(sys.argv[1])"
    words = [sys.executable, "-c", code, tmp_path / "pipe"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert "pipe: cannot be written (No such device or address)" in done.stderr
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    sink = JsonLines(str(tmp_path / "pipe"))
    sink.open()
    sink.add("{}")
    assert os.read(reader, 100).endswith(b"{}\n")
    sink.close()
    os.close(reader)
