"""The player: what it keeps is what the localizer did; its page is whole and without hosts."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import small_flight
from onboard_tools import colourful_flight
from small_room import picture_flight

from trexton.companion.experiments import mocap_training
from trexton.companion.experiments.style import COLORS
from trexton.companion.player.playback import player_html, record_replay, replay
from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.vision.images import gather_patches


def localizer(texton_map, seed=5, **options):
    return Localizer(texton_map, rng=np.random.default_rng(seed), **options)


@pytest.fixture
def texton_map(rng):
    return train_map(small_flight(), neighbors=3, rng=rng)


def embedded(page: str) -> dict:
    return json.loads(re.search(r'type="application/json">(.*?)</script>', page, re.DOTALL)[1])


def test_it_keeps_what_every_step_gave(texton_map):
    flight = small_flight()
    others = {"two": np.arange(2.0 * len(flight)).reshape(-1, 2)}
    recording = record_replay(localizer(texton_map), flight, others, most_frames=10)
    names = ["the paper's filter", "neighbours alone", "two"]
    assert list(recording.frames[0]["estimates_cm"]) == names
    assert [each["frame"] for each in recording.frames] == list(flight.frame[::4])
    again = localizer(texton_map)
    steps = [again.step(row) for row in flight.histograms][::4]
    for kept, step, truth in zip(recording.frames, steps, flight.position[::4], strict=True):
        assert kept["estimates_cm"][names[0]] == np.rint(100 * step.position).astype(int).tolist()
        assert kept["neighbors_cm"] == np.rint(100 * step.neighbors.position).astype(int).tolist()
        error = 100 * float(np.hypot(*(step.position - truth)))
        assert kept["errors_cm"][names[0]] == round(error, 1 if error < 10 else None)
        assert len(kept["particles_cm"]) == len(step.particles) and kept["image"] is None


def test_the_replay_of_an_experiment_shows_every_method_that_can_fly():
    flight = small_flight()
    parameters = mocap_training.Parameters(neighbors=3, particles=20)
    recording = replay(flight, flight, parameters)
    # Without images that fine could compare.
    names = ["the paper's filter", "neighbours alone", "field"]
    assert list(recording.frames[0]["estimates_cm"]) == names
    assert all(set(each["errors_cm"]) == set(names) for each in recording.frames)


def test_patches_are_those_that_the_step_sampled(tmp_path, rng):
    flight = picture_flight(tmp_path, "room")
    texton_map = train_map(flight, n_textons=4, neighbors=2, rng=rng)
    recording = record_replay(localizer(texton_map, samples=30), flight, {}, most_frames=5)
    dictionary = texton_map.dictionary
    for kept, row in zip(recording.frames, range(0, len(flight), 10), strict=True):
        image = flight.image(row)
        size = np.array([image.shape[1], image.shape[0]])
        places = np.ceil(np.array(kept["patches"]) * size / 1000).astype(int)[:, ::-1]
        labels = dictionary.label(gather_patches(image, places, dictionary.patch))
        share = np.bincount(labels, minlength=4) / 30
        assert kept["histogram"] == np.rint(1000 * share).astype(int).tolist()
        assert kept["image"].startswith("data:image/webp;base64,")
    full = record_replay(localizer(texton_map, samples=None), flight, {}, most_frames=2)
    assert full.frames[0]["patches"] is None


def test_a_truth_that_is_unknown_stays_unknown(texton_map):
    flight = small_flight()
    flight.position[3] = np.nan
    recording = record_replay(localizer(texton_map), flight, {})
    assert recording.frames[3]["truth_cm"] is None
    assert recording.frames[3]["errors_cm"]["the paper's filter"] is None
    assert "NaN" not in player_html(recording)


def test_a_method_that_compares_images_has_no_patches_and_its_errors_have_tenths(tmp_path):
    train = colourful_flight(tmp_path / "room")
    texton_map = train_map(train, n_textons=4, rng=np.random.default_rng(1))
    one = localizer(texton_map, samples=30)
    step, nearby = one.step, []

    def near(frame, **told):
        row = len(nearby)
        nearby.append(train.position[row] + (0.0034, 0))
        return replace(step(frame, **told), position=nearby[-1], histogram=None)

    one.step = near
    kept = record_replay(one, train, {}).frames
    assert all(
        each["patches"] is None and each["errors_cm"]["the paper's filter"] == 0.3 for each in kept
    )


def test_a_floor_lies_on_the_page_as_it_lies_in_the_world(tmp_path, texton_map):
    picture = np.zeros((40, 80, 3), np.uint8)
    picture[:20, :20] = 255
    cv2.imwrite(str(tmp_path / "floor.png"), picture)
    # Its columns run north and its rows east: the white corner lies in the south west.
    place = np.array([[0, 0.05, 0.025], [0.05, 0, 0.025], [0, 0, 1]])
    flight = replace(small_flight(), floor_file=tmp_path / "floor.png", floor_from_pixel=place)
    floor = record_replay(localizer(texton_map), flight, {}, most_frames=1).floor
    assert floor["extent_m"] == pytest.approx([0, 2, 0, 4])
    coded = np.frombuffer(base64.b64decode(floor["image"].partition(",")[2]), np.uint8)
    shown = cv2.imdecode(coded, cv2.IMREAD_COLOR).mean(axis=2)
    rows, columns = shown.shape
    assert rows == pytest.approx(2 * columns, abs=2)
    corner = shown[-rows // 4 :, : columns // 2]
    assert corner.mean() > 230 and shown[: rows // 2].mean() < 20


def test_the_page_is_one_file(texton_map):
    flight = small_flight()
    recording = record_replay(localizer(texton_map), flight, {"a </script>": flight.position})
    page = player_html(recording, "A <hall>")
    assert "A &lt;hall&gt;" in page and "http" not in re.sub(r"http://www.w3.org\S*", "", page)
    assert embedded(page)["frames"] == recording.frames
    assert page.count("<script") == page.count("</script>") == 2
    bare = page.partition("<noscript>")[2].partition("</noscript>")[0]
    assert "allow scripts" in bare and ".panels" in bare


def test_a_flight_called_as_a_place_of_the_page_is_text(texton_map):
    flight = small_flight()
    recording = record_replay(localizer(texton_map), flight, {"{{ script }}": flight.position})
    page = player_html(recording, "{{ data }} {{ style }}")
    assert "<title>{{ data }} {{ style }}" in page
    assert list(embedded(page)["frames"][0]["estimates_cm"])[-1] == "{{ script }}"


def test_the_player_has_the_colours_of_the_figures():
    style = (files("trexton.companion.player") / "player.css").read_text(encoding="utf-8")
    light, dark = (dict(re.findall(r"--(\w+): (#\w+)", line)) for line in style.splitlines()[:2])
    book = Path("book/_static/book.css").read_text(encoding="utf-8")
    for name in ("truth", "paper", "other", "field", "fine", "neighbors", "particles"):
        assert light[name] == COLORS[name].lower()
        assert f"--fig-{light[name][1:]}: {dark[name]};" in book


def test_every_colour_of_the_figures_has_its_shade_in_the_dark():
    book = Path("book/_static/book.css").read_text(encoding="utf-8")
    for name in COLORS.keys() - {"printed"}:
        assert f"--fig-{COLORS[name][1:].lower()}: #" in book, name
