"""The hidden Markov model: settings from left-out stretches, positions and what they claim."""

import numpy as np
from small_room import histogram_flight

from trexton.localization.estimate import CHI2_90
from trexton.localization.hidden_markov import (
    ForwardFilter,
    HiddenMarkov,
    _lacking,
    _transition,
)
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.neighbors import Euclidean
from trexton.localization.observation import Observation
from trexton.localization.training import train_map


def test_it_trains_is_stored_and_flies(tmp_path):
    flight = histogram_flight("hall", frames=120)
    texton_map = train_map(flight, method="hmm", rng=np.random.default_rng(1))
    stored = load_map(save_map(texton_map, tmp_path / "map.npz"))
    localizer = Localizer(stored, rng=np.random.default_rng(2))
    again = histogram_flight("again", frames=60, noise=2)
    estimates = [localizer.step(each) for each in again.histograms]
    off = np.array([each.position for each in estimates]) - again.position
    guess = flight.position.mean(axis=0) - again.position
    assert np.hypot(*off.T).mean() < 0.5 * np.hypot(*guess.T).mean()
    before = np.trace(estimates[-1].covariance)
    assert np.trace(localizer.step(None).covariance) > before


def test_what_the_spread_lacks_is_added_until_nine_in_ten_errors_are_held():
    off = np.random.default_rng(1).normal(0, 0.3, (2000, 2))
    sigma = _lacking(off, np.zeros((2000, 2, 2)))
    assert 0.3 <= sigma <= 0.34  # steps of a tenth
    held = np.square(off).sum(axis=1) <= CHI2_90 * sigma**2
    assert 0.9 <= held.mean() <= 0.95


def nees_of_a_flight(seed: int, claimed: float = 1.0) -> float:
    """Of a vehicle that walks from state to state and is seen as the model takes it."""
    rng = np.random.default_rng(seed)
    places, rows = rng.uniform((0, 0), (4, 3), (80, 2)), rng.normal(size=(80, 6))
    sigma, emission = 0.2, 1.0
    learned = HiddenMarkov().with_learned(
        emission=np.array(emission), reach=np.array(0.5), sigma=np.array(claimed * sigma)
    )
    flown = ForwardFilter(places, rows, Euclidean(), learned)
    walk, state = _transition(places, 0.5), rng.integers(len(places))
    for _ in range(15):
        state = rng.choice(len(places), p=walk[:, state])
        seen = rows[state] + emission * rng.normal(size=6)
        flown.step(Observation(histogram=lambda seen=seen: seen))
    estimate = flown.estimate()
    offset = places[state] + sigma * rng.normal(size=2) - estimate.position
    return float(offset @ np.linalg.solve(estimate.covariance, offset))


def test_nees_is_in_its_band_where_the_model_is_true():
    """Flights are the units: each has a map and a path of its own. A belief over states is no
    Gaussian, so the band comes from what flights differ by, not from a chi-squared.
    """
    nees = np.array([nees_of_a_flight(seed) for seed in range(1000)])
    reach = 3.3 * nees.std(ddof=1) / np.sqrt(len(nees))
    assert abs(nees.mean() - 2) < reach < 0.5
    for claimed, side in ((0.5, 1), (2.0, -1)):
        other = np.array([nees_of_a_flight(seed, claimed) for seed in range(400)])
        assert side * (other.mean() - 2) > reach
