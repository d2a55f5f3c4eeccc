"""The same bits on processors that this one is not."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from plain import plain_labels
from small_room import random_walk

from trexton.vision.kernels import compiled, label_rows

# Prints a digest of labels, dictionary and neighbours that depends on the seed alone.
PROGRAM = """
import numpy as np
from trexton.base.files import digest
from trexton.vision.histograms import label_image, texton_histogram
from trexton.localization.neighbors import NearestHistograms
from trexton.vision.textons import TextonDictionary
rng = np.random.default_rng(5)
patches = rng.integers(0, 256, (300, 6, 6, 3), dtype=np.uint8)
dictionary = TextonDictionary.learn(patches, 11, rng=rng)
image = rng.integers(0, 256, (40, 75, 3), dtype=np.uint8)
nearest = NearestHistograms(rng.dirichlet(np.ones(11), 1200), rng.normal(size=(1200, 2)))
found = [nearest.query(rng.dirichlet(np.ones(11))) for _ in range(20)]
print(digest(dictionary.textons, label_image(image, dictionary)[0],
             texton_histogram(image, dictionary),
             *(part for each in found for part in (each.index, each.distance, each.position))))
"""


def run(**environment):
    variables = {
        key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")
    } | environment
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=variables
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(scope="module")
def here():
    return run()


def test_threads_and_hash_seeds_change_nothing(here):
    assert (
        run(OMP_NUM_THREADS="1", PYTHONHASHSEED="1")
        == run(OMP_NUM_THREADS="2", PYTHONHASHSEED="2")
        == here
    )


def test_a_processor_without_vector_dot_products_gives_the_same_bits(here, request):
    compiled = str(request.config.cache.mkdir("generic_kernels"))  # kept for the next run
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": compiled}
    assert run(**plain) == here


def test_the_label_kernel_counts_what_it_labels(rng):
    from trexton.vision.textons import TextonDictionary

    dictionary = TextonDictionary(rng.integers(0, 256, (6, 4, 4, 3), dtype=np.uint8))
    image = rng.integers(0, 256, (12, 80, 3), dtype=np.uint8)
    labels, counts = np.empty((9, 77), np.uint8), np.ones(12, np.int64)
    down, right = np.zeros(9, np.int64), np.repeat([0, 6], [40, 37])
    words = dictionary.words, dictionary.words_bias
    label_rows(image.reshape(12, -1), *words, labels, counts, down, right)
    assert np.array_equal(labels, plain_labels(image, dictionary.textons))
    for part, first in ((labels[:, :40], 0), (labels[:, 40:], 6)):
        expected = 1 + np.bincount(part.ravel(), minlength=6)
        assert np.array_equal(counts[first : first + 6], expected)


def test_large_particle_sets_share_threads_and_keep_their_bits(rng, monkeypatch):
    """And equal the double sum, pairs further apart than exp(-500) aside."""

    motion = random_walk(np.array([[0.01, 0.004], [0.004, 0.02]]))
    particles, previous = rng.uniform(0, 6, (2100, 2)), rng.uniform(0, 3, (2100, 2))
    weights = rng.dirichlet(np.ones(2100))
    found = []
    for threads in ("1", "2", "3"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        found.append(motion.density(particles, previous, weights))
    assert found[0].tobytes() == found[1].tobytes() == found[2].tobytes()
    precision = np.linalg.inv([[0.01, 0.004], [0.004, 0.02]])
    for row in range(0, 2100, 50):
        difference = particles[row] - previous
        exponent = -0.5 * np.einsum("ja,ab,jb->j", difference, precision, difference)
        expected = np.log(np.exp(np.maximum(exponent, -500)) @ weights)
        assert found[0][row] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_what_cannot_be_kept_is_compiled_all_the_same(monkeypatch):
    """A service without a home had a traceback for each kernel."""

    def homeless(cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return numba.njit(**options)

    monkeypatch.setattr("trexton.vision.kernels.njit", homeless)
    assert compiled()(lambda x: x + 1)(2) == 3
