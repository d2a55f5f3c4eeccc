"""The dictionary: exact learning, exact labels."""

from __future__ import annotations

import numpy as np
import pytest
from plain import plain_kohonen_steps

from trexton.base.errors import ImageError, MapError, ParameterError, TrextonError
from trexton.flights.folder import read_flight
from trexton.vision import kernels
from trexton.vision import textons as textons_module
from trexton.vision.images import draw_patches, gather_patches
from trexton.vision.textons import METHODS, TextonDictionary


def clusters(rng, n=3000, patch=2, noise=3.0):
    """Patches around four well separated centres, and the centre of each."""
    centres = rng.permutation(np.array([30, 90, 150, 210]))[:, None, None, None] + np.zeros(
        (4, patch, patch, 3)
    )
    which = rng.integers(4, size=n)
    return np.clip(
        np.rint(centres[which] + rng.normal(0, noise, (n, patch, patch, 3))), 0, 255
    ).astype(np.uint8), which


@pytest.mark.parametrize("method", METHODS)
def test_learning_follows_its_definition_to_the_bit(rng, method, monkeypatch):
    patches = rng.integers(0, 256, (700, 3, 3, 3), dtype=np.uint8)
    learned, plain = (
        TextonDictionary.learn(patches, 7, rng=np.random.default_rng(4), method=method)
        for _ in _with_plain_steps(monkeypatch)
    )
    assert learned.textons.tobytes() == plain.textons.tobytes()


def _with_plain_steps(monkeypatch):
    """First with the compiled kernel, then with `plain_kohonen_steps` in its place."""
    yield
    monkeypatch.setattr(kernels, "kohonen_steps", plain_kohonen_steps)
    yield


def test_textons_move_on_a_grid_and_large_patches_are_summed_in_double(rng):
    assert textons_module.GRAIN == 4096  # equal dictionaries on any machine hang on it
    small, large = (
        TextonDictionary(rng.integers(0, 256, (3, side, side, 3), dtype=np.uint8))
        for side in (6, 12)
    )
    assert (small.weights.dtype, large.weights.dtype) == (np.float32, np.float64)


def test_kohonen_finds_separated_clusters(rng):
    patches, which = clusters(rng)
    learned = TextonDictionary.learn(patches, 4, rng=rng)
    labels = learned.label(patches)
    assert (
        all(len(set(labels[which == cluster])) == 1 for cluster in range(4))
        and len(set(labels)) == 4
    )
    difference = patches.astype(float) - learned.textons[labels]
    assert np.sqrt(np.mean(difference**2)) < 4
    steps = np.diff(learned.textons.mean(axis=(1, 2, 3)))
    assert (steps > 0).all() or (steps < 0).all()  # neighbours on the chain are neighbours in grey


@pytest.mark.parametrize("method", METHODS)
def test_learning_does_not_care_which_value_is_which_or_how_bright_it_is(rng, method):
    patches = rng.integers(0, 200, (900, 3, 3, 3), dtype=np.uint8)

    def learned(of: np.ndarray) -> np.ndarray:
        dictionary = TextonDictionary.learn(of, 6, rng=np.random.default_rng(4), method=method)
        return dictionary.textons.astype(int).reshape(6, -1)

    textons, order = learned(patches), rng.permutation(27)
    shuffled = patches.reshape(-1, 27)[:, order].reshape(patches.shape)
    np.testing.assert_array_equal(learned(shuffled), textons[:, order])
    np.testing.assert_array_equal(learned(patches + np.uint8(50)), textons + 50)
    assert np.abs(learned(255 - patches) - (255 - textons)).max() <= 1  # halves round to even


def test_one_step_follows_the_published_rule(monkeypatch):
    """Winner-take-all with two textons: the nearer moves by a share of the difference, the
    other stays.
    """
    patches = np.array([10, 200, 60, 230], dtype=np.uint8)[:, None, None, None] + np.zeros(
        (4, 1, 1, 3), np.uint8
    )
    monkeypatch.setattr(textons_module, "WINNER_RATE", 0.2)
    monkeypatch.setattr(textons_module, "FIRST", 2)
    rng = np.random.default_rng(0)
    learned = TextonDictionary.learn(patches, 2, rng=rng, method="winner-take-all")
    low, high = 10.0, 200.0  # start
    low, high = low + 0.2 * (60 - low), high + 0.2 * (230 - high)
    assert sorted(learned.textons[:, 0, 0, 0].tolist()) == [round(low), round(high)]


def test_equal_seeds_equal_dictionaries_and_others_differ(rng):
    patches = rng.integers(0, 256, (500, 2, 2, 3), dtype=np.uint8)
    first, again, other = (
        TextonDictionary.learn(patches, 5, rng=np.random.default_rng(seed)).textons
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n_patches", [1, 3, 50])
def test_few_or_equal_patches_still_make_a_dictionary(rng, method, n_patches):
    grey = np.full((n_patches, 6, 6, 3), 77, np.uint8)
    dictionary = TextonDictionary.learn(grey, 20, rng=rng, method=method)
    assert (dictionary.textons == 77).all() and dictionary.n_textons == 20
    assert (dictionary.label(grey) == 0).all()


def test_learning_from_a_flight_uses_its_first_images(image_folder, rng):
    flight = read_flight(image_folder)
    learned = TextonDictionary.learn(
        flight, 3, 4, rng=np.random.default_rng(6), images=2, patches_per_image=30
    )
    patches = draw_patches(
        [flight.image(0), flight.image(1)], 4, 30, again := np.random.default_rng(6)
    )
    assert np.array_equal(learned.textons, TextonDictionary.learn(patches, 3, rng=again).textons)
    assert learned.patch == 4


def test_label_is_the_nearest_texton_the_lowest_of_equals(rng):
    for patch, levels in ((1, 256), (6, 2), (8, 256)):
        textons = (rng.integers(0, levels, (9, patch, patch, 3)) * (255 // (levels - 1))).astype(
            np.uint8
        )
        patches = (rng.integers(0, levels, (300, patch, patch, 3)) * (255 // (levels - 1))).astype(
            np.uint8
        )
        distance = ((patches[:, None].astype(int) - textons.astype(int)) ** 2).sum(axis=(2, 3, 4))
        labels = TextonDictionary(textons).label(patches)
        assert labels.dtype == np.int64 and np.array_equal(labels, distance.argmin(axis=1))
    assert TextonDictionary(textons).label(patches[:0]).shape == (0,)


def test_gathered_patches_are_cuts_of_the_image(rng):
    image = rng.integers(0, 256, (9, 8, 3), dtype=np.uint8)
    positions = np.array([[0, 0], [3, 2], [3, 2], [1, 0]])
    cuts = np.stack([image[row : row + 6, column : column + 6] for row, column in positions])
    assert np.array_equal(gather_patches(image, positions, 6), cuts)


def test_a_dictionary_is_frozen_and_keeps_its_own_copy(rng):
    source = rng.integers(0, 256, (3, 2, 2, 3), dtype=np.uint8)
    dictionary = TextonDictionary(source)
    source[:] = 0
    assert dictionary.textons.any()
    with pytest.raises(ValueError):
        dictionary.textons[0] = 0


def test_bad_input_is_one_clear_error(rng, flight_folder):
    patches = np.zeros((5, 6, 6, 3), np.uint8)
    cases = [
        (MapError, "found float64", lambda: TextonDictionary(np.zeros((20, 6, 6, 3)))),
        (MapError, r"\(20, 6, 5, 3\)", lambda: TextonDictionary(np.zeros((20, 6, 5, 3), np.uint8))),
        (MapError, "K up to 256", lambda: TextonDictionary(np.zeros((257, 1, 1, 3), np.uint8))),
        (ImageError, r"\(N, 6, 6, 3\)", lambda: TextonDictionary(patches).label(patches[:, :5])),
        (ImageError, "no patches", lambda: TextonDictionary.learn(patches[:0], rng=rng)),
        (
            ParameterError,
            "method 'som' is unknown",
            lambda: TextonDictionary.learn(patches, rng=rng, method="som"),
        ),
        (ParameterError, "n_textons is 2.5", lambda: TextonDictionary.learn(patches, 2.5, rng=rng)),
        (ParameterError, "rng is 3", lambda: TextonDictionary.learn(patches, rng=3)),
        (
            ParameterError,
            "images is -1",
            lambda: TextonDictionary.learn(patches, rng=rng, images=-1),
        ),
        (ParameterError, "n_textons is 0", lambda: TextonDictionary.learn(patches, 0, rng=rng)),
        (
            MapError,
            "has no images",
            lambda: TextonDictionary.learn(read_flight(flight_folder), rng=rng),
        ),
    ]
    for kind, message, call in cases:
        with pytest.raises(kind, match=message) as caught:
            call()
        assert isinstance(caught.value, TrextonError)
