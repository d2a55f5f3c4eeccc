"""What is refused before anything flies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import small_flight
from onboard_tools import room_map

from trexton.cli.main import main
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import train_map
from trexton.onboard.build import build
from trexton.onboard.settings import Flying, Settings


@pytest.fixture
def flight(tmp_path):
    folder = write_flight(small_flight(60), tmp_path / "flight")
    path = save_map(
        train_map(small_flight(60), neighbors=3, rng=np.random.default_rng(1)), tmp_path / "map.npz"
    )
    return folder, path


@pytest.mark.parametrize(
    "outputs",
    [
        ["csv:{map}"], ["json:{flight}/frames.csv"], ["tum:{flight}/flight.toml"],
        ["json", "csv:-"], ["csv:{tmp}/a", "tum:{tmp}/a"],
        ["csv:{tmp}/flight/../a", "json:{tmp}/a"],
    ],
)  # fmt: skip
def test_nothing_is_written_over_what_is_read_and_no_file_twice(outputs, flight, tmp_path, capsys):
    folder, path = flight
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    words = []
    for output in outputs:
        words += ["--output", output.format(map=path, flight=folder, tmp=tmp_path)]
    assert main(["onboard", str(path), "--camera", str(folder), *words]) == 1
    assert "give" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


def test_a_key_that_signs_is_not_written_over_and_an_output_is_named_once(flight, capsys, tmp_path):
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    words = ["onboard", str(flight[1]), "--camera", str(flight[0]), "--output"]
    assert main([*words, f"csv:{key}", "--sign-key", str(key)]) == 1
    assert "would be written over" in capsys.readouterr().err
    assert key.read_bytes() == bytes(range(32))
    link = "udpout:127.0.0.1:9"
    assert main([*words, link, "--output", link]) == 1
    assert f"output {link!r} is given twice" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--radius", "0.2"], "--radius is given without --land"),
        (["--trigger", "touchdown"], "--trigger is given without --land"),
        (["--allow-overconfident"], "--allow-overconfident is given without --land"),
        (["--land", "0,0", "--trigger", "touchdown", "--spread", ".1"], "--spread is of --trigger"),
        (["--origin", "90,0,0"], "90 is not within -89.9 to 89.9"),
    ],
)
def test_options_of_a_landing_that_contradict_each_other(words, told, flight, capsys):
    folder, path = flight
    maps = train_map(small_flight(60), method="field", rng=np.random.default_rng(1))
    save_map(maps, path)
    assert main(["onboard", str(path), "--camera", str(folder), *words]) == 1
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "unread"),
    [
        (["--component-id", "9", "--target", "1", "--laps", "2"], "--target, --component-id"),
        (["--rate", "3", "--camera-delay", ".1"], "--camera-delay"),
        (["--camera-delay", ".1", "--pace", "stamps"], ""),
        (["--target", "1", "--output", "udpout:127.0.0.1:9", "--heading", "0"], ""),
        (["--heading", "0", "--autopilot", "px4"], ""),
    ],
)
def test_what_was_chosen_and_nothing_reads_is_said(words, unread, flight, capsys):
    folder, path = flight
    assert main(["onboard", str(path), "--camera", str(folder), "--frames", "2", *words]) == 0
    said = capsys.readouterr().err
    assert (f"nothing here reads {unread}\n" in said) == bool(unread)
    assert ("nothing here reads" in said) == bool(unread)


@pytest.mark.parametrize("images", [False, True])
def test_what_takes_long_at_first_is_done_before_it_is_ready(images, flight, tmp_path, monkeypatch):
    """A first start compiles: the loop would be silent for seconds."""
    path = save_map(room_map(), tmp_path / "images.npz") if images else flight[1]
    stepped, step = [], Localizer.step

    def steps(self, frame, **known):
        stepped.append((self, np.ndim(frame)))
        return step(self, frame, **known)

    monkeypatch.setattr(Localizer, "step", steps)
    camera = "rtsp://127.0.0.1:1/x" if images else str(flight[0])
    onboard = build(Settings(str(path), (), (), {Flying: Flying(camera=camera)}))
    ((warmed, dimensions),) = stepped
    assert warmed is not onboard.localizer and warmed.samples == onboard.localizer.samples
    assert dimensions == (3 if images else 1)


def test_a_predicted_touchdown_needs_a_method_that_knows_its_velocity(flight, capsys):
    folder, path = flight
    words = ["onboard", str(path), "--camera", str(folder), "--land", "0,0"]
    assert main([*words, "--trigger", "touchdown"]) == 1
    said = capsys.readouterr().err
    assert "needs a velocity, which method 'paper' does not estimate" in said


@pytest.mark.parametrize(
    ("coverage", "warned"), [(None, True), (0.5, True), (0.79, True), (0.8, False), (0.93, False)]
)
def test_a_map_that_claims_too_much_is_said_and_not_landed_by(coverage, warned, flight, capsys):
    """What left-out parts of its flight said against it was known, and nobody was told."""
    folder, path = flight
    found = {"assessment": {"coverage_90": coverage, "lost_share": 0.0 if coverage else 1.0}}
    texton_map = load_map(path)
    save_map(replace(texton_map, provenance=texton_map.provenance | found), path)
    onboard = build(Settings(str(path), (), (), {Flying: Flying(camera=str(folder))}))
    line = onboard.status.line(None, 0.0)
    assert ("WARNING: the map's 90 % region held" in line) == warned
    words = ["onboard", str(path), "--camera", str(folder), "--output", "udpout:127.0.0.1:9"]
    words += ["--land", "0,0", "--arm-landing", "--heading", "0"]
    assert main([*words, "--particles", "9"]) == int(warned)  # no option launders a map
    assert main(words) == int(warned)
    assert ("add --allow-overconfident" in capsys.readouterr().err) == warned
    assert main([*words, "--allow-overconfident"]) == 0


def test_what_nobody_measured_of_a_map_is_said(flight):
    """Other parts, or a flight too short to tell, passed for honest."""
    folder, path = flight

    def line(*choices, method=None) -> str:
        flying = Flying(camera=str(folder), method=method)
        return build(Settings(str(path), (), choices, {Flying: flying})).status.line(None, 0.0)

    assert "WARNING: nobody measured" in line()
    honest = {"assessment": {"coverage_90": 0.9, "lost_share": 0.0}}
    texton_map = load_map(path)
    save_map(replace(texton_map, provenance=texton_map.provenance | honest), path)
    assert "WARNING" not in line() + line(method="paper")
    assert "WARNING: nobody measured" in line("recovery=augmented")
    fewer = {Flying: Flying(camera=str(folder), particles=7)}
    status = build(Settings(str(path), (), (), fewer)).status
    assert "WARNING: nobody measured" in status.line(None, 0.0)


def test_a_heading_of_more_than_a_turn_is_refused(flight, capsys):
    """A point left out turned the map by a third of a turn, and nobody was told."""
    folder, path = flight
    assert main(["onboard", str(path), "--camera", str(folder), "--heading", "840"]) == 1
    assert "heading is 840.0: expected 360 or less" in capsys.readouterr().err


def test_without_a_heading_an_autopilot_is_warned_of(flight, capsys):
    folder, path = flight
    words = ["onboard", str(path), "--camera", str(folder), "--output", "udpout:127.0.0.1:9"]
    for more, warned in (([], True), (["--heading", "0"], False)):
        assert main([*words, *more]) == 0
        assert ("no --heading" in capsys.readouterr().err) == warned


def test_the_log_neither(flight, tmp_path, capsys):
    folder, path = flight
    words = ["--output", f"csv:{tmp_path}/a", "--log", f"{tmp_path}/a"]
    assert main(["onboard", str(path), "--camera", str(folder), *words]) == 1
    assert "two outputs" in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong",
    [
        ["--output", "udpout:nowhere"],
        ["--output", "udpout:127.0.0.1:1²"],
        ["--output", "tum:/no/such/folder/track"],
        ["--land", "1,1", "--arm-landing"],
    ],
)
def test_a_flight_that_is_refused_touches_no_output(flight, tmp_path, monkeypatch, capsys, wrong):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.csv").write_text("of yesterday")
    (tmp_path / "link.csv").symlink_to("new.csv")
    before = sorted(path.name for path in tmp_path.iterdir())
    outputs = ["--output", "csv:old.csv", "--output", "csv:link.csv", "--log", "log"]
    assert main(["onboard", str(flight[1]), "--camera", str(flight[0]), *outputs, *wrong]) == 1
    assert "unexpected" not in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "old.csv").read_text() == "of yesterday"


def test_images_for_a_map_of_histograms(flight, capsys):
    assert main(["onboard", str(flight[1]), "--camera", "rtsp://127.0.0.1:1/x"]) == 1
    assert "holds no textons" in capsys.readouterr().err


def test_a_flight_of_which_nothing_could_be_used_is_a_failure(flight, tmp_path, capsys):
    counted = read_flight(flight[0])
    counted = replace(counted, features="counts", histograms=3 * counted.histograms)
    path = write_flight(counted, tmp_path / "counts")
    words = ["onboard", str(flight[1]), "--camera", str(path), "--output", "csv:/dev/null"]
    for quiet in ([], ["--quiet"]):
        assert main([*words, *quiet]) == 1
        told = capsys.readouterr().err.splitlines()[-1]
        assert told.startswith(
            "trexton onboard: not one of 60 frames could be localized (misfit 60"
        )


def test_a_yaw_that_no_frame_shows_is_not_promised(flight, capsys):
    """ArduPilot would get no position at all, and nobody would know why."""
    words = ["onboard", str(flight[1]), "--camera", str(flight[0]), "--send-yaw"]
    assert main(words) == 1
    assert "take a map for it" in capsys.readouterr().err
