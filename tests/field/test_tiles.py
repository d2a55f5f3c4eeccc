"""Parts of an image as places of their own: found from a flight itself, and worth it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_room import SHAPE, histogram_flight, picture_flight
from small_survey import look, observed, training

from trexton.base.errors import MapError
from trexton.field.features import MAX_FEATURES, Features
from trexton.field.field import Field
from trexton.field.process import Process
from trexton.field.tiles import Tiles
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.localization.localizer import Localizer
from trexton.localization.training import for_method, train_map
from trexton.localization.training_set import Training
from trexton.vision.textons import TextonDictionary

RIGHT, DOWN = np.array([0.55, 0.2]), np.array([0.15, -0.45])  # of a camera that is turned
OFFSETS = np.array([(c - 0.5) * RIGHT + (r - 0.5) * DOWN for r in (0, 1) for c in (0, 1)])


def lanes(apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Lanes along both axes of a floor of 4 m x 3 m, and their stamps."""
    along, over = np.arange(0.2, 3.8, 0.09), np.arange(0.2, 2.8, 0.09)
    places = []
    for number, y in enumerate(np.arange(0.2, 2.9, apart)):
        places.append(np.column_stack([along[:: (-1) ** number], np.full(len(along), y)]))
    for number, x in enumerate(np.arange(0.2, 3.9, apart)):
        places.append(np.column_stack([np.full(len(over), x), over[:: (-1) ** number]]))
    whole = np.concatenate(places)
    return whole, 0.08 * np.arange(len(whole))


def shown(places: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """``(N, 48)`` histograms of the four parts of frames at these places of a floor that changes
    within half a metre.
    """
    parts = [look(2.5 * (places + offset), rng) for offset in OFFSETS]
    return np.hstack(parts) / len(OFFSETS)


def roots(histograms: np.ndarray) -> np.ndarray:
    return np.sqrt(histograms).reshape(len(histograms), len(OFFSETS), -1)


def surveyed(apart: float, rng: np.random.Generator) -> Training:
    places, time = lanes(apart)
    words = rng.integers(0, 255, (12, 6, 6, 3), dtype=np.uint8)
    return training(
        positions=places, time=time, histograms=shown(places, rng),
        dictionary=TextonDictionary(words), cells=2,
    )  # fmt: skip


def test_footprints_are_learned_from_the_flight_itself(rng):
    places, time = lanes(0.9)
    found = Tiles.of(places, roots(shown(places, rng)), time)
    np.testing.assert_allclose(found.offsets, OFFSETS, atol=0.04)


def test_parts_that_show_nothing_of_each_other_are_taken_as_a_whole(rng):
    places, time = lanes(0.9)
    apart = [look(places + 40 * number, rng) for number in range(4)]
    found = Tiles.of(places, roots(np.hstack(apart) / 4), time)
    assert found.offsets.tolist() == [[0, 0]]


@pytest.mark.parametrize(("frames", "parts"), [(200, 1), (12, 4)])
def test_one_part_and_few_frames_are_taken_as_a_whole(rng, frames, parts):
    places, time = lanes(0.9)
    places, time = places[:: len(places) // frames], time[:: len(places) // frames]
    features = rng.random((len(places), parts, 12))
    assert Tiles.of(places, features, time).offsets.tolist() == [[0, 0]]


def test_between_two_lanes_the_parts_know_where_a_frame_is(rng):
    survey = surveyed(1.1, rng)
    along = np.linspace(0.4, 3.6, 40)
    places = np.column_stack([along, np.full(40, 0.75)])  # half way between two of them
    later = shown(places, rng)

    def off(field: Field) -> tuple[float, float]:
        best = [field.centers[field.log_posterior(observed(each)).argmax()] for each in later]
        away = np.hypot(*(np.array(best) - places).T)
        return float(away.mean()), float(field.predicted_error(places).mean())

    quarters, undivided = Field().fit(survey), Field().fit(replace(survey, cells=1))
    assert len(quarters.offsets) == 4
    (tiled, predicted), (whole, spread) = off(quarters), off(undivided)
    assert tiled < 0.1 < whole and predicted < spread


def test_the_variance_of_a_frame_is_the_mean_of_what_its_parts_show(rng):
    places, _ = lanes(0.9)
    process = Process(places, look(places, rng), 0.8)
    tiles, centers = Tiles(OFFSETS), np.array([[1.0, 1.0], [3.1, 2.2]])
    exact = process.variance(tiles.places(centers)).reshape(2, 4).mean(axis=1)
    found = tiles.variance(process, centers, (0.0, 4.0, 0.0, 3.0))
    np.testing.assert_allclose(found, exact, atol=0.02)


def test_of_every_part_the_same_is_taken(rng):
    histograms = rng.dirichlet(np.ones(48), 300)
    histograms[:, [3, 15, 27, 39]] = 0  # a texton that no part shows
    taken = Features.candidates(histograms, 4)[0]
    assert taken.axes.shape == (48, 44)
    expected = np.delete(np.sqrt(histograms).reshape(300, 4, 12), 3, axis=2)
    np.testing.assert_allclose(taken(histograms).reshape(300, 4, -1), expected)


def test_very_many_bins_of_parts_are_taken_along_their_axes(rng):
    histograms = rng.dirichlet(np.ones(9 * 50), 300)
    taken = Features.candidates(histograms, 9)[0]
    assert taken.axes.shape[1] == 9 * (MAX_FEATURES // 9)
    np.testing.assert_allclose(taken.axes.T @ taken.axes, np.eye(396), atol=1e-9)


def turned(flight: Flight, folder: Path, rng: np.random.Generator) -> Flight:
    """Its frames as a camera sees them that turns as it likes."""
    files = []
    for number, image in enumerate(flight.images()):
        around = cv2.getRotationMatrix2D((SHAPE[1] / 2, SHAPE[0] / 2), rng.uniform(0, 360), 1)
        files.append(folder / f"{number}.png")
        frame = cv2.warpAffine(image, around, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT)
        cv2.imwrite(str(files[-1]), frame)
    return replace(flight, frames=ImageFiles(tuple(files)))


@pytest.mark.parametrize("frames", [120, 300])
def test_method_field_takes_quarters_of_images_unless_the_heading_was_not_held(
    tmp_path, rng, frames, capsys
):
    held = picture_flight(tmp_path / "held", "held", frames=frames, turns=6)
    astray = turned(held, tmp_path, rng)
    maps = [train_map(flight, method="field", n_textons=6, rng=rng) for flight in (held, astray)]
    assert [each.cells for each in maps] == [2, 1]
    assert capsys.readouterr().err.count("show nothing of each other") == 1
    assert [each.provenance["parameters"]["cells"] for each in maps] == [2, 1]
    # A frame shows .8 m x .6 m.
    middles = [[-0.2, 0.15], [0.2, 0.15], [-0.2, -0.15], [0.2, -0.15]]
    np.testing.assert_allclose(maps[0].parts["measurement"].offsets, middles, atol=0.05)


@pytest.fixture(scope="module")
def counted_anew(tmp_path_factory):
    """A flight, a map of it for the paper's method, and that map for method field."""
    rng = np.random.default_rng(1)
    flight = picture_flight(tmp_path_factory.mktemp("anew"), "flight", frames=160, turns=6)
    base = train_map(flight, n_textons=6, neighbors=2, rng=rng)
    return flight, base, for_method(base, "field", flight=flight, rng=rng)


def test_a_map_for_another_method_is_counted_anew_if_its_flight_is_given(counted_anew, rng):
    flight, base, field = counted_anew
    assert base.cells == for_method(base, "field", rng=rng).cells == 1
    assert field.cells == 2
    back = for_method(field, "paper", flight=flight, rng=rng)
    np.testing.assert_array_equal(back.histograms, base.histograms)
    with pytest.raises(MapError, match="has 3 frames, the map 160: give the frames"):
        for_method(base, "field", flight=flight.select(slice(0, 3)), rng=rng)


def test_the_papers_method_takes_whole_images_also_on_a_map_of_quarters(counted_anew, rng):
    _, base, field = counted_anew
    paper = Localizer(field, samples=50, method="paper", rng=rng).map
    assert (paper.cells, paper.method) == (1, "paper")
    np.testing.assert_allclose(paper.histograms, base.histograms, atol=1e-12)


def test_a_part_of_the_flight_keeps_the_footprints(rng, monkeypatch):
    survey = surveyed(0.9, rng)
    field = Field().fit(survey)
    monkeypatch.setattr(Tiles, "of", None)
    half = replace(
        survey, **{name: getattr(survey, name)[::2] for name in ("positions", "time", "histograms")}
    )
    again = field.untrained().fit(half)
    np.testing.assert_array_equal(again.offsets, field.offsets)


def test_histograms_that_came_with_a_dictionary_are_of_whole_images(rng):
    words = TextonDictionary(rng.integers(0, 255, (15, 6, 6, 3), dtype=np.uint8))
    flight = histogram_flight("flight", frames=120)
    known = train_map(flight, method="field", dictionary=words, rng=rng)
    assert known.cells == 1 and len(known.parts["measurement"].offsets) == 1


def test_boards_that_look_alike_along_their_length_are_measured_across_them(rng):
    places, time = lanes(0.9)
    offsets = np.array([(c - 0.5, 0.75 * (0.5 - r)) for r in (0, 1) for c in (0, 1)])
    boards = [look(2.5 * (places + offset) * [1.0, 0.02], rng) for offset in offsets]
    found = Tiles.of(places, roots(np.hstack(boards) / 4), time, 0.75)
    np.testing.assert_allclose(found.offsets, offsets, atol=0.03)
