"""The texton map and Algorithm 1: training, saving, stepping, and what it refuses."""

import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight
from small_room import histogram_flight

from trexton.base.errors import ImageError, MapError, ParameterError
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.localization.localizer import LEAST, MAX_CATCH_UP, Localizer, TextonMap
from trexton.localization.map_files import load_map, save_map, to_arrays
from trexton.localization.measurement import rank_covariances
from trexton.localization.motion import process_covariance
from trexton.localization.neighbors import NearestHistograms, neighbors_in_flight
from trexton.localization.training import for_method, train_map
from trexton.vision.camera import Camera
from trexton.vision.textons import TextonDictionary


@pytest.fixture(scope="module")
def picture_flight(tmp_path_factory) -> Flight:
    """60 crops of one blurred random picture along a closed path: neighbours in space look
    alike.
    """
    folder = tmp_path_factory.mktemp("crops")
    rng = np.random.default_rng(3)
    floor = cv2.resize(
        rng.integers(0, 256, (40, 40, 3), dtype=np.uint8), (400, 400), interpolation=cv2.INTER_CUBIC
    )
    angle = np.linspace(0, 4 * np.pi, 60)
    center = np.column_stack([200 + 110 * np.cos(angle), 200 + 80 * np.sin(angle)])
    files = []
    for number, (x, y) in enumerate(center.round().astype(int)):
        files.append(folder / f"{number:03d}.png")
        cv2.imwrite(str(files[-1]), floor[y - 40 : y + 40, x - 50 : x + 50])
    return Flight(
        name="crops",
        frame=np.arange(60),
        time=np.arange(60) * 0.08,
        position=center / 100,
        area=(0.0, 4.0, 0.0, 4.0),
        frames=ImageFiles(tuple(files)),
        camera=Camera(100, 80, 100.0),
    )


@pytest.fixture(scope="module")
def texton_map(picture_flight) -> TextonMap:
    return train_map(picture_flight, n_textons=8, neighbors=3, rng=np.random.default_rng(1))


def test_a_flight_becomes_a_map_and_a_frame_a_position(picture_flight, texton_map):
    localizer = Localizer(texton_map, samples=None, particles=300, rng=np.random.default_rng(2))
    estimates = [localizer.step(image) for image in picture_flight.images()]
    error = np.linalg.norm([e.position for e in estimates] - picture_flight.position, axis=1)
    assert np.median(error[5:]) < 0.35  # the path is 2.2 m wide
    assert all(e.observed and not e.lost and (e.spread > 0).all() for e in estimates)
    last = estimates[-1]
    np.testing.assert_allclose(last.spread**2, np.diagonal(last.covariance))
    np.testing.assert_allclose(last.weights.sum(), 1)
    np.testing.assert_allclose(last.histogram.sum(), 1)
    assert last.neighbors.position.shape == (3, 2)


def test_neighbours_in_time_are_never_neighbours(rng):
    histograms, time = rng.dirichlet(np.ones(6), 50), np.arange(50) * 0.1
    nearest = NearestHistograms(histograms, np.zeros((50, 2)))
    rows = neighbors_in_flight(nearest, histograms, time, 4, excluded_s=0.5)
    assert np.abs(rows - np.arange(50)[:, None]).min() >= 6
    for row in range(50):  # against the plain definition
        allowed = [j for j in range(50) if abs(time[j] - time[row]) > 0.5 + 1e-9]
        best = sorted(allowed, key=lambda j: np.linalg.norm(histograms[j] - histograms[row]))[:4]
        assert rows[row].tolist() == best
    with pytest.raises(MapError, match="longer flight"):
        neighbors_in_flight(nearest, histograms[:8], time[:8], 4, excluded_s=0.5)


def test_covariances_equal_the_plain_definitions(rng):
    positions, rows = rng.uniform(0, 5, (40, 2)), rng.integers(0, 40, (40, 2))
    found = rank_covariances(positions, rows)
    for rank in range(2):
        deviation = positions - positions[rows[:, rank]]
        centered = deviation - deviation.mean(axis=0)
        np.testing.assert_allclose(
            found[rank], centered.T @ centered / 39 + 1e-4 * np.eye(2), rtol=1e-12
        )
    time = np.r_[np.arange(20) * 0.1, 10 + np.arange(20) * 0.1]
    steps = np.delete(
        np.diff(positions, axis=0), 19, axis=0
    )  # the long gap says nothing about one step
    np.testing.assert_allclose(
        process_covariance(positions, time), np.cov(steps.T) + 1e-8 * np.eye(2)
    )


def test_relabelling_textons_changes_nothing(texton_map, picture_flight):
    order = np.random.default_rng(5).permutation(8)
    relabelled = replace(
        texton_map,
        dictionary=TextonDictionary(texton_map.dictionary.textons[order]),
        histograms=texton_map.histograms[:, order],
    )
    tracks = []
    for each in (texton_map, relabelled):
        localizer = Localizer(each, samples=200, particles=50, rng=np.random.default_rng(6))
        tracks.append([localizer.step(image).position for image in picture_flight.images()])
    np.testing.assert_array_equal(tracks[0], tracks[1])


def test_a_saved_map_flies_the_same(texton_map, picture_flight, tmp_path):
    loaded = load_map(save_map(texton_map, tmp_path / "map.npz"))
    assert loaded.provenance == texton_map.provenance and loaded.image_shape == (80, 100)
    tracks = []
    for each in (texton_map, loaded):
        localizer = Localizer(each, particles=50, rng=np.random.default_rng(6))
        tracks.append(
            [localizer.step(image).position.tobytes() for image in picture_flight.images()]
        )
    assert tracks[0] == tracks[1]
    assert (tmp_path / "map.npz").read_bytes() == save_map(
        texton_map, tmp_path / "again.npz"
    ).read_bytes()


def test_damaged_and_newer_maps_are_one_clear_error(texton_map, tmp_path):
    path = save_map(texton_map, tmp_path / "map.npz")
    data = path.read_bytes()
    for cut in (0, 10, len(data) // 2, len(data) - 30):
        path.write_bytes(data[:cut])
        with pytest.raises(MapError, match="not a whole texton map"):
            load_map(path)
    with pytest.raises(MapError, match="no such map"):
        load_map(tmp_path / "none.npz")
    np.savez(path, **to_arrays(texton_map) | {"schema": np.int64(99)})
    with pytest.raises(MapError, match="newer"):
        load_map(path)
    np.savez(path, other=np.arange(3))
    with pytest.raises(MapError, match="not a whole"):
        load_map(path)


def test_an_interrupted_save_leaves_the_old_map(texton_map, tmp_path, monkeypatch):
    path = save_map(texton_map, tmp_path / "map.npz")
    before = path.read_bytes()
    monkeypatch.setattr(
        np, "savez_compressed", lambda stream, **arrays: (stream.write(b"half"), 1 / 0)
    )
    with pytest.raises(ZeroDivisionError):
        save_map(texton_map, path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_frames_that_do_not_fit_are_refused_and_change_nothing(texton_map, picture_flight):
    def track(bad_frames):
        localizer = Localizer(texton_map, particles=20, rng=np.random.default_rng(7))
        for frame, error in bad_frames:
            with pytest.raises(error, match="expected|trained|takes|array"):
                localizer.step(frame)
        return localizer.step(picture_flight.image(0)).position.tobytes()

    bad = [
        ([0.25] * 8, ImageError),
        (np.zeros((80, 100), np.uint8), ImageError),
        (np.zeros((60, 80, 3), np.uint8), ImageError),
        (np.zeros((80, 100, 3)), ImageError),
        (np.full(8, np.nan), MapError),
        (np.ones(5), MapError),
    ]
    assert track(bad) == track([])
    localizer = Localizer(texton_map, particles=20, rng=np.random.default_rng(7))
    for stamp in (np.nan, np.inf):
        with pytest.raises(ParameterError, match="time is .*: expected a finite number"):
            localizer.step(picture_flight.image(1), time=stamp)
    assert localizer.step(picture_flight.image(0)).position.tobytes() == track([])


def test_a_missing_frame_only_predicts(texton_map, picture_flight):
    localizer = Localizer(texton_map, particles=100, rng=np.random.default_rng(8))
    for image in picture_flight.images():
        before = localizer.step(image)
    after = localizer.step(None)
    assert not after.observed and after.neighbors is None and after.histogram is None
    assert np.linalg.norm(after.position - before.position) < 0.5


@pytest.mark.parametrize(
    ("periods", "missed", "ahead"),
    [
        ([1, 1, 1], [0, 0, 0], [None] * 3),
        ([2.4] * 4, [1, 2, 1, 2], [None] * 4),  # what is left over is kept
        ([0.4] * 5, [0] * 5, [0.4] * 5),  # a quick camera: part of a period
        ([1000], [MAX_CATCH_UP], [None]),
        ([0, -50, 1.2], [0, 0, 0], [None] * 3),  # a clock that went back
        ([0.25] * 3 + [0.75] + [0.25] * 3, [0] * 7, [0.25] * 3 + [None] + [LEAST, 0.25, 0.25]),
        ([0.25, 0, *[0.25] * 4], [0] * 6, [0.25, None, LEAST, LEAST, 0.25, 0.25]),
    ],
)
def test_stamps_say_how_far_the_filter_is_advanced(
    texton_map, picture_flight, periods, missed, ahead
):
    period, rng = texton_map.period_s, np.random.default_rng(8)
    localizer = Localizer(texton_map, particles=20, samples=10, rng=rng)
    image, own, steps = picture_flight.image(0), localizer.filter.step, []
    localizer.filter.step = lambda seen: (steps.append(seen), own(seen))
    time = 1e9
    localizer.step(image, time=time)
    for apart, without, part in zip(periods, missed, ahead, strict=True):
        steps.clear()
        time += apart * period
        localizer.step(image, time=time)
        assert steps[:-1] == [None] * without
        since = steps[-1].since_s
        assert since is part or since == pytest.approx(part * period, rel=1e-3)


@pytest.mark.parametrize("disturbed", [lambda row: row != 9, lambda row: row % 3 == 0])
def test_a_quick_camera_that_misses_frames_is_followed(disturbed):
    """One gap, or frames that did not come, and the filter ran four times too fast for ever."""
    flight = histogram_flight("hall", frames=400)
    texton_map = train_map(flight.select(slice(None, None, 4)), method="field", rng=rng_of(1))
    localizer, errors = Localizer(texton_map, rng=rng_of(2)), []
    for row in range(120):
        came = flight.histograms[row] if disturbed(row) else None
        estimate = localizer.step(came, time=float(flight.time[row]))
        assert abs(localizer.time - flight.time[row]) < 0.8 * texton_map.period_s
        errors.append(np.hypot(*(estimate.position - flight.position[row])))
    assert np.mean(errors[60:]) < 0.3


def test_what_an_estimate_holds_is_its_own():
    """Who moved the particles of an estimate moved the filter, and wrote into his own stamps."""
    flight, found = histogram_flight("hall", frames=60), []
    texton_map = train_map(flight, rng=rng_of(1))
    for spoiled in (False, True):
        localizer, stamps = Localizer(texton_map, rng=rng_of(2)), flight.time.copy()
        for row in (*range(8), 30, 31):
            estimate = localizer.step(flight.histograms[row], time=stamps[row, ...])
            if spoiled and row < 31:
                estimate.particles[:] = estimate.position[:] = estimate.weights[:] = 9
        np.testing.assert_array_equal(stamps, flight.time)
        found.append(estimate.position)
    np.testing.assert_array_equal(*found)


def rng_of(seed):
    return np.random.default_rng(seed)


def test_histograms_alone_make_a_map_and_refuse_images():
    flight = small_flight()
    texton_map = train_map(flight, neighbors=3, rng=np.random.default_rng(0))
    assert texton_map.dictionary is None and texton_map.image_shape is None
    localizer = Localizer(texton_map, rng=np.random.default_rng(0))
    assert np.isfinite(localizer.step(flight.histograms[0]).position).all()
    with pytest.raises(MapError, match="holds no textons"):
        localizer.step(np.zeros((80, 100, 3), np.uint8))


@pytest.mark.parametrize("scale", [400, 0.1, -1])
def test_counts_are_not_taken_for_shares(scale):
    flight = small_flight()
    rows = flight.histograms.copy()
    rows[3] = 0  # a frame in which nothing was found
    texton_map = train_map(
        replace(flight, histograms=rows), neighbors=3, rng=np.random.default_rng(0)
    )
    localizer = Localizer(texton_map, rng=np.random.default_rng(0))
    with pytest.raises(MapError, match="relative frequencies, which sum to 1"):
        localizer.step(scale * flight.histograms[0])
    other = replace(flight, features="brightness", histograms=100 * flight.histograms)
    texton_map = train_map(other, neighbors=3, rng=np.random.default_rng(0))
    assert Localizer(texton_map, rng=np.random.default_rng(0)).step(other.histograms[0]).observed


@pytest.mark.parametrize("method", ["paper", "field"])
def test_a_frame_in_which_nothing_was_counted_is_taken(method):
    """Bags of words: a floor without a corner has no keypoints."""
    flight = histogram_flight("hall", frames=200)
    texton_map = train_map(flight, method=method, rng=np.random.default_rng(0))
    localizer = Localizer(texton_map, rng=np.random.default_rng(0))
    nothing = np.zeros(flight.histograms.shape[1])
    for histogram in [*flight.histograms[:20], nothing]:
        estimate = localizer.step(histogram)
    assert np.hypot(*(estimate.position - flight.position[20])) < 1


@pytest.mark.parametrize("samples", [1, 50, 400])
def test_shares_with_a_trace_of_the_last_frame_are_taken(samples):
    flight = small_flight()
    texton_map = train_map(flight, neighbors=3, rng=np.random.default_rng(0))
    traced = flight.histograms[1] + flight.histograms[0] / samples
    assert Localizer(texton_map, rng=np.random.default_rng(0)).step(traced).observed


def test_what_is_masked_is_no_frequency():
    flight = small_flight()
    texton_map = train_map(flight, neighbors=3, rng=np.random.default_rng(0))
    masked = np.ma.masked_less(flight.histograms[0], flight.histograms[0].max())
    with pytest.raises(MapError, match="finite frequencies"):
        Localizer(texton_map, rng=np.random.default_rng(0)).step(masked)


@pytest.mark.parametrize("method", ["paper", "field", "hmm"])
def test_a_copy_of_a_localizer_goes_on_alike(method):
    """Another process takes it as it is."""
    flight = histogram_flight("hall", frames=80)
    localizer = Localizer(
        train_map(flight, method=method, rng=np.random.default_rng(0)), rng=np.random.default_rng(0)
    )
    for histogram in flight.histograms[:5]:
        localizer.step(histogram)
    copy = pickle.loads(pickle.dumps(localizer))
    here, there = (each.step(flight.histograms[5]).position for each in (localizer, copy))
    np.testing.assert_array_equal(here, there)


def test_words_are_no_histogram():
    texton_map = train_map(small_flight(), neighbors=3, rng=np.random.default_rng(0))
    localizer = Localizer(texton_map, rng=np.random.default_rng(0))
    with pytest.raises(MapError, match="finite frequencies"):
        localizer.step(np.array(["a"] * texton_map.histograms.shape[1]))
    shares = small_flight().histograms[0]
    for odd, words in ((shares.tolist(), "a list was"), (shares[None], r"ndarray of shape \(1, ")):
        with pytest.raises(MapError, match=f"{words}.* given: this map takes an array of"):
            localizer.step(odd)
    for samples in (0, -3, 2.5):
        with pytest.raises(ParameterError, match=f"samples is {samples}: expected a whole number"):
            localizer.step(shares, samples=samples)
    with pytest.raises(ParameterError, match="texton_map is a str: expected a TextonMap, as"):
        Localizer("map.npz", rng=np.random.default_rng(0))
    with pytest.raises(ParameterError, match="samples is 1000000000: .* from 1 to 1000000"):
        Localizer(texton_map, samples=10**9, rng=np.random.default_rng(0))


def test_other_positions_may_train_and_frames_without_one_do_not():
    flight = small_flight()
    positions = flight.position + 1.0
    positions[3] = np.nan
    texton_map = train_map(flight, neighbors=3, rng=np.random.default_rng(0), positions=positions)
    assert len(texton_map.positions) == len(flight) - 1
    np.testing.assert_array_equal(texton_map.positions[0], positions[0])
    masked = train_map(
        flight, neighbors=3, rng=np.random.default_rng(0),
        positions=np.ma.masked_where(np.isnan(positions), flight.position + 1.0),
    )  # fmt: skip
    np.testing.assert_array_equal(masked.positions, texton_map.positions)
    with pytest.raises(MapError, match="at least 3"):
        train_map(flight, rng=np.random.default_rng(0), positions=np.full((40, 2), np.nan))
    with pytest.raises(ParameterError, match="one for each frame"):
        train_map(flight, rng=np.random.default_rng(0), positions=positions[:5])


@pytest.mark.parametrize(
    "options",
    [
        {"neighbors": 0}, {"samples": 0}, {"particles": 0}, {"recovery": "hope"},
        {"neighbors": 2.5}, {"samples": 2.5}, {"samples": "400"}, {"samples": True},
        {"particles": 2.5}, {"rng": 42}, {"rng": None},
    ],
)  # fmt: skip
def test_bad_options_are_refused(texton_map, options):
    with pytest.raises(ParameterError):
        Localizer(texton_map, **{"rng": np.random.default_rng(0)} | options)


@pytest.mark.parametrize(
    "options",
    [
        {"n_textons": 0}, {"n_textons": 257}, {"n_textons": 2.5}, {"patch": 0}, {"patch": 49},
        {"cells": 1.5}, {"rng": 42},
    ],
)  # fmt: skip
def test_maps_that_cannot_be_are_refused_before_anything_is_read(options):
    (name,) = options
    with pytest.raises(ParameterError, match=f"{name} is .*: expected"):
        train_map(small_flight(), **{"rng": np.random.default_rng(0)} | options)


def test_counts_of_numpy_are_counts(texton_map):
    counts = {"samples": np.int64(40), "particles": np.uint8(20), "neighbors": np.int32(2)}
    localizer = Localizer(texton_map, rng=np.random.default_rng(0), **counts)
    assert localizer.parts["filter"].as_dict()["particles"] == 20


def test_a_map_takes_a_generator_and_no_seed_wherever_it_learns(texton_map):
    with pytest.raises(ParameterError, match="default_rng\\(7\\)"):
        for_method(texton_map, "field", rng=7)
