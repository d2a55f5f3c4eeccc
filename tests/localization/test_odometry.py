"""A velocity from the frames themselves: how good it is, when there is none, and what it learns."""

from dataclasses import replace

import numpy as np
import pytest

from trexton.base.errors import MapError, ParameterError
from trexton.base.streams import stream
from trexton.flights.aiding import Aiding
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.odometry import SIGMA_FLOOR, Visual
from trexton.localization.training import train_map, with_choices
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera

FRAMES = 60


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("odometry") / "survey"
    return record_flight(folder, frames=FRAMES, camera=Camera(160, 120, 130.0), seed=3)


@pytest.fixture(scope="module")
def texton_map(flight):
    rng = stream(1, "training")
    return train_map(flight, method="field", n_textons=8, rng=rng, odometry="visual")


@pytest.fixture
def running(texton_map):
    return texton_map.parts["odometry"].open()


def moved(flight):
    return np.diff(flight.position, axis=0) / np.diff(flight.time)[:, None]


@pytest.mark.parametrize("told", [True, False])
def test_the_velocity_is_that_of_the_vehicle(running, texton_map, flight, told):
    truth, sigma = moved(flight), texton_map.parts["odometry"].sigma
    errors = []
    for row in range(FRAMES):
        aiding = flight.aiding(row) if told else None
        seen = running.aid(flight.image(row), aiding, float(flight.time[row]))
        if row:
            assert seen.velocity_sigma == sigma[0 if told else 1]
            errors.append(seen.velocity - truth[row - 1])
    assert np.sqrt(np.square(errors).mean()) < (0.15 if told else 0.35)
    assert np.sqrt(np.square(truth).mean()) > 0.4  # standing still would not do


def test_an_attitude_makes_it_surer(texton_map):
    told, untold = texton_map.parts["odometry"].sigma
    assert SIGMA_FLOOR <= told <= untold < 1


@pytest.mark.parametrize("stamped", [True, False])
def test_time_goes_on_over_a_frame_that_did_not_come(texton_map, flight, stamped):
    velocity = (flight.position[12] - flight.position[10]) / (flight.time[12] - flight.time[10])
    localizer = Localizer(texton_map, samples=100, rng=stream(1, "flight"))
    stamps = flight.time[[10, 12]].tolist() if stamped else [None, None]
    localizer.step(flight.image(10), aiding=flight.aiding(10), time=stamps[0])
    localizer.step(None)
    if stamped:
        localizer.step(None)  # predicted ahead of a frame that came late: its stamp counts
    seen = localizer.observation(flight.image(12), aiding=flight.aiding(12), time=stamps[1])
    assert seen.aiding.velocity == pytest.approx(velocity, abs=0.15)


def test_frames_that_have_nothing_in_common_show_no_velocity(running, flight, rng):
    assert running.aid(flight.image(0), None, 0.0) is None
    elsewhere = rng.integers(0, 256, flight.image(0).shape, dtype=np.uint8)
    assert running.aid(elsewhere, None, 0.08) is None
    assert running.aid(flight.image(1), None, 9.0) is None  # long after


def test_what_an_autopilot_tells_is_taken_where_the_frame_shows_nothing(running, flight):
    told = Aiding(velocity=np.array([3.0, 0.0]), velocity_time=0.0)
    assert running.aid(flight.image(0), told, 0.0) is told
    seen = running.aid(flight.image(1), replace(told, velocity_time=0.08), 0.08)
    assert np.abs(seen.velocity - moved(flight)[0]).max() < 0.5


@pytest.mark.parametrize(
    "absurd",
    [{"height": -3.0}, {"height": np.nan}, {"height": 1e30}, {"roll": 1.5, "pitch": np.inf}],
)
def test_absurd_heights_and_tilts_are_passed_over(running, flight, absurd):
    running.aid(flight.image(0), Aiding(**absurd), 0.0)
    seen = running.aid(flight.image(1), Aiding(**absurd), 0.08)
    assert np.abs(seen.velocity).max() < 3


def test_a_localizer_follows_with_it_and_forgets_it(texton_map, flight):
    def velocities(texton_map):
        localizer = Localizer(texton_map, samples=100, rng=stream(1, "flight"))
        for _ in range(2):  # the same again after a reset
            localizer.reset()
            localizer.rng = stream(1, "flight")
            found = [localizer.step(flight.image(row)).velocity for row in range(30)]
        return np.array([np.zeros(2) if each is None else each for each in found])

    blind = with_choices(texton_map, {"appearance": "none"})  # to the motion that tiles show
    without = replace(
        blind, parts={role: part for role, part in blind.parts.items() if role != "odometry"}
    )
    truth = moved(flight)[14:29]
    errors = [np.abs(velocities(each)[15:] - truth).mean() for each in (blind, without)]
    assert errors[0] < 0.7 * errors[1]


def test_it_is_saved_with_the_map(texton_map, tmp_path):
    save_map(texton_map, tmp_path / "map.npz")
    loaded = load_map(tmp_path / "map.npz").parts["odometry"]
    assert loaded.sigma.tolist() == texton_map.parts["odometry"].sigma.tolist()
    assert loaded.camera.tolist() == texton_map.parts["odometry"].camera.tolist()


def test_what_it_lacks_is_said(flight, texton_map):
    with pytest.raises(MapError, match="lacks its camera.*train without odometry"):
        train_map(
            replace(flight, camera=None), method="field", n_textons=8,
            rng=np.random.default_rng(1), odometry="visual",
        )  # fmt: skip
    with pytest.raises(MapError, match="odometry=visual"):
        with_choices(texton_map, {"odometry.sure": 0.2})
    with pytest.raises(ParameterError, match="sure is 2"):
        Visual(sure=2.0)
    whole = texton_map.parts["odometry"]
    with pytest.raises(MapError, match="deviations"):
        Visual.from_arrays({"camera": whole.camera, "sigma": np.array([0.0, np.nan])})
    with pytest.raises(MapError, match="camera is"):
        Visual.from_arrays({"camera": np.zeros(3), "sigma": whole.sigma})


@pytest.mark.parametrize("velocity", [1.0, np.zeros(3), np.zeros((1, 2))])
def test_a_velocity_has_two_axes(velocity):
    with pytest.raises(ParameterError, match=r"a velocity of shape .* was given: expected \(2,\)"):
        Aiding(velocity=velocity)
