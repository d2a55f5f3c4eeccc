"""Sound recordings of many kinds, as vehicles, people and trackers make them."""

import numpy as np

from trexton.flights.flight import Flight, area_around


def along(corners, pace: float, time: np.ndarray) -> np.ndarray:
    """Places on the way from corner to corner and back, at one pace in metres a second."""
    corners = np.array([*corners, *corners[-2::-1]], dtype=float)
    reached = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    gone = pace * time % reached[-1]
    return np.column_stack([np.interp(gone, reached, corners[:, axis]) for axis in (0, 1)])


def lanes(time, rng, size=(5.0, 4.0), pace=0.5, count=6):
    across = np.repeat(np.linspace(0, size[1], count), 2)
    ends = np.tile([0, size[0], size[0], 0], count)[: 2 * count]
    return along(np.column_stack([ends, across]), pace, time)


def round_(time, rng, radius=(2.0, 1.5), pace=0.5):
    angle = pace / max(radius) * time + rng.uniform(0, 6)
    return np.column_stack([radius[0] * np.cos(angle), radius[1] * np.sin(angle)])


def eight(time, rng, size=2.0, pace=0.7):
    angle = pace / size * time
    return size * np.column_stack([np.sin(angle), np.sin(angle) * np.cos(angle)])


def spiral(time, rng, pace=0.4):
    angle = 2 * np.sqrt(pace * time + 0.2)
    return 0.15 * angle[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def wander(time, rng, pace=0.6, room=4.0):
    """Smooth and random, as a hand carries or a gust drifts."""
    waves = rng.uniform(0.15, 1.0, (4, 2)) * pace / 2
    phase = rng.uniform(0, 6, (4, 2))
    return room / 4 * np.sin(waves * time[:, None, None] + phase).sum(axis=1)


def waypoints(time, rng, pace=0.8, room=5.0):
    return along(rng.uniform(0, room, (12, 2)), pace, time)


def hover(time, rng, drift=0.05):
    return wander(time, rng, pace=0.4, room=8 * drift) + (3, 2)


def stops(time, rng, pace=0.6, period=9.0):
    """Goes and stands, to the last digit while it stands."""
    step = np.gradient(time) * pace * np.clip(3 * np.sin(2 * np.pi * time / period) + 1, 0, 1)
    gone = np.cumsum(step)
    return along([(0, 0), (4, 0), (4, 3), (0, 3)], 1.0, gone)


def landed(time, rng):
    """At rest where it starts, which is the origin, flies, and at rest where it lands."""
    share = np.clip((time - 0.2 * time[-1]) / max(0.6 * time[-1], 1e-9), 0, 1)
    smooth = share * share * (3 - 2 * share)
    return np.column_stack([3 * smooth, 2 * np.sin(np.pi * smooth)]) * (np.ptp(time) / 30)


def brakes(time, rng):
    """Stops within 0.3 s and stands to the end, to the last digit."""
    pace = np.clip((0.8 * time[-1] - time) / 0.3, 0, 1)
    return lanes(np.cumsum(pace * np.gradient(time)), rng)


def held(way, often):
    """A slower log beside the frames: each place several times."""
    return lambda time, rng: way(time, rng)[np.arange(len(time)) // often * often]


def scaled(way, factor, **how):
    return lambda time, rng: factor * way(time / factor**0.5, rng, **how)


# name: (way, frames a second, metres of noise, decimals, what else)
SOUND = {
    "lanes": (lanes, 12.5, 0.0, 12, ""),
    "lanes with noise": (lanes, 12.5, 0.01, 4, "height"),
    "lanes, nose ahead": (lanes, 25, 0.003, 6, "attitude"),
    "circle": (round_, 12.5, 0.002, 6, ""),
    "circle, steady turn": (round_, 30, 0.001, 6, "turn"),
    "narrow ellipse": (lambda t, r: round_(t, r, (3.0, 0.3)), 12.5, 0.01, 3, ""),
    "figure of eight": (eight, 25, 0.002, 6, "attitude"),
    "fast quadrotor": (lambda t, r: eight(t, r, 6.0, 9.0), 60, 0.004, 6, "attitude height"),
    "spiral": (spiral, 10, 0.005, 4, ""),
    "hover": (hover, 12.5, 0.004, 4, "height"),
    "hover, tiny drift": (lambda t, r: hover(t, r, 0.2), 30, 0.001, 6, "turn"),
    "carried by hand": (wander, 30, 0.01, 3, "attitude"),
    "rover": (lambda t, r: waypoints(t, r, 0.15), 5, 0.005, 3, ""),
    "rover that stops": (stops, 10, 0.0, 3, ""),
    "stop and go, noisy": (stops, 12.5, 0.003, 4, "height"),
    "waypoints": (waypoints, 12.5, 0.01, 4, "attitude"),
    "boat": (lambda t, r: wander(t, r, 0.5, 60.0), 2, 0.3, 2, "heave"),
    "outdoors": (scaled(lanes, 40), 5, 0.3, 2, "high"),
    "fixed wing": (lambda t, r: 150 * round_(t, r, (2.0, 1.0), 0.1), 10, 0.5, 2, "high attitude"),
    "photographs by GPS": (lambda t, r: lanes(t, r, (120.0, 90.0), 6.0, 7), 0.5, 0.4, 2, "high"),
    "GPS that wanders": (scaled(wander, 20), 5, 0.0, 2, "drift high"),
    "GPS in millionths of a degree": (
        lambda t, r: 0.1113 * np.round(wander(t, r, 2.0, 20.0) / 0.1113),
        25,
        0.0,
        9,
        "",
    ),
    "walk at 1 Hz": (lambda t, r: wander(t, r, 1.2, 12.0), 1, 0.05, 2, ""),
    "mocap at 200 Hz": (wander, 200, 0.0005, 6, "attitude height"),
    "mocap, micrometres": (eight, 100, 0.00003, 9, "turn"),
    "honest dropouts": (lanes, 25, 0.002, 4, "absent"),
    "long dropouts": (wander, 30, 0.003, 6, "absent gap"),
    "a pause in the recording": (round_, 12.5, 0.005, 4, "gap"),
    "stamps that jitter": (waypoints, 20, 0.005, 4, "jitter"),
    "stamps in bursts": (lanes, 20, 0.005, 4, "burst"),
    "tiny room": (lambda t, r: wander(t, r, 0.2, 0.8), 12.5, 0.001, 4, "height"),
    "whole centimetres": (wander, 12.5, 0.004, 2, ""),
    "held by a slower log": (held(round_, 3), 30, 0.0, 6, ""),
    "held by one at 1 Hz": (held(lanes, 12), 12.5, 0.0, 3, ""),
    "start and landing": (landed, 20, 0.0, 4, ""),
    "start and landing, noisy": (landed, 20, 0.002, 4, "height"),
    "brakes and lands": (brakes, 25, 0.0, 2, ""),
    "along a wall": (lambda t, r: lanes(t, r, (6.0, 0.0)), 12.5, 0.004, 3, ""),
    "over the origin": (lambda t, r: waypoints(t, r, 0.5, 2.0) - 1, 10, 0.0, 2, ""),
}


def sound(kind: str, seed: int, frames: int) -> Flight:
    """A recording of this kind that is as it should be."""
    way, rate, noise, decimals, more = SOUND[kind]
    rng = np.random.default_rng(seed)
    gaps = np.full(frames, 1 / rate)
    if "jitter" in more:
        gaps *= rng.uniform(0.4, 1.6, frames)
    if "burst" in more:
        gaps[::7] *= 4
    if "gap" in more:
        gaps[frames // 2] += 15
    time = np.cumsum(gaps) - gaps[0]
    true = way(time, rng)
    place = true + noise * rng.standard_normal((frames, 2))
    if "drift" in more:
        place += np.cumsum(rng.normal(0, 0.05, (frames, 2)), axis=0)
    place = np.round(place + rng.uniform(-3, 3, 2) * (kind != "over the origin"), decimals)
    if "absent" in more:
        for begin in rng.integers(0, frames, 4):
            place[begin : begin + rng.integers(1, frames // 8)] = np.nan
    usual = 60.0 if "high" in more else 1.5
    height = usual * (1 + 0.2 * np.sin(0.3 * time)) if more else None
    attitude = None
    if "attitude" in more or "turn" in more:
        ahead = np.gradient(true, axis=0)
        yaw = 0.4 * time if "turn" in more else np.unwrap(np.arctan2(-ahead[:, 0], ahead[:, 1]))
        if "turn" not in more:
            yaw = np.convolve(np.pad(yaw, 15, mode="edge"), np.full(31, 1 / 31), "valid")
        tilt = 0.05 * rng.standard_normal((frames, 2))
        attitude = np.column_stack([tilt, np.angle(np.exp(1j * yaw))])
    return Flight(
        kind, np.arange(frames), time, place, area_around(place, 0.02, 0.01), height=height,
        attitude=attitude, histograms=rng.dirichlet(np.ones(4), frames),
    )  # fmt: skip
