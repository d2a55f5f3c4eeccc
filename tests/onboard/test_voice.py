"""What is only for eyes may neither hold up nor end a flight."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import small_flight
from patience import eventually

from trexton.flights.writing import write_flight
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map
from trexton.onboard import tally


@pytest.fixture
def words(tmp_path) -> list[str]:
    """A flight at its own stamps that would go on for ever, with a log."""
    flight = small_flight(120)
    flight = replace(flight, time=flight.time / 4)  # fifty frames a second
    folder = write_flight(flight, tmp_path / "flight")
    path = save_map(
        train_map(flight, neighbors=3, rng=np.random.default_rng(1)), tmp_path / "map.npz"
    )
    return [
        sys.executable, "-m", "trexton", "onboard", str(path), "--camera", str(folder),
        "--pace", "stamps", "--laps", "1000", "--output", f"csv:{tmp_path}/out.csv",
        "--log", str(tmp_path / "log"),
    ]  # fmt: skip


def lines(tmp_path) -> list[str]:
    log = tmp_path / "log"
    return log.read_text().splitlines() if log.exists() else []


def test_a_reader_of_standard_error_that_has_gone_ends_nothing(words, tmp_path):
    reader, writer = os.pipe()
    process = subprocess.Popen(words, stderr=writer)
    os.close(writer)
    try:
        assert eventually(lambda: len(lines(tmp_path)) > 5)
        os.close(reader)
        count = len(lines(tmp_path))
        assert eventually(lambda: len(lines(tmp_path)) > count + 120)  # several status lines later
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
    finally:
        process.kill()
    assert json.loads(lines(tmp_path)[-1])["event"] == "end"


def test_a_reader_that_sleeps_holds_nothing_up(words, tmp_path):
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    try:
        while True:
            os.write(writer, b"x" * 4096)
    except BlockingIOError:
        os.set_blocking(writer, True)  # full now: the script's first word would wait for ever
    process = subprocess.Popen(words, stderr=writer)
    try:
        assert eventually(lambda: len(lines(tmp_path)) > 30)
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
    finally:
        process.kill()
        os.close(reader)
        os.close(writer)
    assert json.loads(lines(tmp_path)[-1])["event"] == "end"


def test_a_terminal_that_is_closed_ends_nothing(words, tmp_path):
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    try:
        assert eventually(lambda: len(lines(tmp_path)) > 5)
        process.send_signal(signal.SIGHUP)
        count = len(lines(tmp_path))
        assert eventually(lambda: len(lines(tmp_path)) > count + 20)
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
    finally:
        process.kill()


def test_threads_that_speak_first_at_once_begin_one_voice(monkeypatch):
    spec = importlib.util.find_spec(tally.__name__)
    fresh = importlib.util.module_from_spec(spec)  # nobody has spoken here
    spec.loader.exec_module(fresh)
    speakers = [threading.Thread(target=fresh.say, args=("first",)) for _ in range(4)]
    begun = []

    class Slow(threading.Thread):
        def start(self):
            begun.append(self.name)
            time.sleep(0.3)  # those who come meanwhile still find no voice

    monkeypatch.setattr(threading, "Thread", Slow)
    for speaker in speakers:
        speaker.start()
    for speaker in speakers:
        speaker.join()
    assert begun == ["voice"]
    assert fresh._lines.qsize() == len(speakers)  # what they said waits for it


def test_what_cannot_be_written_in_time_is_left_out(monkeypatch):
    reader, writer = os.pipe()

    class Asleep:
        def fileno(self):
            return writer

    monkeypatch.setattr(sys, "stderr", Asleep())
    for _ in range(300):
        tally.say("x" * 60_000)
    assert tally._lines.unfinished_tasks <= 257
    os.close(reader)  # lets the thread go
    tally.flush(5)
    os.close(writer)
