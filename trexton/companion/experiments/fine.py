"""Method `fine`: the image is registered with a picture of the floor, coarse to fine.

Beyond the paper. The recorded flight on two maps of its floor; virtual flights over floors on which
nothing was tuned, repeating ones among them; kidnappings. Times are those of the processor.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion import wording
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SURVEYED, Experiment, SeedParameters, option
from trexton.companion.experiments.floors import painted_floor
from trexton.companion.experiments.kidnapping import recovered_after
from trexton.companion.experiments.metrics import euclidean, mean_with_interval
from trexton.companion.experiments.mosaic import stitched_map
from trexton.companion.experiments.rates import mean_over_groups, of_frames, success_rate
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.experiments.track import HELD
from trexton.flights.flight import Flight
from trexton.registration.tracker import FloorTracker
from trexton.registration.trust import Trust, learn_trust
from trexton.simulator.floor import Floor, Light
from trexton.simulator.recording import Plan, random_waypoints
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import Simulator
from trexton.simulator.vehicle import VehicleState

# Roll, pitch and yaw of an autopilot: as measured, with a camera turned in its mount, none.
ATTITUDES = {
    "attitude": "with attitude",
    "tilt_bias": "with a tilt bias",
    "free": "without attitude",
}
ATTITUDE_DEG = 0.3  # noise of the autopilot's attitude
TILT_BIAS_DEG = 3.0  # that the camera rolled in its mount since the survey
SETTLED = 25  # frames, two seconds, in which the vehicle may be found for the first time
GROSS = 0.3  # metres: further off is another place
SPEED = 0.6  # metres a second
CARRIED = 63  # frames of each kidnapping: two seconds before it, three after
FOUND = 5  # frames in a row
CAMERA = Effects().without("jpeg")  # as the camera delivers; files are for recorded flights


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    floors: int = option(2, "floors flown over, the layouts of the hall in turn", low=1)
    frames: int = option(100, "frames of each flight", low=50)
    training: int = option(60, "frames from which each floor's fits are calibrated", low=50)
    kidnappings: int = option(3, "times that the vehicle is kidnapped", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly method `fine` over the test flight, over virtual floors, and kidnapped.

    Parameters
    ----------
    train, test : Flight
        With images, a picture of the floor, and a camera.
    """
    values, series = _recorded(train, test, parameters.seed)
    trials = spread(partial(_over_floor, parameters), range(parameters.floors), "floors")
    found = spread(partial(_kidnapped, parameters), range(parameters.kidnappings), "kidnappings")
    rows = {name: np.concatenate([each["rows"][name] for each in trials]) for name in ATTITUDES}
    values |= {
        "floors": {
            trial["name"]: {name: _summary(each) for name, each in trial["rows"].items()}
            for trial in trials
        },
        "all": {name: _summary(each) for name, each in rows.items()},
        "kidnapped": {"found_rate": found_rate(found, parameters.floors)},
    }
    timings = {
        name: of_frames(np.concatenate([trial["seconds"][name] for trial in trials]))
        for name in ATTITUDES
    }
    return parameters.record(train, test, values=values, series=series, timings=timings)


def _summary(rows: np.ndarray) -> dict[str, Any]:
    error, distance = rows.T
    return {
        "frames": len(rows),
        "mean_cm": 100 * error.mean(),
        "p95_cm": 100 * np.percentile(error, 95),
        "max_cm": 100 * error.max(),
        "gross": int((error > GROSS).sum()),
        "region_90": (distance < HELD).mean(),
    }


def _recorded(train: Flight, test: Flight, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """The test flight on the surveyed and on the stitched map."""
    assert test.floor is not None and test.camera is not None
    assert test.height is not None and test.attitude is not None
    height = float(np.median(test.height))
    pictures = {"surveyed": test.floor, "stitched": stitched_map(train).map}
    trackers = {
        (where, name): FloorTracker(picture, test.camera, height)
        for where, picture in pictures.items()
        for name in ATTITUDES
    }
    rng = stream(seed, "recorded")
    track: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in trackers}
    for row, image in enumerate(test.images()):
        for key, tracker in trackers.items():
            attitude = _measured(test.attitude[row], key[1], rng)
            track[key].append(tracker.step(image, attitude=attitude).position)
    values: dict[str, Any] = {where: {} for where in pictures}
    series: dict[str, Any] = {"time_s": test.time - test.time[0]}
    for (where, name), positions in track.items():
        # The stream keeps the name it was first drawn under, so that numbers stay the same.
        drawing = stream(seed, f"intervals {where} {name.replace('tilt_bias', 'askew')}")
        error = 100 * euclidean(np.array(positions), test.position)
        values[where][name] = {"mean_cm": mean_with_interval(error[None, SETTLED:], drawing)}
        series[f"{where}_{name}_cm"] = error
    return {"flight": values}, series


def found_rate(found: list[int | None], floors: int) -> dict[str, Any] | None:
    """How often the vehicle was found after a kidnapping. Kidnappings over one floor may be alike:
    the rate is over floors, which are taken in turn.
    """
    number = np.arange(len(found)) % floors
    happened = np.bincount(number, [each is not None for each in found]).astype(int)
    return success_rate(happened, np.bincount(number))


def _frames(room: Simulator, count: int, rng: np.random.Generator) -> Iterator[VehicleState]:
    """The states of a flight between random places."""
    plan = Plan(random_waypoints(room.floor.area, rng))
    for _ in range(count):
        yield room.step(plan.goal(room.state.position))


def _measured(attitude: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray | None:
    """``(3,)`` roll, pitch and yaw as the autopilot measures them, radians: see `ATTITUDES`."""
    noise = np.radians(ATTITUDE_DEG) * rng.standard_normal(3)
    if kind == "tilt_bias":
        noise[0] += np.radians(TILT_BIAS_DEG)
    return None if kind == "free" else attitude + noise


def _room(floor: Floor, seed: int, name: str, index: int) -> Simulator:
    rng = stream(seed, name, index)
    return Simulator(floor, effects=CAMERA, light=Light.later(), speed=SPEED, rng=rng)


def _floor(index: int) -> tuple[str, Floor]:
    """The layouts of the hall in turn, the repeating ones first, each time from another seed."""
    return painted_floor(index + 2, 100 + index)


def _trackers(floor: Floor, parameters: Parameters, index: int) -> dict[str, FloorTracker]:
    """Trackers that trust their fits as a flight of their own has taught them."""
    trackers = {}
    for kind in ("attitude", "free"):
        rng = stream(parameters.seed, "training", index)
        taught = _room(floor, parameters.seed, "training room", index)
        tracker = FloorTracker(floor.picture, taught.camera, 1.0)
        fixes, truth = [], []
        for state in _frames(taught, parameters.training, rng):
            attitude = _measured(state.attitude, kind, rng)
            fixes.append(tracker.step(taught.render(), attitude=attitude))
            truth.append(state.position[:2])
        trust = learn_trust(fixes, np.array(truth), 1.0, Trust())
        for name in ("attitude", "tilt_bias") if kind == "attitude" else ("free",):
            trackers[name] = FloorTracker(floor.picture, taught.camera, 1.0, trust=trust)
    return trackers


def _over_floor(parameters: Parameters, index: int) -> dict[str, Any]:
    """One flight over one floor, attitude known or not. ``rows`` hold the error in metres and the
    squared Mahalanobis distance of each frame, ``seconds`` what it took.
    """
    name, floor = _floor(index)
    room = _room(floor, parameters.seed, "room", index)
    trackers = _trackers(floor, parameters, index)
    rng = stream(parameters.seed, "attitude", index)
    rows: dict[str, list[tuple[float, float]]] = {key: [] for key in trackers}
    seconds: dict[str, list[float]] = {key: [] for key in trackers}
    waypoints = stream(parameters.seed, "waypoints", index)
    for state in _frames(room, parameters.frames, waypoints):
        image, place = room.render(), state.position[:2]
        for key, tracker in trackers.items():
            attitude = _measured(state.attitude, key, rng)
            start = process_time()
            fix = tracker.step(image, attitude=attitude)
            seconds[key].append(process_time() - start)
            error = fix.position - place
            distance = float(error @ np.linalg.solve(fix.covariance, error))
            rows[key].append((np.hypot(*error), distance))
    settled = {key: np.array(each[SETTLED:]) for key, each in rows.items()}
    return {"name": name, "rows": settled, "seconds": seconds}


def _kidnapped(parameters: Parameters, index: int) -> int | None:
    """Frames from a kidnapping until the vehicle is found; None where it is not."""
    rng = stream(parameters.seed, "kidnapping", index)
    _, floor = _floor(index % parameters.floors)
    room = _room(floor, parameters.seed, "kidnapping room", index)
    tracker = FloorTracker(floor.picture, room.camera, 1.0)
    x_min, x_max, y_min, y_max = floor.area
    error = []
    for frame, state in enumerate(_frames(room, CARRIED, rng)):
        if frame == SETTLED:
            place = state.position[:2]
            while euclidean(place, state.position[:2]) < (x_max - x_min) / 2:
                place = rng.uniform((x_min + 0.3, y_min + 0.3), (x_max - 0.3, y_max - 0.3))
            room.vehicle.teleport(place)
            state = room.state
        fix = tracker.step(room.render(), attitude=_measured(state.attitude, "attitude", rng))
        error.append(float(euclidean(fix.position, state.position[:2])))
    return recovered_after(np.array(error[SETTLED:]) < GROSS, FOUND)


def over_floors(
    record: Record, name: str, quantity: str, highest: float = np.inf
) -> dict[str, float | None]:
    """Mean of what stands in the record for each floor, with its 95 % interval over floors: frames
    over one floor share its print, and what was learned over it.
    """
    values = [floor[name][quantity] for floor in record.values["floors"].values()]
    return mean_over_groups(values, highest=highest)


def finding(record: Record, long: Record | None = None) -> str:
    """What the experiment found, in three sentences; over floors in the longer run, if there is
    one.
    """
    over = long or record
    everything = over.values["all"]
    with_attitude, without = (
        wording.interval(over_floors(over, key, "mean_cm"), "cm") for key in ("attitude", "free")
    )
    frames = sum(everything[key]["frames"] for key in ATTITUDES)
    gross = sum(everything[key]["gross"] for key in ATTITUDES)
    stitched = wording.distance(record.values["flight"]["stitched"]["free"]["mean_cm"])
    return (
        f"Over {len(over.values['floors'])} floors method fine has a mean error of {with_attitude} "
        f"with the autopilot's attitude, and {without} without. {gross} of {frames:,} frames are "
        f"off by more than {100 * GROSS:.0f} cm. On a map stitched from the flight itself it is "
        f"{stitched} without attitude."
    )


_LINES = {"attitude": (COLORS["fine"], "-"), "free": (COLORS["zone"], "--")}


def over_time(record: Record) -> Figure:
    """Error over the recorded flight, on the surveyed map above and on the stitched one below."""
    time = np.array(record.series["time_s"])
    with canvas(2, 1, size=(7.2, 4.4), sharex=True, sharey=True) as (figure, axes):
        for plot, where in zip(axes[:, 0], ("surveyed", "stitched"), strict=True):
            for name, (color, style) in _LINES.items():  # a tilt bias would lie upon the first
                error = np.array(record.series[f"{where}_{name}_cm"], dtype=float)
                plot.plot(time, error, style, color=color, linewidth=1.0, label=ATTITUDES[name])
            plot.set(ylabel=f"{where} map:\nerror (cm)", ylim=(0, None))
        legend_above(axes[0, 0])
        axes[1, 0].set(xlabel="time (s)", xlim=(0, time[-1]))
    return figure


EXPERIMENT = Experiment(
    "Method fine: image registration", Parameters, run, finding, SURVEYED, ("mosaic",), cost_s=40
)
