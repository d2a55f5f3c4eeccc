"""The hidden Markov model: settings from left-out stretches, positions and what they claim."""

import numpy as np
from small_room import histogram_flight

from trexton.localization.hidden_markov import CHI2_90, _lacking
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
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
