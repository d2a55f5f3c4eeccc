"""The page "Your own flight": its first commands do what it says, in order, in an empty folder."""

from __future__ import annotations

import re
import shlex
import tomllib

import cv2
import numpy as np
from conftest import ROOT

from trexton.book.prose import render
from trexton.cli import main
from trexton.flights import Flight, read_flight, write_flight
from trexton.flights.importers import IMPORTERS, importer

PAGE = ROOT / "book" / "your_flight.md"


def recording(folder, frames=24):
    """A TUM folder: a camera that moves over a floor of noise."""
    (folder / "rgb").mkdir(parents=True)
    floor = cv2.resize(np.random.default_rng(4).integers(0, 256, (60, 90, 3), np.uint8), (900, 600))
    images, track = [], []
    for i in range(frames):
        left, top = 20 * i, 150 + round(100 * np.sin(i / 3))
        cv2.imwrite(str(folder / "rgb" / f"{i}.png"), floor[top : top + 120, left : left + 160])
        images.append(f"{0.4 * i:.3f} rgb/{i}.png")
        track.append(f"{0.4 * i:.3f} {left / 100} {top / 100} 1 0 0 0 1")
    (folder / "rgb.txt").write_text("\n".join(images))
    (folder / "groundtruth.txt").write_text("\n".join(track))


def test_the_commands_of_the_page_do_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recording(tmp_path / "my-recording")
    pieces = re.findall(r"^```(bash|text)\n(.*?)^```", PAGE.read_text(), re.M | re.S)[:4]
    assert [kind for kind, _ in pieces] == ["bash", "text"] * 2
    for (_, commands), (_, shown) in zip(pieces[::2], pieces[1::2], strict=True):
        printed = ""
        for line in commands.splitlines():
            code = main(shlex.split(line)[1:])
            said = capsys.readouterr()
            assert code == 0, said.err
            printed += said.err + said.out
        assert printed == shown
    assert read_flight(tmp_path / "my-flight").split == {"train": (0, 11), "test": (12, 23)}
    assert (tmp_path / "my-hall.npz").is_file()
    assert len((tmp_path / "truth.tum").read_text().splitlines()) == 24


def test_the_table_lists_every_importer_with_all_it_can_be_told():
    text = render(PAGE, {}, {"data"}, {})
    for kind in IMPORTERS:
        row = next(line for line in text.splitlines() if line.startswith(f"| `{kind}` |"))
        for each in importer(kind).Settings.declared():
            assert f"`--{each.name.replace('_', '-')}`" in row


def test_the_whole_header_of_the_data_page_is_read(tmp_path):
    text = re.search(r"^```toml\n(.*?)^```", (ROOT / "book" / "data.md").read_text(), re.M | re.S)[
        1
    ]
    flight = Flight(
        "f", np.arange(1200), np.arange(1200) * 0.1, np.full((1200, 2), 1.0), (0.0, 5.0, 0.0, 4.0),
        histograms=np.full((1200, 4), 0.25),
    )  # fmt: skip
    folder = write_flight(flight, tmp_path / "f")
    (folder / "flight.toml").write_text(text)
    cv2.imwrite(str(folder / "floor.png"), np.zeros((20, 25, 3), np.uint8))
    found, header = read_flight(folder), tomllib.loads(text)
    assert found.name == header["name"] and found.split["test"] == (800, 1199)
    assert found.camera.focal == 520 and found.floor is not None and found.notes
