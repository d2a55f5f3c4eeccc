"""A map's file is not trusted: values and sizes are checked, and it decides no code that runs."""

import json
import os
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from small_room import histogram_flight
from test_methods import OWN

from trexton.base.errors import DataError, MapError
from trexton.localization.map_files import (
    DAMAGE,
    from_arrays,
    load_map,
    read_arrays,
    save_map,
    to_arrays,
)
from trexton.localization.training import train_map, with_choices
from trexton.vision.textons import TextonDictionary


@pytest.fixture(scope="module")
def texton_map():
    return train_map(histogram_flight("hall", frames=80), rng=np.random.default_rng(1))


def stored(path, texton_map, **changes):
    """The map's file with some arrays replaced (None: left out)."""
    arrays = to_arrays(texton_map) | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def with_value(array, value):
    changed = np.array(array)
    changed.flat[0] = value
    return changed


def header(texton_map, **changes):
    found = json.loads(to_arrays(texton_map)["header"].tobytes())
    return np.frombuffer(json.dumps(found | changes).encode(), np.uint8)


BAD = {
    "nan": lambda m: {"histograms": with_value(m.histograms, np.nan)},
    "negative": lambda m: {
        "histograms": with_value(m.histograms, -0.1), "image_shape": np.array([8, 8]),
        "textons": np.zeros((m.histograms.shape[1], 2, 2, 3), np.uint8),
    },
    "complex": lambda m: {"histograms": m.histograms.astype(complex)},
    "flat": lambda m: {"histograms": m.histograms.ravel()},
    "none": lambda m: {"histograms": m.histograms[:0]},
    "too few positions": lambda m: {"positions": m.positions[1:]},
    "infinite position": lambda m: {"positions": with_value(m.positions, np.inf)},
    "time runs back": lambda m: {"time": m.time[::-1]},
    "no area": lambda m: {"area": np.zeros(4)},
    "half an area": lambda m: {"area": np.zeros(3)},
    "nan area": lambda m: {"area": np.array([0, np.nan, 0, 1])},
    "period nan": lambda m: {"period_s": np.float64(np.nan)},
    "period zero": lambda m: {"period_s": np.float64(0)},
    "period many": lambda m: {"period_s": np.ones(3)},
    "three rows": lambda m: {"image_shape": np.array([4, 4, 4])},
    "no rows": lambda m: {"image_shape": np.array([0, 4])},
    "textons": lambda m: {
        "textons": np.zeros((3, 2, 2, 3), np.uint8), "image_shape": np.array([8, 8])
    },
    "textons, no shape": lambda m: {"textons": np.zeros((5, 2, 2, 3), np.uint8)},
    "motion nan": lambda m: {"motion.covariance": np.full((2, 2), np.nan)},
    "motion period": lambda m: {"motion.period_s": np.float64(-1)},
    "ranks": lambda m: {"measurement.covariances": np.zeros((5, 2, 2))},
    "rank count": lambda m: {"measurement.covariances": np.ones((3, 2, 2))},
    "motion learned nothing": lambda m: {"motion.covariance": None, "motion.period_s": None},
    "motion without period": lambda m: {"motion.period_s": None},
    "ranks learned nothing": lambda m: {"measurement.covariances": None},
    "foreign array": lambda m: {"motion.speed": np.ones(2)},
    "no time": lambda m: {"time": None},
    "no parts": lambda m: {"header": header(m, parts={})},
    "parts wrong": lambda m: {"header": header(m, parts=[1])},
    "no header": lambda m: {"header": np.zeros(5, np.uint8)},
    "old": lambda m: {"schema": np.int64(1)},
    "unknown role": lambda m: {
        "header": header(m, parts={"colour": {"name": "red", "options": {}}})
    },
    "odd option": lambda m: {
        "header": header(m, parts={"filter": {"name": "particles", "options": {"particles": "x"}}})
    },
    "too many particles": lambda m: {
        "header": header(
            m, parts={"filter": {"name": "particles", "options": {"particles": 100_000_000}}}
        )
    },
    "foreign code": lambda m: {
        "header": header(m, parts={"distance": {"name": "antigravity:Fly", "options": {}}})
    },
    "deep": lambda m: {"header": np.frombuffer(b"[" * 100_000, np.uint8)},
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_what_no_training_gives_is_one_sentence(kind, texton_map, tmp_path):
    path = stored(tmp_path / "map.npz", texton_map, **BAD[kind](texton_map))
    with pytest.raises(MapError, match=r"map\.npz: "):
        load_map(path)


def test_whole_maps_load(texton_map, tmp_path):
    stored(tmp_path / "map.npz", texton_map)
    again = load_map(tmp_path / "map.npz")
    for name, array in to_arrays(texton_map).items():
        np.testing.assert_array_equal(to_arrays(again)[name], array)


def test_maps_of_the_schema_before_load(texton_map, tmp_path):
    again = load_map(stored(tmp_path / "map.npz", texton_map, schema=np.int64(2)))
    np.testing.assert_array_equal(again.histograms, texton_map.histograms)


@pytest.mark.parametrize("counted", [True, False])
def test_frequencies_are_stored_as_what_was_counted(counted, texton_map, tmp_path, rng):
    counts = rng.multinomial(23 * 31, np.full(5, 0.2), len(texton_map.histograms))
    frequencies = counts / counts.sum(axis=1, keepdims=True)
    whole = replace(
        texton_map,
        dictionary=TextonDictionary(np.zeros((5, 2, 2, 3), np.uint8)),
        image_shape=(24, 32),
        histograms=frequencies if counted else frequencies * (1 + 1e-9),
    )
    again = load_map(save_map(whole, tmp_path / "map.npz"))
    np.testing.assert_array_equal(again.histograms, whole.histograms)
    names = {"counts", "histograms"} & read_arrays(tmp_path / "map.npz").keys()
    assert names == {"counts" if counted else "histograms"}


def test_maps_of_other_features_and_of_whole_numbers_load(tmp_path):
    flight = histogram_flight("hall", frames=80)
    for changes in (
        {"histograms": flight.histograms - 0.5, "features": "something else"},
        {"position": np.round(flight.position * 100).astype(int), "time": np.arange(80)},
    ):
        train = replace(flight, area=(-500.0, 1000.0, -500.0, 1000.0), **changes)
        texton_map = train_map(train, rng=np.random.default_rng(1))
        again = load_map(save_map(texton_map, tmp_path / "map.npz"))
        np.testing.assert_array_equal(again.histograms, texton_map.histograms)


def test_neighbours_are_no_more_than_frames(texton_map, tmp_path):
    few = {"histograms": texton_map.histograms[:4], "positions": texton_map.positions[:4]}
    path = stored(tmp_path / "map.npz", texton_map, time=texton_map.time[:4], **few)
    with pytest.raises(MapError, match="neighbours are at most 4"):
        load_map(path)
    kept = path.read_bytes()
    few = replace(texton_map, time=texton_map.time[:4], **few)
    with pytest.raises(MapError, match="neighbours are at most 4"):
        save_map(few, path)
    assert path.read_bytes() == kept


def test_a_map_of_a_method_that_is_gone_says_what_to_do():
    arrays = to_arrays(train_map(histogram_flight("hall", frames=80), rng=np.random.default_rng(0)))
    header = json.loads(arrays["header"].tobytes())
    header["parts"]["view"] = {"name": "nadir", "options": {}}
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with pytest.raises(MapError, match="gone, train it again with trexton train --method field"):
        from_arrays(arrays)


@pytest.mark.parametrize("yaw", [np.zeros(2), np.float64(np.inf), np.array("north")])
def test_the_yaw_of_a_survey_is_one_number(yaw):
    flight = histogram_flight("hall", frames=60)
    arrays = to_arrays(train_map(flight, method="field", rng=np.random.default_rng(0)))
    assert from_arrays(arrays | {"appearance.survey_yaw": np.array(np.nan)})  # it had no heading
    with pytest.raises(MapError, match="the survey's yaw is .*: train the map again"):
        from_arrays(arrays | {"appearance.survey_yaw": yaw})


def test_a_field_takes_as_many_features_as_its_map_has():
    flight = histogram_flight("hall", frames=60)
    arrays = to_arrays(train_map(flight, method="field", rng=np.random.default_rng(0)))
    arrays["measurement.axes"] = arrays["measurement.axes"][:-1]
    with pytest.raises(MapError, match="axes are those of 5 features"):
        from_arrays(arrays)


def test_a_file_does_not_decide_which_code_runs(texton_map, tmp_path):
    own = with_choices(texton_map, {"distance": OWN})
    assert (
        type(load_map(save_map(own, tmp_path / "own.npz")).parts["distance"]).__name__ == "Cosine"
    )
    parts = {"distance": {"name": "this:Zen", "options": {}}}
    path = stored(tmp_path / "map.npz", texton_map, header=header(texton_map, parts=parts))
    with pytest.raises(MapError, match="not of the library: name its module with --plugin this"):
        load_map(path)


def test_files_that_would_unpack_to_more_are_refused(texton_map, tmp_path):
    path = tmp_path / "map.npz"
    np.savez_compressed(path, **to_arrays(texton_map) | {"histograms": np.zeros((10**6, 20))})
    with pytest.raises(MapError, match="would unpack"):
        load_map(path)
    stored(path, texton_map)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    whole = b"'shape': (80, 2), "
    assert whole in members["positions.npy"]
    members["positions.npy"] = members["positions.npy"].replace(whole, b"'shape': (8000, 2),")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(MapError):
        load_map(path)


def test_pipes_and_folders_are_refused_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(MapError, match="not a regular file"):
            load_map(path)


def test_a_dictionary_needs_images_to_fit(texton_map, tmp_path):
    textons = np.zeros((5, 2, 2, 3), np.uint8)
    path = stored(tmp_path / "map.npz", texton_map, textons=textons, image_shape=np.array([24, 32]))
    loaded = load_map(path)
    assert isinstance(loaded.dictionary, TextonDictionary) and loaded.image_shape == (24, 32)


def test_a_byte_that_changed_in_a_header_is_damage(tmp_path):
    """Python's tokenizer reads it, and has errors of its own."""
    np.savez(tmp_path / "map.npz", histograms=np.zeros((400, 20)))  # too large to be read at once
    sound = (tmp_path / "map.npz").read_bytes()
    begin, refused = sound.find(b"\x93NUMPY"), 0
    for place in range(begin, begin + 128):
        for flip in (1, 2, 4, 8, 16, 32, 64, 128, 255):
            damaged = bytearray(sound)
            damaged[place] ^= flip
            (path := tmp_path / "damaged.npz").write_bytes(damaged)
            try:
                read_arrays(path)
            except (DataError, *DAMAGE):
                refused += 1
    assert refused > 900
