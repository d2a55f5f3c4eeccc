"""The kidnapping experiment: its rule by enumeration, its plan, its record, and what its figures
draw.
"""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import FlightError
from trexton.base.streams import stream
from trexton.companion.experiments import kidnapping
from trexton.companion.experiments.rates import wilson_interval
from trexton.flights.flight import Flight

TRIALS = 20  # kidnappings


def wandering_flight(name: str, seed: int, frames: int = 240) -> Flight:
    """A flight to and fro over 4 m x 4 m whose histograms tell the place, with noise."""
    rng = np.random.default_rng(seed)
    time = 0.08 * np.arange(frames)
    position = 2 + 1.8 * np.column_stack(
        [np.sin(0.9 * time + seed), np.sin(0.61 * time + 2 * seed)]
    )
    centers = rng_centers()
    weight = np.exp(-((position[:, None] - centers) ** 2).sum(axis=2) / 1.5) + 0.02 * rng.random(
        (frames, len(centers))
    )
    return Flight(
        name=name, frame=np.arange(frames), time=time, position=position, area=(0.0, 4.0, 0.0, 4.0),
        histograms=weight / weight.sum(axis=1, keepdims=True),
    )  # fmt: skip


def rng_centers() -> np.ndarray:
    return np.array([(x, y) for x in (0.5, 2.0, 3.5) for y in (0.5, 2.0, 3.5)])


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([0, 0, 0, 0, 0], 0),
        ([0, 0, 9, 9, 0, 0, 0], 2),
        ([0, 0, 0, 0, 9, 0, 0, 0, 9], 3),
        ([0, 0, 9, 0, 9, 0, 0], None),
        ([0, 0, 1.0, 1.0, 1.0], None),  # below the tolerance, not at it
        ([0, 0, 0], None),
    ],
)
def test_found_means_so_many_in_a_row(errors, expected):
    assert kidnapping.recovered_after(np.array(errors[2:]) < 1.0, 3) == expected


@pytest.fixture(scope="module")
def flights() -> tuple[Flight, Flight]:
    return wandering_flight("one", 1, 400), wandering_flight("two", 2)


@pytest.fixture(scope="module")
def record(flights):
    return kidnapping.run(
        *flights, kidnapping.Parameters(kidnappings=TRIALS, patience_s=3.0, seed=3)
    )


def test_plan_carries_the_vehicle_far_with_time_before_and_after(flights, rng):
    plan = kidnapping._plan(flights[1], 300, 40, rng)
    assert plan.shape == (300, 2)
    assert (plan[:, 0] >= 40).all() and (plan[:, 1] + 40 <= len(flights[1])).all()
    steps = flights[1].position[plan[:, 1]] - flights[1].position[plan[:, 0]]
    assert (np.hypot(*steps.T) >= 2.0).all()


def test_a_flight_on_the_spot_cannot_be_kidnapped(flights, rng):
    still = flights[1].select(slice(0, 5))
    with pytest.raises(FlightError, match="fly longer"):
        kidnapping._plan(still, 10, 2, rng)


def test_random_particles_find_the_vehicle_at_least_as_often_and_sooner(record):
    plain, augmented = record.values["plain"], record.values["augmented"]
    assert record.values["counts"]["kidnappings"] == TRIALS
    assert augmented["recovered_rate"]["value"] >= max(plain["recovered_rate"]["value"], 0.9)
    assert augmented["recovery_s"]["median"] < plain["recovery_s"]["median"]
    assert augmented["lost"]["wrong_frames_rate"] > plain["lost"]["wrong_frames_rate"]
    assert augmented["lost"]["wrong_frames_rate"] > augmented["lost"]["right_frames_rate"]


def test_kidnappings_of_one_stretch_count_together(record):
    """They share frames: however many there are, one flight has few stretches."""
    rate = record.values["field"]["recovered_rate"]
    assert rate["trials"] == TRIALS and 2 <= rate["clusters"] <= 240 // 37
    alone = wilson_interval(round(TRIALS * rate["value"]), TRIALS)
    assert rate["low"] < alone[0] and alone[1] <= rate["high"]


def test_the_field_is_found_at_once_and_knows_it_was_lost(record):
    field, augmented = record.values["field"], record.values["augmented"]
    assert np.sum(np.array(record.series["field"]["recovery_s"]) <= 3) >= 0.95 * TRIALS
    assert field["recovery_s"]["median"] <= augmented["recovery_s"]["median"]
    lost = field["lost"]
    assert lost["wrong_frames_rate"] is None or lost["wrong_frames_rate"] > 0.8
    assert lost["right_frames_rate"] < 0.02


def test_equal_seeds_give_equal_values(flights):
    first, again, other = (
        kidnapping.run(
            flights[0].select(slice(0, 120)),
            flights[1],
            kidnapping.Parameters(kidnappings=4, patience_s=1.0, seed=seed),
        )
        for seed in (5, 5, 6)
    )
    assert first.values == again.values and first.series == again.series
    assert first.values != other.values


def test_trials_are_what_the_localizer_gives(flights):
    """One trial against a plain loop over the same frames."""
    from trexton.companion.experiments.declaration import MapParameters
    from trexton.companion.experiments.evaluation import map_of
    from trexton.localization.localizer import Localizer

    texton_map = map_of(flights[0], MapParameters(3))
    rows = np.array([*range(30, 60), *range(150, 180)])
    given = (flights[1].histograms, flights[1].position, {"recovery": "none", "particles": 50})
    found = kidnapping._trial(texton_map, *given, None, 3, (0, rows))
    localizer = Localizer(texton_map, rng=stream(3, "kidnappings", 0))
    errors = [
        np.hypot(*(localizer.step(flights[1].histograms[row]).position - flights[1].position[row]))
        for row in rows
    ]
    assert found.carried == 5  # the stretch of 30 frames from 150 on
    np.testing.assert_allclose(found.error, errors)
    assert found.cut == 30


def test_figures_draw_the_record(record):
    axes = kidnapping.time_to_recover(record).axes[0]
    for line, name in zip(axes.lines, ("plain", "augmented", "field"), strict=True):
        times = record.series[name]["recovery_s"]
        np.testing.assert_allclose(line.get_xdata()[1:-1], times)
        np.testing.assert_allclose(line.get_ydata()[-1], 100 * len(times) / TRIALS)
    assert axes.get_xlabel()


def test_lost_counts_wrong_frames_until_recovered_and_false_alarms():
    """Against a count by hand: two undisturbed frames settle, two count."""
    error = np.array([0, 0, 0, 5, 9, 9, 0, 0, 0, 9.0])
    lost = np.array([1, 1, 0, 1, 1, 0, 1, 0, 0, 1], bool)
    trial = kidnapping.Trial(error, lost, 4)
    found = kidnapping._lost([trial], [2], 1.0)
    # The last wrong frame comes after the recovery.
    assert found == {"wrong_frames_rate": 0.5, "right_frames_rate": 0.0}
