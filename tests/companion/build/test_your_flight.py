"""The page "Your own flight": what it says of commands, importers and the header is so."""

from __future__ import annotations

import re
import shlex
import tomllib

import cv2
import numpy as np
from conftest import ROOT
from small_recording import recording

from trexton.cli.main import main
from trexton.companion.build.prose import context, render
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.flights.importers import IMPORTERS, importer
from trexton.flights.writing import write_flight

PAGE = ROOT / "book" / "your_flight.md"


def test_the_first_commands_of_the_page_leave_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recording(tmp_path / "my-recording")
    for block in re.findall(r"^```bash\n(.*?)^```", PAGE.read_text(), re.M | re.S)[:2]:
        for line in block.splitlines():
            assert main(shlex.split(line)[1:]) == 0, capsys.readouterr().err
    assert read_flight(tmp_path / "my-flight").split == {"train": (0, 13), "test": (14, 23)}
    assert (tmp_path / "my-hall.npz").is_file()
    assert len((tmp_path / "truth.tum").read_text().splitlines()) == 24


def test_the_table_lists_every_importer_with_all_it_can_be_told():
    text = render(PAGE, context(PAGE.parent, {}, lambda page, words: words))
    for kind in IMPORTERS:
        row = next(line for line in text.splitlines() if line.startswith(f"| `{kind}` |"))
        for each in importer(kind).Settings.declared():
            assert f"`--{each.name.replace('_', '-')}`" in row


def test_the_whole_header_of_the_data_page_is_read(tmp_path):
    text = re.search(
        r"^```toml\n(.*?)^```", (ROOT / "book" / "your_flight.md").read_text(), re.M | re.S
    )[1]
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
