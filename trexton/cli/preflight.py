"""Before take-off the loop runs for some seconds and commands nothing. What it met is judged line
by line."""

import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from trexton.base.errors import TrextonError
from trexton.flights.motion import seen_motion, turns
from trexton.localization.localizer import Localizer
from trexton.localization.neighbors import neighbors_in_flight
from trexton.localization.training_set import EXCLUDED_SECONDS
from trexton.onboard.build import build
from trexton.onboard.edges import edge_at
from trexton.onboard.intake import Aids
from trexton.onboard.loop import CAUSES, Onboard
from trexton.onboard.settings import LONGEST_DELAY, Flying, Landing, MapPlacement, Settings
from trexton.onboard.sinks import SINKS, Check
from trexton.onboard.sources import Frame, Playback
from trexton.vision.time_offset import small, time_offset

DURATION = 5.0  # seconds that the loop runs
INSPECTED_FRAMES = 10  # frames that are looked at closely
MAX_TURN_FRAMES = 500  # frames of which it is looked at how they turn
NOVELTY = 0.99  # quantile of training distances: one place in a hundred alarms without cause


class _Watch:
    """Keeps the latest frames, with what is known beside each; and of all that came their small
    luma, with the yaw that aiding gave meanwhile."""

    def __init__(self, aids: Aids, delay: float):
        self.delay = delay
        self.frames: deque[Frame] = deque(maxlen=INSPECTED_FRAMES)
        self.small: deque[tuple[float, np.ndarray]] = deque(maxlen=MAX_TURN_FRAMES)
        self.yaw: dict[float, float] = {}  # by its stamp
        self._aids = aids

    def __call__(self, frame: Frame) -> None:
        if frame.picture is None:
            return
        self.frames.append(replace(frame, aiding=self._aids.of(frame, frame.time)))
        if frame.picture.ndim == 3:
            self.small.append((frame.time, small(frame.picture)))
        aiding = self._aids.everything(frame, frame.time + self.delay)
        if aiding.yaw is not None and aiding.attitude_time is not None:
            self.yaw[aiding.attitude_time] = aiding.yaw


def preflight(settings: Settings, seconds: float = DURATION) -> list[Check]:
    """Run the settings for a while: positions go to autopilots alone, no landing is asked for.
    Raises as `build`.
    """
    sinks = ((each, edge_at("sinks", each, SINKS)) for each in settings.outputs)
    autopilots = tuple(each for each, addressed in sinks if addressed and addressed[0].autopilot)
    changes: dict[Any, Any] = {
        Flying: replace(settings.of(Flying), log=None, frames=None),
        Landing: replace(settings.of(Landing), arm_landing=False),
        Playback: replace(settings.of(Playback), pace="stamps"),
    }
    quiet = replace(settings, outputs=autopilots, options={**settings.options, **changes})
    onboard, stop = build(quiet), threading.Event()
    watched = _Watch(onboard.aids, onboard.source.delay)
    onboard.source.watch = watched
    timer = threading.Timer(seconds, stop.set)
    timer.start()
    try:
        onboard.run(stop)
    finally:
        timer.cancel()
    ended = time.monotonic()  # what follows takes its time, in which nobody listens
    frames = list(watched.frames)
    pictures = [frame.picture for frame in frames if frame.picture is not None]
    return [
        *_of_camera(settings.of(Flying).camera, onboard, pictures),
        *_of_map(onboard.localizer, frames),
        *_of_delay(watched),
        *_of_links(settings, onboard, ended),
    ]


def _of_camera(address: str, onboard: Onboard, pictures: list[np.ndarray]) -> Iterator[Check]:
    tally, faults = onboard.tally, onboard.tally.faults
    observed, said = tally["observed"], ", ".join(f"{name} {n}" for name, n in faults.items())
    sizes = {p.shape[1::-1] for p in pictures if p.ndim == 3}
    size = ", ".join(f"{width}x{height}" for width, height in sorted(sizes)) or "histograms"
    words = f"{address}, {tally['frames']} frames of {size}, {observed} usable"
    words = words if pictures else f"{address} gives no frames: check cable, permissions, --camera"
    usable = bool(pictures) and 2 * observed > tally["frames"]
    yield Check("camera", usable, words + (f" (faults: {said})" if said else ""))
    for what, causes in CAUSES.items():
        if many := tally[what]:
            words = f"{many} of {tally['frames']} frames contradict it: look at {causes}"
            yield Check(what, False, words)


def _of_map(localizer: Localizer, frames: list[Frame]) -> Iterator[Check]:
    """How far what is seen is from the map, beside the map's own frames from each other."""
    texton_map, nearest = localizer.map, localizer.nearest
    everywhere = Localizer(texton_map, samples=None, nearest=nearest, rng=np.random.default_rng(1))
    seen = [(each.picture, each.aiding) for each in frames if each.picture is not None]
    if not seen:
        yield Check("map", False, "nothing was seen to compare it with")
        return
    try:
        observations = [everywhere.observe(picture, aiding=aiding) for picture, aiding in seen]
        histograms, time_s = texton_map.histograms, texton_map.time
        rows = neighbors_in_flight(nearest, histograms, time_s, 1, EXCLUDED_SECONDS)[:, 0]
    except TrextonError as error:
        yield Check("map", False, str(error))
        return
    apart = [
        texton_map.distance.between(each[None], histograms[row : row + 1]).item()
        for each, row in zip(histograms, rows, strict=True)
    ]
    usual = float(np.quantile(apart, NOVELTY))
    now = float(np.median([nearest.query(each, 1).distance[0] for each in observations]))
    words = f"nearest histogram at {now:.3f}; of training frames {NOVELTY:.0%} within {usual:.3f}"
    advice = "" if now <= usual else ": another floor, light or height than the map was made at"
    yield Check("map", now <= usual, words + advice)


def _of_delay(watched: _Watch) -> Iterator[Check]:
    """Whether the picture turns when the vehicle turns, and as it does."""
    if not watched.yaw:
        return
    stamps = [stamp for stamp, _ in watched.small]
    yaw_s, yaw = zip(*sorted(watched.yaw.items()), strict=True)
    turned = turns(seen_motion(luma for _, luma in watched.small))
    offset = time_offset(stamps, turned, yaw_s, yaw)
    if offset is None:
        return
    late = watched.delay + offset.seconds
    if not offset.sure:
        words = "the vehicle turned too little to tell: turn it to and fro while this runs"
    elif offset.mirrored:
        words = "the picture turns against the vehicle: its camera mirrors it, switch that off"
    else:
        words = f"frames come {late:.2f} s after the attitude they show, {watched.delay:g} given"
        if offset.noticeable and not 0 <= late <= LONGEST_DELAY:
            words += ": more than can be made up for, look for a quicker camera or link"
        elif offset.noticeable:
            words += f": add --camera-delay {late:.2f}"
    yield Check("delay", not offset.sure or not (offset.mirrored or offset.noticeable), words)


def _of_links(settings: Settings, onboard: Onboard, now: float) -> Iterator[Check]:
    """What the autopilots had said when the loop ended, at `now`."""
    for guard in onboard.sinks:
        if guard.left_out:
            words = f"{guard.sink.name} took no positions {guard.left_out} times: see what it said"
            yield Check("link", False, words)
        else:
            yield from guard.sink.checks(now)
    if onboard.sinks:
        heading = settings.of(MapPlacement).heading
        words = "not given: add --heading, 0 where the map's +y points north"
        words = words if heading is None else f"the map's +y points to {heading:g} degrees"
        yield Check("heading", heading is not None, words)
