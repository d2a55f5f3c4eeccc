"""Histograms against the plain definition, over threads and sizes."""

from __future__ import annotations

import numpy as np
import pytest
from plain import plain_histogram, plain_labels

from trexton.base.errors import ImageError, ParameterError
from trexton.vision.histograms import (
    label_image,
    sample_positions,
    sampled_histogram,
    texton_histogram,
)
from trexton.vision.images import gather_patches
from trexton.vision.textons import TextonDictionary
from trexton.vision.threads import ahead, in_strips, thread_count


def random_case(rng, n_textons=20, patch=6, shape=(24, 32), levels=256):
    """A dictionary and an image; few `levels` make many ties."""
    step = 256 // levels
    textons = rng.integers(0, levels, (n_textons, patch, patch, 3)) * step
    return TextonDictionary(textons.astype(np.uint8)), (
        rng.integers(0, levels, (*shape, 3)) * step
    ).astype(np.uint8)


def test_two_hundred_images_equal_the_plain_definition(rng):
    for index in range(200):
        shape = (int(rng.integers(6, 17)), int(rng.integers(6, 23)))
        dictionary, image = random_case(rng, shape=shape, levels=256 if index % 2 else 2)
        expected = plain_histogram(image, dictionary.textons)
        assert texton_histogram(image, dictionary).tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("n_textons", "patch", "shape"),
    [
        (1, 1, (1, 1)),
        (3, 2, (2, 2)),
        (4, 5, (9, 71)),
        (7, 8, (17, 70)),
        (21, 3, (5, 68)),
        (256, 7, (9, 13)),
        (2, 48, (50, 49)),
    ],
)
def test_other_sizes_equal_the_plain_definition(rng, n_textons, patch, shape):
    dictionary, image = random_case(rng, n_textons, patch, shape)
    assert np.array_equal(
        label_image(image, dictionary)[0], plain_labels(image, dictionary.textons)
    )


@pytest.mark.parametrize("value", [0, 255])
def test_extreme_bytes_do_not_overflow(value):
    textons = np.stack([np.full((48, 48, 3), 255 - value), np.full((48, 48, 3), value)]).astype(
        np.uint8
    )
    image = np.full((48, 48, 3), value, np.uint8)
    assert label_image(image, TextonDictionary(textons))[0].tolist() == [[1]]


def test_any_number_of_threads_gives_the_same_labels(rng, monkeypatch):
    dictionary, image = random_case(rng, shape=(121, 643), levels=8)
    labels = []
    for threads in "123":
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        labels.append(label_image(image, dictionary)[0])
    assert all(np.array_equal(labels[0], other) for other in labels[1:])
    assert np.array_equal(
        dictionary.label(gather_patches(image, np.argwhere(labels[0] >= 0), 6)), labels[0].ravel()
    )


def test_views_are_images_too(rng):
    dictionary, image = random_case(rng, shape=(20, 30))
    view = np.flip(image, axis=1)[::2]
    image.flags.writeable = False
    assert np.array_equal(label_image(view, dictionary)[0], label_image(view.copy(), dictionary)[0])
    first, second = (
        sampled_histogram(array, dictionary, 50, rng=np.random.default_rng(1))
        for array in (view, view.copy())
    )
    assert np.array_equal(first, second)


def test_permuting_the_textons_permutes_the_histogram(rng):
    dictionary, image = random_case(rng)
    order = rng.permutation(dictionary.n_textons)
    permuted = TextonDictionary(dictionary.textons[order])
    assert np.array_equal(
        texton_histogram(image, permuted), texton_histogram(image, dictionary)[order]
    )
    first, second = (
        sampled_histogram(image, d, rng=np.random.default_rng(3)) for d in (permuted, dictionary)
    )
    assert np.array_equal(first, second[order])


def test_the_first_of_equal_textons_takes_all(rng):
    dictionary, image = random_case(rng, n_textons=5)
    twice = TextonDictionary(np.concatenate([dictionary.textons, dictionary.textons]))
    histogram = texton_histogram(image, twice)
    assert np.array_equal(histogram[:5], texton_histogram(image, dictionary))
    assert not histogram[5:].any()


def test_sampled_histograms_converge_at_one_over_root_n(rng):
    """Mean squared error of each frequency is p (1 - p) / n: the sum over textons within six
    standard errors.
    """
    dictionary, image = random_case(rng, n_textons=6, shape=(40, 50))
    full = texton_histogram(image, dictionary)
    for n in (25, 100, 400, 1600):
        errors = np.array(
            [
                ((sampled_histogram(image, dictionary, n, rng=rng) - full) ** 2).sum()
                for _ in range(300)
            ]
        )
        expected = (full * (1 - full)).sum() / n
        assert abs(errors.mean() - expected) < 6 * errors.std() / np.sqrt(len(errors))


def test_sampled_histogram_counts_the_drawn_positions(rng):
    dictionary, image = random_case(rng, shape=(30, 21))
    labels = plain_labels(image, dictionary.textons)
    positions = sample_positions(image.shape, 6, 77, np.random.default_rng(5))
    expected = np.bincount(labels[tuple(positions.T)], minlength=20) / 77
    assert np.array_equal(
        sampled_histogram(image, dictionary, 77, rng=np.random.default_rng(5)), expected
    )


def test_positions_cover_the_image_evenly(rng):
    positions = sample_positions((9, 11, 3), 6, 24_000, rng)
    counts = np.bincount(positions[:, 0] * 6 + positions[:, 1], minlength=24)
    assert counts.shape == (24,)  # 4 x 6 places
    chi_squared = ((counts - 1000) ** 2 / 1000).sum()
    assert chi_squared < 23 + 6 * np.sqrt(2 * 23)


def test_bad_input_is_one_clear_error(rng):
    dictionary, image = random_case(rng)
    with pytest.raises(ImageError, match="5x20 pixels, a patch 6x6"):
        texton_histogram(image[:20, :5], dictionary)
    with pytest.raises(ImageError, match="uint8"):
        texton_histogram(image.astype(float), dictionary)
    with pytest.raises(ImageError, match="found list"):
        sampled_histogram([1, 2], dictionary, rng=rng)
    with pytest.raises(ParameterError, match="samples is 0"):
        sampled_histogram(image, dictionary, 0, rng=rng)


def test_strips_cover_all_rows_once_and_pass_errors_on(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert [list(range(10))[strip] for strip in in_strips(lambda strip: strip, 10)] == [
        [0, 1, 2],
        [3, 4, 5],
        [6, 7, 8, 9],
    ]
    assert in_strips(lambda strip: strip, 1) == [slice(0, 1)]
    with pytest.raises(ZeroDivisionError):
        in_strips(lambda strip: 1 / (strip.start - 6), 10)


def test_items_are_worked_on_ahead_in_their_order(monkeypatch):
    for threads in ("1", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        taken = []
        numbers = ahead(lambda number: number**2, (taken.append(i) or i for i in range(100)))
        assert next(numbers) == 0 and len(taken) < 8  # no more of them wait than are worked on
        assert list(numbers) == [i**2 for i in range(1, 100)]
        assert list(ahead(lambda _: thread_count(), range(3))) == [1, 1, 1]
        with pytest.raises(ZeroDivisionError):
            list(ahead(lambda number: 1 / (number - 6), range(10)))


def test_thread_count_follows_the_environment(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert thread_count() == 3
    monkeypatch.setenv("OMP_NUM_THREADS", "")
    assert thread_count() >= 1


@pytest.mark.parametrize("cells", [2, 3])
def test_parts_of_an_image_add_up_to_the_whole(cells):
    rng = np.random.default_rng(4)
    dictionary, image = random_case(rng, n_textons=7, shape=(50, 61))
    parts = texton_histogram(image, dictionary, cells=cells)
    assert parts.shape == (7 * cells**2,)
    whole = parts.reshape(-1, 7).sum(axis=0)
    np.testing.assert_allclose(whole, texton_histogram(image, dictionary))
    drawn = sampled_histogram(image, dictionary, 20000, rng=rng, cells=cells)
    np.testing.assert_allclose(drawn, parts, atol=0.02)


def test_the_first_part_is_the_upper_left_of_the_image():
    image = np.zeros((46, 46, 3), dtype=np.uint8)
    image[:23, :23] = 200
    dictionary = TextonDictionary(
        np.stack([np.zeros((6, 6, 3)), np.full((6, 6, 3), 200)]).astype(np.uint8)
    )
    parts = texton_histogram(image, dictionary, cells=2).reshape(4, 2)
    assert parts[0, 1] > 0.2 and (parts[1:, 0] > 0.2).all()


@pytest.mark.parametrize("cells", [0, -1, 1.5])
def test_cells_that_are_none_are_refused(rng, cells):
    image = rng.integers(0, 256, (20, 20, 3), dtype=np.uint8)
    words = TextonDictionary(rng.integers(0, 256, (4, 6, 6, 3), dtype=np.uint8))
    with pytest.raises(ParameterError, match=f"cells is {cells}"):
        texton_histogram(image, words, cells=cells)
    with pytest.raises(ParameterError, match=f"cells is {cells}"):
        sampled_histogram(image, words, 10, rng=rng, cells=cells)


@pytest.mark.parametrize("count", [2.5, 10**9])
def test_samples_are_a_count_that_memory_holds(rng, count):
    with pytest.raises(ParameterError, match="the number of samples is"):
        sample_positions((20, 20), 6, count, rng)


def test_without_compiled_code_labels_are_refused_in_a_sentence(rng, monkeypatch):
    monkeypatch.setattr("numba.config.DISABLE_JIT", 1)
    with pytest.raises(ParameterError, match="unset NUMBA_DISABLE_JIT"):
        label_image(*reversed(random_case(rng)))
