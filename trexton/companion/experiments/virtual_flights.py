"""Which floor will do, from a picture alone: survey it virtually, train, and fly over it later.

The prediction is the mean error of method `field` itself on such flights, under another light. What
the field predicts of single frames does not include that it may take one place for another.
"""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from operator import call
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from trexton.base.errors import MapError
from trexton.base.options import Options, option
from trexton.base.streams import stream
from trexton.companion.experiments.similarity import local_losses, smooth
from trexton.field.likelihood import grid_cells
from trexton.flights.flight import Flight
from trexton.localization.base import Area
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import for_method, train_map
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import PERIOD
from trexton.vision.camera import Camera
from trexton.vision.threads import ahead

LANE, SURVEY_SPEED = 0.5, 1.2  # metres between lanes that see everything twice; the survey's m/s
FEW = 110  # frames of the survey behind a first number
LATER, MEASURED = 4, 3  # flights after the survey, by which errors are predicted; and measured
CELL, CELLS = 0.1, 40_000  # metres, of the map of expected errors; and at most so many of them
REACH_M = 1.2  # over which errors of flights are averaged for that map
SIGMA_M = 0.8  # of the paper's map loss
METHOD = "field"  # the one whose error is predicted
Drawn = list[Future[Flight]]  # a survey and those after it


@dataclass(frozen=True)
class VirtualFlights(Options):
    """How a floor is flown over."""

    frames: int = option(0, "of the survey; 0 takes as many as its lanes need", low=0, high=20000)
    test_frames: int = option(100, "of each later flight, whose errors count", low=20, high=20000)
    height: float = option(1.0, "metres above the floor", low=0.2, high=10)
    seed: int = option(1, "of the flights", low=0)

    def drawn(self, floor: Floor, pool: ThreadPoolExecutor, count: int, few: bool = False) -> Drawn:
        """A survey, and `count` flights between random places an hour later, drawn by a pool. Of
        frames each second is kept, so that fewer cover the floor; or but a `few`, of a quarter of
        the pixels.
        """
        every, camera = (6, Camera(320, 240, 260.0)) if few else (2, Camera())
        x_min, x_max, y_min, y_max = floor.area
        path = 2 * (x_max - x_min) * (y_max - y_min) / LANE
        usual = int(np.clip(path / (SURVEY_SPEED * PERIOD * every), 200, 2000))
        most, test_frames = (FEW, min(30, self.test_frames)) if few else (20_000, self.test_frames)
        record = partial(
            record_flight, None, floor=floor, height=self.height, every=every, camera=camera
        )
        again = partial(record, pattern="waypoints", frames=test_frames)
        flights = [partial(again, seed=self.seed + n) for n in range(1, count + 1)]
        frames = min(self.frames or usual, most)
        flights.insert(0, partial(record, pattern="survey", seed=self.seed, frames=frames))
        # Each by one thread, which leaves the other cores to what is learned.
        return [pool.submit(next, ahead(call, [each])) for each in flights]

    def flown(
        self, drawn: Drawn, methods: tuple[str, ...] = (METHOD,)
    ) -> tuple[TextonMap, np.ndarray, dict[str, np.ndarray]]:
        """The map of the survey; ``(N, 2)`` metres of all frames of the flights after it, drawn
        while it is trained; by method ``(flights, N / flights)`` errors in cm.
        """
        import trexton.field.cross_validation  # noqa: F401  loaded while the survey is drawn

        survey, *later = drawn[0].result(), *drawn[1:]
        own = train_map(survey, method=METHOD, rng=stream(self.seed, "map"))
        errors = {}
        for method in methods:
            rng = stream(self.seed, f"map {method}")
            trained = for_method(own, method, flight=survey, rng=rng)
            errors[method] = _errors_cm(trained, later, self.seed)
        return own, np.concatenate([test.result().position for test in later]), errors


def predictions(floor: Floor, *, flights: VirtualFlights) -> Iterator[Any]:
    """What `first_prediction` and `judge_floor` give, sooner: flights for the second are drawn
    while those for the first are learned.
    """
    pool = ThreadPoolExecutor(1)
    try:
        few, drawn = flights.drawn(floor, pool, 1, few=True), flights.drawn(floor, pool, LATER)
        yield _first_cm(flights, few)
        yield _judged(floor, flights, drawn)
    finally:
        pool.shutdown(cancel_futures=True)


def first_prediction(floor: Floor, *, flights: VirtualFlights) -> float | None:
    """Centimetres of error to expect over a floor, by flights of few frames and a quarter of the
    pixels: within seconds, and coarser than `judge_floor`. None where they show too little.
    """
    with ThreadPoolExecutor(1) as pool:
        return _first_cm(flights, flights.drawn(floor, pool, 1, few=True))


def _first_cm(flights: VirtualFlights, drawn: Drawn) -> float | None:
    with suppress(MapError):
        return float(flights.flown(drawn)[2][METHOD].mean())
    return None


def judge_floor(floor: Floor, *, flights: VirtualFlights = VirtualFlights()) -> dict[str, Any]:
    """Predict how far off one would be over a floor, by virtual flights.

    Returns
    -------
    dict
        ``area_m``; ``frames``, of the survey and of the later flights; ``loss``, the paper's L(D);
        ``predicted_cm``, the mean error of the later flights, with its 95 % interval ``low`` to
        ``high``; ``centre_cm``, the error of always guessing the middle; ``heat``, expected error
        over the floor in metres; ``worst_m``, where it is largest.
    """
    with ThreadPoolExecutor(1) as pool:
        return _judged(floor, flights, flights.drawn(floor, pool, LATER))


def _judged(floor: Floor, flights: VirtualFlights, drawn: Drawn) -> dict[str, Any]:
    from trexton.companion.experiments.evaluation import constant_guess
    from trexton.companion.experiments.metrics import euclidean, mean_with_interval

    texton_map, flown, errors = flights.flown(drawn)
    errors_cm, places = _prolonged(errors[METHOD], flown)
    mean = mean_with_interval(errors_cm, stream(flights.seed, "intervals"))
    heat, worst = _expected(texton_map, places, errors_cm.ravel(), floor.area)
    centre = constant_guess(texton_map.positions, len(flown))
    whole = texton_map.joined()
    losses = local_losses(whole.histograms, whole.positions, SIGMA_M)
    return {
        "area_m": floor.area,
        "frames": {"survey": len(texton_map.time), "test": len(flown)},
        "loss": losses.mean(),
        "predicted_cm": mean["value"],
        "low": mean["low"],
        "high": mean["high"],
        "centre_cm": (100 * euclidean(centre, flown)).mean(),
        "heat": {"error_m": heat.round(4)},
        "worst_m": worst.tolist(),
    }


def measured_cm(
    floor: Floor, *, flights: VirtualFlights, methods: tuple[str, ...]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """By method, errors in cm at all frames after a survey; and ``(N, 2)`` where they were."""
    with ThreadPoolExecutor(1) as pool:
        _, flown, errors = flights.flown(flights.drawn(floor, pool, MEASURED), methods)
    return {method: each.ravel() for method, each in errors.items()}, flown


def _errors_cm(texton_map: TextonMap, tests: Drawn, seed: int) -> np.ndarray:
    """``(flights, N)`` of flights as they are drawn, each flown in a thread of its own."""
    from trexton.companion.experiments.track import fly

    def errors(number: int) -> np.ndarray:
        localizer = Localizer(texton_map, rng=stream(seed, "flight", number))
        test = tests[number].result()
        return 100 * fly(localizer, test.images()).errors(test.position)

    # Here, as flights in threads would lift each other's limit.
    with threadpool_limits(1, user_api="blas"):
        return np.stack(list(ahead(errors, range(len(tests)))))


def _prolonged(errors_cm: np.ndarray, flown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors ``(F, N)`` and places ``(F N, 2)`` as of flights twice as long: once a place is found
    a flight goes on as in its later half."""
    late = np.arange(errors_cm.shape[1] // 2, errors_cm.shape[1])
    rows = np.r_[: errors_cm.shape[1], late, late]
    return errors_cm[:, rows], flown.reshape(*errors_cm.shape, 2)[:, rows].reshape(-1, 2)


def _expected(
    texton_map: TextonMap, flown: np.ndarray, errors_cm: np.ndarray, area: Area
) -> tuple[np.ndarray, np.ndarray]:
    """``(rows, columns)`` expected errors in metres at the centres of cells, row 0 at the smallest
    y: what the field predicts of a single frame there, by as much as the flights around did worse;
    and ``(2,)`` the place of the largest.
    """
    predicted = texton_map.parts["measurement"].predicted_error
    size = (area[1] - area[0]) * (area[3] - area[2])
    places, shape = grid_cells(area, min(CELLS, round(size / CELL**2)))
    around = partial(smooth, positions=flown, places=places, sigma=REACH_M)
    expected = predicted(places) * around(errors_cm / 100) / around(predicted(flown))
    return expected.reshape(shape).T, places[np.nanargmax(expected)]
