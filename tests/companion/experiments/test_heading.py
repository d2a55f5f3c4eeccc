"""Any heading: turned pictures, the two remedies, and a record whose numbers are those shown."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.companion.experiments import heading
from trexton.companion.experiments.style import COLORS
from trexton.simulator import Floor, record_flight
from trexton.vision.camera import Camera, MapImage
from trexton.vision.histograms import texton_histogram
from trexton.vision.textons import TextonDictionary


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    coarse = np.random.default_rng(1).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    picture = cv2.resize(coarse, (768, 768), interpolation=cv2.INTER_CUBIC)
    floor = Floor(MapImage.from_extent(picture, 0.0, 3.0, 256))
    folder = tmp_path_factory.mktemp("heading") / "room"
    camera = Camera(160, 120, 130.0)
    return record_flight(folder, frames=60, every=8, floor=floor, camera=camera)


@pytest.fixture(scope="module")
def record(train):
    return heading.run(train, train, heading.Parameters(frames=60, textons=8))


def test_turning_back_by_a_perfect_compass_is_the_square_as_flown(train, record):
    perfect = heading.run(train, train, heading.Parameters(frames=60, textons=8, compass_deg=0))
    errors = perfect.values["error_cm"]
    for count in heading.COUNTS:
        assert errors["back"][count]["value"] == errors["square"][count]["value"]
    # What the compass does not touch is as before.
    assert errors["turned"] == record.values["error_cm"]["turned"]


def test_no_answer_is_better_than_its_bound_and_a_cure_cures(record):
    values = record.values
    errors = values["error_cm"]
    assert 0 < values["bound_cm"] < min(e["value"] for v in errors.values() for e in v.values())
    assert errors["back"]["cells"]["value"] < errors["turned"]["cells"]["value"]
    assert "turned" in heading.finding(record)


def test_a_square_turned_by_a_quarter_is_the_square_turned(rng):
    image = rng.integers(0, 256, (121, 161, 3), dtype=np.uint8)
    flown, aside = heading.turned(image, 0.0), heading.turned(image, np.pi / 2)
    assert flown.shape == aside.shape == (85, 85, 3)
    np.testing.assert_array_equal(aside, np.rot90(flown))


def test_a_tolerant_dictionary_counts_quarter_turns_alike(rng):
    image = rng.integers(0, 256, (60, 60, 3), dtype=np.uint8)
    dictionary = TextonDictionary(rng.integers(0, 256, (5, 6, 6, 3), dtype=np.uint8))
    tolerant = heading.with_quarter_turns(dictionary)
    folded = [
        texton_histogram(np.ascontiguousarray(np.rot90(image, turns)), tolerant)
        .reshape(5, 4)
        .sum(axis=1)
        for turns in range(4)
    ]
    for each in folded[1:]:
        np.testing.assert_allclose(each, folded[0])
    np.testing.assert_array_equal(tolerant.textons[::4], dictionary.textons)


def test_figure_and_table_show_the_record(record):
    middle = record.values["error_cm"]["whole"]["paper"]["value"] / 100
    lines = [drawn.lines[0] for drawn in heading.errors(record).axes[0].containers]
    assert lines[0].get_xdata()[0] == pytest.approx(middle)
    meant = [COLORS["paper"], COLORS["field"], COLORS["field"]]  # as everywhere in the book
    assert [line.get_color() for line in lines] == meant
    table = heading.table(record)
    assert len(table) == len(heading.VIEWS) and len(table.columns) == 1 + len(heading.COUNTS)


def test_too_few_pictures_are_refused(train):
    lost = replace(train, position=np.where(np.arange(60)[:, None] < 4, train.position, np.nan))
    with pytest.raises(ParameterError, match="4 pictures of flight 'room' have a position"):
        heading.run(lost, lost, heading.Parameters())
