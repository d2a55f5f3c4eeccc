"""Named streams: equal where everything is equal, apart where anything differs."""

from itertools import combinations

import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.base.streams import MOST_SEED, stream


def test_equal_names_give_equal_numbers_and_others_do_not():
    keys = [(1, "landings"), (1, "landings", 0), (1, "landings", 1), (1, "landings", 0, 0)]
    keys += [(2, "landings"), (1, "flight"), (0, "landings"), (MOST_SEED, "landings")]
    drawn = [stream(*key).integers(2**62, size=4).tolist() for key in keys]
    for first, second in combinations(drawn, 2):
        assert not set(first) & set(second)
    assert drawn == [stream(*key).integers(2**62, size=4).tolist() for key in keys]


def test_the_numbers_are_the_same_on_every_machine():
    assert stream(1, "landings", 7).integers(1000, size=5).tolist() == PINNED
    together = np.array([stream(3, "flight", i).random(200) for i in range(50)])
    assert np.abs(np.corrcoef(together) - np.eye(50)).max() < 0.35


def test_what_is_out_of_range_is_refused():
    for seed in (-1, MOST_SEED + 1, 2.5, "1", None):
        with pytest.raises(ParameterError, match="seed"):
            stream(seed, "landings")
    with pytest.raises(ParameterError, match="index"):
        stream(1, "landings", -1)


PINNED = [94, 42, 600, 615, 243]
