"""Parts and methods: found by name, options checked, learned arrays in and out, trained anew from a
map.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from small_room import histogram_flight, random_walk

from trexton.base.errors import MapError, ParameterError
from trexton.localization.base import Part, learned
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.map_files import load_map, save_map
from trexton.localization.methods import (
    METHODS,
    ROLES,
    changed,
    compose,
    fitting,
    make,
    name_of,
    parse_choices,
)
from trexton.localization.motion import RandomWalk
from trexton.localization.neighbors import Euclidean, Hellinger, NearestHistograms
from trexton.localization.training import for_method, train_map, with_choices
from trexton.localization.training_set import training_set


@dataclass(eq=False)
class Cosine(Euclidean):
    """A distance of one's own."""

    power: float = 1.0
    shift: int = 0
    halve: bool = False

    def features(self, histograms):
        length = np.linalg.norm(histograms, axis=-1, keepdims=True)
        return (histograms / length) ** self.power


OWN = f"{__name__}:Cosine"


def trained(**choices) -> TextonMap:
    flight = histogram_flight("hall", frames=80)
    return train_map(flight, rng=np.random.default_rng(1), **choices)


def flown(texton_map, **options) -> np.ndarray:
    flight = histogram_flight("again", frames=30, noise=2)
    localizer = Localizer(texton_map, rng=np.random.default_rng(3), **options)
    return np.array([localizer.step(each).position for each in flight.histograms])


@pytest.mark.parametrize("role", ROLES)
def test_every_part_in_the_table_can_be_made_and_is_called_so(role):
    for name in ROLES[role]:
        part = make(role, name)
        assert isinstance(part, Part) and name_of(role, part) == name
        assert type(part).__doc__


@pytest.mark.parametrize(
    "choices",
    [
        {"motion": "trexton.localization.neighbors:Hellinger"},
        {"motion": Hellinger()},
        {"motion": "trexton.localization.motion:MotionModel"},  # a base does nothing
    ],
)
def test_a_part_of_another_role_is_refused(choices):
    with pytest.raises(ParameterError, match="expected a subclass of trexton.localization."):
        changed(compose("paper"), choices)


@pytest.mark.parametrize("method", METHODS)
def test_a_method_names_parts_of_known_roles(method):
    parts = compose(method)
    assert set(parts) <= set(ROLES) and fitting(parts, parts) == parts


def test_a_part_of_ones_own_needs_no_entry(tmp_path):
    texton_map = trained(distance=OWN)
    assert isinstance(texton_map.parts["distance"], Cosine)
    again = load_map(save_map(texton_map, tmp_path / "map.npz"))
    assert isinstance(again.parts["distance"], Cosine)
    np.testing.assert_array_equal(flown(texton_map), flown(again))
    assert not np.array_equal(flown(texton_map), flown(trained()))


def test_one_distance_serves_training_and_flight():
    texton_map = trained(distance="hellinger")
    assert isinstance(texton_map.parts["distance"], Hellinger)
    squared = np.sqrt(texton_map.histograms / 2)
    rows = training_set(texton_map).neighbors(3, 0.5)
    row = 20
    allowed = np.abs(texton_map.time - texton_map.time[row]) > 0.5 + 1e-9
    distance = np.where(allowed, np.linalg.norm(squared - squared[row], axis=1), np.inf)
    np.testing.assert_array_equal(rows[row], np.argsort(distance, kind="stable")[:3])
    localizer = Localizer(texton_map, rng=np.random.default_rng(0))
    found = localizer.nearest.query(texton_map.histograms[row])
    np.testing.assert_allclose(found.distance[0], 0, atol=1e-12)
    second = np.sort(np.linalg.norm(squared - squared[row], axis=1))[1]
    np.testing.assert_allclose(found.distance[1], second)


def test_choices_in_training_and_in_flight_come_to_the_same():
    at_training = trained(**{"motion.sigma": 0.3, "measurement.neighbors": "4"})
    assert at_training.neighbors == 4
    in_flight = flown(trained(), **{"motion.sigma": "0.3", "measurement.neighbors": 4})
    np.testing.assert_array_equal(flown(at_training), in_flight)
    # The first ranks are what they are, however many were learned.
    np.testing.assert_array_equal(flown(at_training), flown(at_training, neighbors=4))
    np.testing.assert_array_equal(
        flown(trained(), neighbors=4, motion=RandomWalk(sigma=0.3)), in_flight
    )


def test_parts_that_stay_keep_what_they_learned():
    texton_map = trained()
    other = with_choices(texton_map, {"filter.particles": 80, "recovery": "augmented"})
    for role in ("motion", "measurement", "distance"):
        assert other.parts[role] is texton_map.parts[role]
    assert other.parts["filter"].particles == 80
    assert with_choices(texton_map, {"recovery": "none", "filter.particles": 50}) is texton_map
    assert for_method(texton_map, "paper") is texton_map


def test_some_rows_of_a_training_set_with_the_parts_of_all():
    texton_map = trained()
    some = texton_map.select(np.arange(len(texton_map.time)) % 3 == 0)
    for name in ("histograms", "positions", "time"):
        np.testing.assert_array_equal(getattr(some, name), getattr(texton_map, name)[::3])
    assert some.parts is texton_map.parts


def test_a_localizer_may_fly_another_method(monkeypatch):
    monkeypatch.setitem(METHODS, "roots", METHODS["paper"] | {"distance": "hellinger"})
    here = flown(trained(), method="roots")
    np.testing.assert_array_equal(here, flown(trained(method="roots")))
    assert for_method(trained(), "roots").method == "roots"


def test_the_growth_is_that_of_the_motion():
    walk = random_walk(0.04 * np.eye(2), 0.1)
    np.testing.assert_array_equal(walk.growth(0.1), walk.covariance)
    np.testing.assert_allclose(walk.growth(1.0), 0.4 * np.eye(2))
    localizer = Localizer(trained(motion=RandomWalk(sigma=0.2)), rng=np.random.default_rng(0))
    np.testing.assert_allclose(localizer.parts["motion"].growth(0.25), 0.04 * np.eye(2))
    states = walk.start(np.random.default_rng(0), (1.0, 2.0, 5.0, 9.0), 500)
    assert states.min(axis=0)[0] >= 1 and states.max(axis=0)[1] <= 9
    assert walk.position(states) is states


@pytest.mark.parametrize(
    "choices",
    [
        {"colour": "red"},
        {"motion": "teleport"},
        {"motion": "no_such_module:Walk"},
        {"motion": "trexton.base.errors:MapError"},
        {"motion": 3},
        {"motion.speed": 1},
        {"motion.sigma": "fast"},
        {"colour.depth": 1},
        {"measurement.neighbors": 2.5},
        {"measurement.neighbors": True},
        {"measurement.neighbors": "0"},
        {"filter.particles": "100000000"},
        {"recovery.fast": 0.001},
    ],
)
def test_what_is_not_so_is_one_clear_error(choices):
    with pytest.raises(ParameterError, match="choose|expected|has no parameter|check its name"):
        changed(compose("paper"), choices)
    with pytest.raises(ParameterError, match="choose one of paper"):
        compose("magic")


@pytest.mark.parametrize(
    ("method", "choices", "message"),
    [
        ("field", {"recovery": "augmented"}, "recovery would change nothing: with filter 'tracks'"),
        ("field", {"estimation": "mean"}, "estimation would change nothing"),
        ("field", {"resampling": "systematic"}, "resampling would change nothing"),
        ("field", {"distance": "euclidean"}, "distance would change nothing"),
        ("field", {"motion": "random-walk"}, "'random-walk' does not fit filter 'tracks'"),
        ("field", {"measurement": "rank-mixture"}, "needs a Field: choose one of field"),
        ("fine", {"recovery": "augmented"}, "recovery would change nothing"),
        ("paper", {"odometry": "visual"}, "odometry would change nothing"),
        ("paper", {"filter": "tracks"}, "does not fit filter 'tracks'"),
    ],
)
def test_a_choice_that_nothing_reads_or_that_does_not_fit_is_refused(method, choices, message):
    with pytest.raises(ParameterError, match=message):
        changed(compose(method), choices)
    flight = histogram_flight("hall", frames=80)
    with pytest.raises(ParameterError, match=message):
        train_map(flight, method=method, rng=np.random.default_rng(1), **choices)


def test_chi_square_is_the_plain_formula_in_training_and_in_flight():
    rng = np.random.default_rng(5)
    rows, query = rng.dirichlet(np.ones(8), 40), rng.dirichlet(np.ones(8))
    rows[:, 2] = query[2] = 0
    plain = [
        sum((a - b) ** 2 / (a + b) for a, b in zip(query, row, strict=True) if a + b) / 2
        for row in rows
    ]
    distance = make("distance", "chi-square")
    np.testing.assert_allclose(distance.between(query[None], rows)[0], plain, rtol=1e-12)
    nearest = NearestHistograms(rows, rng.uniform(size=(40, 2)), k=4, distance=distance)
    found = nearest.query(query)
    np.testing.assert_array_equal(found.index, np.argsort(plain)[:4])
    np.testing.assert_allclose(found.distance, np.sort(plain)[:4], rtol=1e-12)
    assert not np.array_equal(flown(trained(distance="chi-square")), flown(trained()))


def test_words_of_a_command_line():
    assert parse_choices(["motion.sigma=0.2", "distance=a:B=c"]) == {
        "motion.sigma": "0.2",
        "distance": "a:B=c",
    }
    for word in ("motion", "=2"):
        with pytest.raises(ParameterError, match="expected role=part"):
            parse_choices([word])
    with pytest.raises(ParameterError, match="--set has motion.sigma twice, '1' and '2'"):
        parse_choices(["motion.sigma=1", "distance=hellinger", "motion.sigma=2"])
    own = Cosine.parse({"power": "2", "halve": "yes", "shift": "-3"})
    assert own.as_dict() == {"power": 2.0, "shift": -3, "halve": True}
    assert isinstance(own.power, float) and isinstance(Cosine(power=2).power, float)
    assert RandomWalk.parse({"sigma": "None"}).sigma is None


def test_arrays_of_another_part_are_refused():
    learned_arrays = {"covariance": np.eye(2), "period_s": np.float64(0.1)}
    for arrays in ({"velocity": np.zeros(2)}, {}, {"covariance": np.eye(2)}):
        with pytest.raises(MapError, match="learns"):
            RandomWalk.from_arrays(arrays)
    whole = RandomWalk.from_arrays(learned_arrays, sigma=0.5)
    assert whole.arrays().keys() == learned_arrays.keys() and whole.as_dict() == {"sigma": 0.5}
    assert learned().init is False


@pytest.mark.parametrize("word", ["method=field", "rng=1", "colour.red=1"])
def test_what_is_no_part_cannot_be_set(word):
    with pytest.raises(ParameterError, match="is unknown: choose one of distance"):
        parse_choices([word])


def test_other_parts_that_fit_are_taken_and_what_is_no_longer_read_goes():
    choices = {"filter": "tracks", "motion": "singer", "measurement": "field"}
    texton_map = with_choices(trained(), choices)
    assert set(texton_map.parts) == set(choices)
    assert np.isfinite(flown(texton_map)).all()
    assert set(for_method(trained(), "field").parts) == set(METHODS["field"])
