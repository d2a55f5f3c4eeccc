"""A test flight that proves nothing is refused: a copy of the training, another origin."""

from dataclasses import replace

import pytest
from small_room import histogram_flight

from trexton.base.errors import FlightError
from trexton.companion.build.flight_pairs import load_pair
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight
from trexton.simulator.recording import record_flight


def test_a_copy_is_known_by_its_pictures(tmp_path):
    """Rounded places, later stamps: it was taken for another flight, and all was well."""
    record_flight(tmp_path / "a", frames=12)
    flight = read_flight(tmp_path / "a")
    moved = replace(
        flight, name="b", time=flight.time + 1000, position=flight.position.round(3) + 0.02
    )
    write_flight(moved, tmp_path / "b")
    with pytest.raises(FlightError, match="12 frames of flight 'b' are those it would be trained"):
        load_pair(tmp_path / "a", tmp_path / "b")


@pytest.mark.parametrize(("shift", "refused"), [(0.1, False), (100.0, True)])
def test_places_of_another_origin_are_no_test(tmp_path, shift, refused):
    train = histogram_flight("train", frames=60)
    test = histogram_flight("test", frames=60, noise=2)
    write_flight(train, tmp_path / "train")
    write_flight(replace(test, position=test.position + shift), tmp_path / "test")
    if refused:
        with pytest.raises(FlightError, match="60 positions of 'test' lie far beside the area"):
            load_pair(tmp_path / "train", tmp_path / "test")
    else:
        assert len(load_pair(tmp_path / "train", tmp_path / "test")[1]) == 60
