"""Method field: likelihood over the floor, its errors, the motion it flies with."""

from dataclasses import replace

import numpy as np
import pytest
from small_room import histogram_flight
from small_survey import AREA, errors_of, look, observed, path, training
from threadpoolctl import threadpool_limits

from trexton.base.errors import MapError, ParameterError
from trexton.field.cross_validation import _error_coefficients
from trexton.field.field import Field
from trexton.field.likelihood import ErrorModel, error_terms, grid_cells
from trexton.field.linear_motion import Singer
from trexton.field.tracks import TrackFilter
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import train_map


def test_cells_fill_the_area():
    centers, (nx, ny) = grid_cells(AREA, 1200)
    assert len(centers) == nx * ny and abs(len(centers) - 1200) < 100
    np.testing.assert_allclose(centers.mean(axis=0), [2, 1.5])


def test_a_strip_has_no_more_cells_than_asked_for():
    centers, (nx, ny) = grid_cells((0.0, 100.0, 0.0, 0.001), 1200)
    assert len(centers) == nx * ny <= 1200 and ny == 2


def test_the_likeliest_cell_is_where_the_frame_was_taken(field, later):
    places, histograms = later
    best = [field.centers[field.log_posterior(observed(h)).argmax()] for h in histograms]
    assert np.median(np.hypot(*(np.array(best) - places).T)) < 0.15


def test_likelihood_at_places_is_that_of_the_cells_between(field, later):
    seen = observed(later[1][0])
    grid = field.log_posterior(seen)
    np.testing.assert_allclose(field.log_likelihood(field.centers[::37], seen), grid[::37])
    between = (field.centers[10] + field.centers[11]) / 2
    assert field.log_likelihood(between[None], seen) == pytest.approx(grid[10:12].mean())


@pytest.mark.parametrize("value", [1e12, 1e45, 1e300])
def test_a_value_that_no_frame_has_rules_out_no_place(field, later, value):
    odd = later[1][0].copy()
    odd[3] = value
    assert np.isfinite(field.log_posterior(observed(odd))).all()


def test_few_samples_are_believed_less(field, later):
    every, few = (field.log_posterior(observed(later[1][0], n)) for n in (None, 50))
    assert np.ptp(few) < np.ptp(every)


def test_expected_error_grows_where_nothing_was_flown(field):
    flown, corner = path(500)[0][100:101], np.array([[0.0, 3.0]])
    assert 0 < field.predicted_error(flown)[0] < field.predicted_error(corner)[0]


def test_no_error_is_expected_beyond_what_two_places_of_the_area_lie_apart(field, rng):
    """On average over the floor: nobody errs by more who is sure to be inside."""
    x_min, x_max, y_min, y_max = field.area
    drawn = rng.uniform((x_min, y_min), (x_max, y_max), (2, 20_000, 2))
    apart = np.hypot(*(drawn[0] - drawn[1]).T).mean()
    hopeless = Field.from_arrays(field.arrays() | {"error_coefficients": np.full(3, 100.0)})
    assert hopeless.predicted_error(field.centers) == pytest.approx(apart, rel=0.03)


def test_errors_of_places_that_are_hardly_known_grow_faster_than_of_those_known_badly(rng):
    """Known badly, a place is found less exactly; hardly known, it is taken for another."""
    variances = rng.uniform(0, 0.8, 4000)
    known = variances / (1 - variances)
    lengths = rng.exponential(0.05 + 0.1 * np.sqrt(known) + 0.4 * known)
    turned = rng.uniform(0, 2 * np.pi, 4000)
    factors = _error_coefficients(
        lengths[:, None] * np.column_stack([np.cos(turned), np.sin(turned)]), variances
    )
    assert error_terms(np.array([0.1, 0.8])) @ factors == pytest.approx([0.128, 1.85], rel=0.1)


@pytest.mark.parametrize("variance", [0.01, 0.49, 0.51, 0.99])
def test_of_equal_variances_the_mean_error_is_predicted(variance):
    errors = np.tile([[0.3, 0.0]], (40, 1))
    assert _error_coefficients(errors, np.full(40, variance)).tolist() == [pytest.approx(0.3), 0, 0]


def test_no_predicted_error_is_below_the_white_error(field):
    flattered = Field.from_arrays(field.arrays() | {"error_coefficients": np.zeros(3)})
    assert (flattered.predicted_error(field.centers) == field.error_model.white_sigma).all()


@pytest.mark.parametrize("spread", [1e-4, 1e-3, 0.03])
@pytest.mark.parametrize("count", [3, 100])
def test_a_flight_that_hovers_is_learned_or_refused_in_a_sentence(spread, count, rng):
    """Its kernel may be so short that no cell lies near a frame."""
    places = 1.0 + spread * rng.standard_normal((count, 2))
    hovered = replace(
        training(), histograms=look(places, rng), positions=places, time=np.arange(count) * 0.08
    )
    try:
        learned = Field().fit(hovered)
    except MapError as error:
        assert "fly over" in str(error)
    else:
        assert np.isfinite(learned.predicted_error(learned.centers)).all()


def test_correlated_errors_are_inflated_where_the_variance_is_larger_than_in_training(field):
    flown, corner = path(500)[0][100:101], np.array([[0.0, 3.0]])
    assert field.correlated_inflation(flown)[0] == 1 < field.correlated_inflation(corner)[0]
    known, unknown = field.predicted_error(np.concatenate([flown, corner]))
    assert unknown > known


def test_a_survey_that_repeats_its_lanes_is_not_trusted_between_them(monkeypatch):
    """Left-out frames lie beside frames of another pass: between the lanes the field errs more."""
    rng = np.random.default_rng(4)
    along, rows = np.linspace(0.2, 3.8, 60), np.repeat([0.2, 1.05, 1.9, 2.75], 60)
    lanes = np.column_stack([np.tile(np.r_[along, along[::-1]], 2), rows])
    places = np.concatenate([lanes, lanes + rng.normal(0, 0.02, lanes.shape)])
    twice = training(
        len(places),
        positions=places,
        histograms=look(places, rng, noise=0.1),
        time=np.arange(len(places)) * 0.08,
    )
    repeated, walk = Field().fit(twice), Singer().fit(twice)
    between = np.column_stack([along, np.full(60, 1.475)])
    later = look(between, rng, noise=0.1)

    def nees() -> float:
        tracker, squared = TrackFilter(walk, repeated, AREA), []
        for histogram, place in zip(later, between, strict=True):
            tracker.step(observed(histogram))
            told = tracker.estimate()
            off = told.position - place
            squared.append(off @ np.linalg.solve(told.about_position, off))
        return float(np.mean(squared))

    grown = nees()
    monkeypatch.setattr(Field, "correlated_inflation", lambda self, places: np.ones(len(places)))
    assert grown < 0.75 * nees()


def test_a_field_survives_its_arrays(field, later):
    again = Field.from_arrays(field.arrays(), **field.as_dict())
    seen = observed(later[1][3])
    np.testing.assert_array_equal(again.log_posterior(seen), field.log_posterior(seen))


def test_equal_training_gives_equal_bytes(field):
    for name, array in Field().fit(training()).arrays().items():
        np.testing.assert_array_equal(array, field.arrays()[name])


def test_arrays_that_do_not_fit_each_other_or_the_grid_are_refused(field):
    arrays = field.arrays()
    for name, array in arrays.items():
        with pytest.raises(MapError, match="has shape"):
            Field.from_arrays(arrays | {name: array[None]})
    fewer = {name: arrays[name][:-1] for name in ("variance", "prior")}
    with pytest.raises(MapError, match="fits no grid"):
        Field.from_arrays(arrays | fewer)
    with pytest.raises(MapError, match="noise is not finite"):
        Field.from_arrays(arrays | {"noise": np.nan * arrays["noise"]})


def test_a_field_is_stored_as_what_makes_it(field):
    arrays = field.arrays()
    assert "mean" not in arrays and field.mean.nbytes > arrays["process"].nbytes
    np.testing.assert_array_equal(Field.from_arrays(arrays).mean, field.mean)
    with pytest.raises(MapError, match="Field learns .*'process'"):
        Field.from_arrays({name: arrays[name] for name in arrays if name != "process"})


def test_histograms_that_are_all_alike_are_refused():
    alike = np.full((60, 5), 0.2)
    places, time = path(60)
    with pytest.raises(MapError, match="alike"):
        Field().fit(training(60, histograms=alike, positions=places, time=time))


def test_a_flight_that_stood_still_is_refused():
    with pytest.raises(MapError, match="one place"):
        Field().fit(training(60, positions=np.ones((60, 2))))


def test_cells_out_of_range_are_refused():
    with pytest.raises(ParameterError, match="cells"):
        Field(cells=3)


@pytest.mark.parametrize(
    "change",
    ["few", "unnormalised", "constant", "repeated", "large", "gaps", "many features"],
)
def test_any_features_of_any_flight_will_do(change, rng):
    count = 18 if change == "few" else 300
    scale = 100.0 if change == "large" else 1.0
    given = training(count, scale)
    histograms = given.histograms
    if change == "unnormalised":
        given = replace(given, histograms=histograms * rng.uniform(4.4, 5.0, (count, 1)))
    if change == "constant":
        given = replace(given, histograms=np.hstack([histograms, np.zeros((count, 3))]))
    if change == "repeated":
        given = replace(given, positions=given.positions.round(1))
    if change == "gaps":
        given = replace(given, time=given.time + 7.0 * (np.arange(count) > 150))
    if change == "many features":
        given = replace(given, histograms=np.abs(histograms @ rng.normal(size=(12, 177))))
    field, motion = Field().fit(given), Singer().fit(given)
    tracker = TrackFilter(motion, field, given.area)
    errors = errors_of(tracker, given.positions[:40], given.histograms[:40])
    assert np.isfinite(errors).all()
    assert np.median(errors) < scale * (0.8 if change == "few" else 0.3)


def test_coordinates_far_from_zero_change_nothing(later):
    """UTM: squares of distances from the equator hold no centimetres."""
    east, north = 500_000.0, 5_800_000.0
    given, (places, histograms) = training(), later
    x_min, x_max, y_min, y_max = given.area
    far = replace(
        given,
        positions=given.positions + [east, north],
        area=(x_min + east, x_max + east, y_min + north, y_max + north),
    )
    here, there = Field().fit(given), Field().fit(far)
    np.testing.assert_allclose(
        there.predicted_error(places + [east, north]), here.predicted_error(places), rtol=1e-3
    )
    for histogram in histograms[:5]:
        seen = observed(histogram)
        np.testing.assert_allclose(there.log_posterior(seen), here.log_posterior(seen), atol=0.05)


def test_a_longer_flight_than_it_can_hold_is_thinned_and_merged():
    given = training(4000)
    field = Field(cells=400).fit(given)
    assert field.predicted_error(given.positions[:3]).max() < 0.5


def test_errors_part_into_what_lasts_and_what_is_new(rng):
    time = np.arange(6000) * 0.1
    lasting = np.empty((6000, 2))
    lasting[0] = 0
    memory = np.exp(-0.1 / 0.5)
    for row in range(1, 6000):
        kick = rng.normal(0, 0.3 * np.sqrt(1 - memory**2), 2)
        lasting[row] = memory * lasting[row - 1] + kick
    model = ErrorModel.of(lasting + rng.normal(0, 0.1, (6000, 2)), time, 0.01)
    assert model.correlated_sigma == pytest.approx(0.3, rel=0.2)
    assert model.white_sigma == pytest.approx(0.1, rel=0.4)
    assert model.time_constant_s == pytest.approx(0.5, rel=0.3)


def test_independent_errors_last_a_frame(rng):
    model = ErrorModel.of(rng.normal(0, 0.2, (500, 2)), np.arange(500) * 0.1, 0.01)
    assert model.time_constant_s <= 0.11 and model.white_sigma > 0.1


def test_the_method_trains_flies_and_is_stored(tmp_path):
    flight = histogram_flight("hall", frames=200)
    texton_map = train_map(flight, method="field", rng=np.random.default_rng(1))
    again = load_map(save_map(texton_map, tmp_path / "map.npz"))
    fly = [Localizer(each, rng=np.random.default_rng(3)) for each in (texton_map, again)]
    for histogram in flight.histograms[:20]:
        one, other = (localizer.step(histogram) for localizer in fly)
        np.testing.assert_array_equal(one.position, other.position)
    assert np.hypot(*(one.position - flight.position[19])) < 0.5


def test_a_method_without_neighbours_takes_no_number_of_them():
    flight = histogram_flight("hall", frames=200)
    texton_map = train_map(flight, method="field", rng=np.random.default_rng(1))
    with pytest.raises(ParameterError, match="'field' has no parameter 'neighbors'"):
        Localizer(texton_map, neighbors=3, rng=np.random.default_rng(3))


def test_a_field_measures_for_particles_too():
    flight = histogram_flight("hall", frames=200)
    texton_map = train_map(flight, measurement="field", rng=np.random.default_rng(1))
    localizer = Localizer(texton_map, particles=500, rng=np.random.default_rng(3))
    for histogram in flight.histograms[:30]:
        estimate = localizer.step(histogram)
    assert np.hypot(*(estimate.position - flight.position[29])) < 1.0


def test_a_field_does_not_depend_on_how_many_threads_fit_it():
    fitted = []
    for threads in (1, 2):
        with threadpool_limits(threads, user_api="blas"):
            fitted.append(Field().fit(training()).arrays())
    one, two = ({name: array.tobytes() for name, array in each.items()} for each in fitted)
    assert one == two
