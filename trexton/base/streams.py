"""Randomness has names: every draw belongs to a stream, and no two streams meet. Offers `stream`,
which makes the generator of a seed and a name."""

import hashlib

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.options import whole

MOST_SEED = 2**32 - 1


def generator(rng: object) -> np.random.Generator:
    """`rng` itself; `ParameterError` where it is no generator, as where a seed was given."""
    if not isinstance(rng, np.random.Generator):
        seed = rng if isinstance(rng, (int, np.integer)) else 1
        raise ParameterError(
            f"rng is {rng!r}: expected a generator, as in rng=numpy.random.default_rng({seed})"
        )
    return rng


def stream(seed: int, name: str, *index: int) -> np.random.Generator:
    """A generator that depends on the seed, the stream's name, and the place in a series, on
    nothing else.

    Parameters
    ----------
    seed : int
        From 0 to `MOST_SEED`.
    name : str
        What is drawn, such as ``"landings"``.
    index : int
        Which of many, counted from 0.

    Raises
    ------
    ParameterError
        The seed or an index is out of range.
    """
    seed = whole(seed, "the seed", 0, MOST_SEED)
    if min(index, default=0) < 0:
        raise ParameterError(f"stream {name!r} has index {index}: expected 0 or more")
    word = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    key = (word & 0xFFFFFFFF, word >> 32, *(int(each) for each in index))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
