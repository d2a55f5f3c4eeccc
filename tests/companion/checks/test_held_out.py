"""Stretches of a training flight, flown by maps that did not see them."""

import numpy as np
import pytest
from small_room import histogram_flight

from trexton.base.errors import MapError
from trexton.companion.checks.held_out import STRETCH_S, replay, stretches
from trexton.localization.cross_validation import WARM_S
from trexton.localization.training import train_map


@pytest.fixture(scope="module")
def plain():
    flight = histogram_flight("hall", frames=160, turns=6.0)
    return train_map(flight, rng=np.random.default_rng(1))


def test_replay_flies_what_its_map_did_not_see(plain):
    flown = list(replay(plain, samples=50, rng=np.random.default_rng(2)))
    every = stretches(plain.time)
    half = len(every) // 2
    settled = int(np.ceil(WARM_S / plain.period_s))
    assert len(flown) == 2 * sum(len(rows) - settled for rows in every[: 2 * half])
    first = every[0][settled:]
    np.testing.assert_array_equal([each.row for each in flown[: len(first)]], first)
    gaps = [np.hypot(*(each.neighbors.position - each.truth).T).min() for each in flown]
    assert min(gaps) > 0  # the frame itself is never its neighbour
    assert len(every[0]) * plain.period_s == pytest.approx(STRETCH_S + WARM_S, abs=0.3)
    short = np.arange(130) * 0.1  # two stretches of a short flight leave half of it
    every = stretches(short)
    left_out = {row for rows in (every[0], every[len(every) // 2]) for row in rows}
    assert len(left_out) < 70 and all(rows[-1] * 0.1 > WARM_S for rows in every)
    with pytest.raises(MapError, match="longer one"):
        stretches(np.arange(20) * 0.25)
