"""Disks that are full and disks that may only be read: one sentence, status 1, old results kept.

On real small file systems, which only root may mount; `test_safety` has what needs none.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
from dataclasses import replace

import pytest
from small_room import histogram_flight, picture_flight

from trexton.cli.main import main
from trexton.flights.writing import write_flight
from trexton.onboard import tally

READ_ONLY, REMOUNT = 1, 32  # of mount(2)

TRAIN = "train room --textons 3 --set measurement.neighbors=2 -o"
# name: what makes the old result and what would replace it, each without and with other settings
COMMANDS = {
    "simulate": ("simulate --frames 3 --floor room/floor.png --out", "DISK/flight", "--seed 3"),
    "train": (TRAIN, "DISK/map.npz", "--seed 3"),
    "import": ("import csv table.csv --replace --out", "DISK/imported", "--split 0.5"),
    "export": ("export room tum --out", "DISK/track.tum", ""),
    "data fetch": ("data fetch cyberzoo --out", "DISK/cyberzoo", ""),
    "onboard csv": (
        "onboard map.npz --camera room --output",
        "csv:DISK/fixes.csv",
        "--output csv:DISK/more",
    ),
    "onboard log": ("onboard map.npz --camera room --output csv:/dev/null --log", "DISK/l", ""),
}
SLOW = {
    "run": (
        "run plain --no-book --only mocap_training --set particles=10 repeats=2 neighbors=2 --out",
        "DISK/results", "--set seed=3",
    ),
    "report": ("report plain --no-book --out", "DISK/report", "--methods paper"),
    "sweep": ("sweep plan.toml --out", "DISK/sweep", ""),
    "suitability": ("suitability room/floor.png --width 4 --out", "DISK/suitability", "--seed 3"),
}  # fmt: skip


class Disk:
    """A file system in memory of so many bytes."""

    def __init__(self, place, size=6_000_000):
        self.place, self._libc = place, ctypes.CDLL(None, use_errno=True)
        place.mkdir()
        self._mount(0, f"size={size}")

    def _mount(self, flags, data):
        words = (b"tmpfs", str(self.place).encode(), b"tmpfs", flags, data.encode())
        if self._libc.mount(*words):
            pytest.skip(f"nothing may be mounted here ({os.strerror(ctypes.get_errno())})")

    def read_only(self, yes=True):
        self._mount(REMOUNT | (READ_ONLY if yes else 0), "")

    def fill(self):
        with open(self.place / "filler", "ab", buffering=0) as stream:
            try:
                while stream.write(bytes(4096)) == 4096:
                    pass
            except OSError:
                pass

    def close(self):
        self._libc.umount2(str(self.place).encode(), 2)

    def state(self):
        return {
            str(path.relative_to(self.place)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(self.place.rglob("*"))
            if path.is_file() and path.name != "filler" and ".engine" not in path.parts
        }


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """What the commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    seen = picture_flight(folder / "pictures", "room", 16)
    write_flight(replace(seen, split={"train": (100, 109), "test": (110, 115)}), folder / "room")
    plain = histogram_flight("plain", 60)
    write_flight(replace(plain, split={"train": (0, 39), "test": (40, 59)}), folder / "plain")
    rows = "".join(f"{i},{i},{i % 3},pictures/{i:04d}.png\n" for i in range(4))
    (folder / "table.csv").write_text("t,x,y,image\n" + rows)
    plan = "[set]\nparticles = 10\nrepeats = 2\nneighbors = 2\n"
    plan = f'experiment = "mocap_training"\nflights = ["plain"]\n{plan}'
    (folder / "plan.toml").write_text(plan)
    before = os.getcwd()
    os.chdir(folder)
    for flight, name in (("room", "map.npz"), ("plain", "plain.npz")):
        assert main([*TRAIN.replace("room", flight).split(), name, "--quiet"]) == 0
    os.chdir(before)
    return folder


@pytest.fixture
def disk(tmp_path):
    disk = Disk(tmp_path / "disk")
    yield disk
    disk.close()


def refused(name, disk, inputs, monkeypatch, capfd, spoil):
    words, out, other = (COMMANDS | SLOW)[name]
    monkeypatch.chdir(inputs)
    monkeypatch.setenv("TREXTON_CACHE", str(inputs / "cache"))
    words = f"{words} {out}".replace("DISK", str(disk.place)).split()
    words.insert(1, "--quiet")
    assert main(words) == 0, capfd.readouterr().err
    before = disk.state()
    assert before
    spoil()
    capfd.readouterr()
    assert main([*words, *other.replace("DISK", str(disk.place)).split()]) == 1
    tally.flush()
    said = capfd.readouterr()
    assert "Traceback" not in said.err + said.out and "report it" not in said.err + said.out
    return before, said.err.strip().splitlines(), said.out


@pytest.mark.parametrize("state", ["full", "read-only"])
@pytest.mark.parametrize(
    "name", [*COMMANDS, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_one_sentence_and_the_old_result_stays(
    name, state, disk, inputs, monkeypatch, capfd, request
):
    if name == "data fetch":
        request.getfixturevalue("shared_data")
    spoil = disk.fill if state == "full" else disk.read_only
    before, said, shown = refused(name, disk, inputs, monkeypatch, capfd, spoil)
    if name.startswith("onboard") and state == "full":
        assert "lines were left out" in said[-1]
        before.clear()  # a table is moved aside, a log goes on
    elif name not in ("run", "report", "sweep"):
        assert len(said) == 1 and str(disk.place) in said[0], said
    assert {name: digest for name, digest in disk.state().items() if name in before} == before
