"""The overview: what the picture shows is what the localizer saw and drew."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from small_room import histogram_flight, picture_flight

from trexton.base.errors import FlightError
from trexton.base.files import canonical_json
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments import overview
from trexton.companion.experiments.evaluation import frames_of, trained_map
from trexton.companion.experiments.track import fly
from trexton.localization.localizer import Localizer
from trexton.vision.images import bgr_from_yuv

OPTIONS = {"samples": 60, "textons": 6, "particles": 15, "neighbors": 3}


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TREXTON_CACHE", str(folder / "cache"))
        yield picture_flight(folder / "a", "train"), picture_flight(folder / "b", "test", turns=4.0)


@pytest.fixture(scope="module")
def record(pair):
    return overview.run(*pair, overview.Parameters(**OPTIONS))


def test_patches_are_those_of_the_histogram(record):
    counts = np.bincount(record.series["labels"], minlength=6)
    np.testing.assert_array_equal(counts / 60, record.series["histogram"])
    positions = np.array(record.series["patches"])
    assert (
        positions.shape == (60, 2)
        and positions.min() >= 0
        and (positions.max(axis=0) < (31, 43)).all()
    )


def test_shows_what_the_localizer_did(record, pair):
    train, test = pair
    texton_map = trained_map(train, textons=6, neighbors=3)
    localizer = Localizer(texton_map, samples=60, particles=15, rng=stream(1, "flight", 0))
    row = record.values["frame"] - 100
    for image in frames_of(test)[: row + 1]:
        estimate = localizer.step(image)
    np.testing.assert_array_equal(record.series["estimate_m"], estimate.position)
    np.testing.assert_array_equal(record.series["particles_m"], estimate.particles)
    np.testing.assert_array_equal(record.series["weights"], estimate.weights)
    np.testing.assert_array_equal(
        record.series["neighbors_m"], train.position[estimate.neighbors.index]
    )
    assert record.values["neighbors"]["frame"] == list(100 + estimate.neighbors.index)
    voted = train.position[estimate.neighbors.index].mean(axis=0)
    assert record.values["neighbors_error_cm"] == pytest.approx(
        100 * np.linalg.norm(voted - test.position[row])
    )
    np.testing.assert_array_equal(record.images["frame"], bgr_from_yuv(test.image(row)))


def test_typical_frame_has_the_median_error(record, pair):
    train, test = pair
    localizer = Localizer(
        trained_map(train, textons=6, neighbors=3),
        samples=60,
        particles=15,
        rng=stream(1, "flight", 0),
    )
    errors = 100 * np.linalg.norm(fly(localizer, frames_of(test)).position - test.position, axis=1)
    assert (errors < record.values["error_cm"]).sum() == (len(errors) - 1) // 2


def test_equal_seeds_equal_bytes(record, pair):
    again = overview.run(*pair, overview.Parameters(**OPTIONS))
    assert canonical_json([again.values, again.series]) == canonical_json(
        [record.values, record.series]
    )


def test_needs_images():
    with pytest.raises(FlightError, match="no images"):
        overview.run(histogram_flight("a"), histogram_flight("b"), overview.Parameters(neighbors=3))


def test_figure_shows_the_record(record, tmp_path):
    loaded = Record.load(record.save(tmp_path))
    figure = overview.pipeline(loaded)
    image, histogram, neighbors, particles = figure.axes[:4]
    assert len(image.collections[0].get_paths()) == 60
    np.testing.assert_allclose(
        [bar.get_height() for bar in histogram.patches], 100 * np.array(record.series["histogram"])
    )
    strip = record.images["textons"][..., ::-1].astype(float) / 255
    np.testing.assert_allclose(
        histogram.patches[2].get_facecolor()[:3], strip[:, 12:18].mean(axis=(0, 1))
    )
    offsets = particles.collections[0].get_offsets()
    np.testing.assert_allclose(offsets, record.series["particles_m"])
    shown = {line.get_label(): line for axis in (neighbors, particles) for line in axis.lines}
    np.testing.assert_allclose(np.ravel(shown["estimate"].get_data()), record.series["estimate_m"])
    np.testing.assert_allclose(shown["neighbours"].get_xydata(), record.series["neighbors_m"])
    assert to_rgba(shown["truth"].get_color()) != to_rgba(shown["estimate"].get_color())
    assert len(neighbors.images) == 1


def test_without_a_floor_and_with_one_neighbor(tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path / "cache"))
    pair = [picture_flight(tmp_path / name, name, floor=False) for name in ("a", "b")]
    record = overview.run(
        *pair, overview.Parameters(samples=20, textons=4, particles=10, neighbors=1)
    )
    assert "floor" not in record.images and "floor" not in record.series
    figure = overview.pipeline(record)
    assert all(not axis.images for axis in figure.axes[2:4])
