"""The loop: frame in, `Localizer.step`, position out. What the notebooks evaluate is what flies."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from trexton.base.errors import TrextonError
from trexton.flights.aiding import Aiding
from trexton.localization.estimate import Estimate
from trexton.localization.landing import LandingZone
from trexton.localization.localizer import MAX_CATCH_UP, Localizer
from trexton.onboard.commander import Commander, LandingLink
from trexton.onboard.fix import STALE_AFTER, Continuity, Fix
from trexton.onboard.intake import Aids, Grabber, Inspector
from trexton.onboard.sinks import Guard
from trexton.onboard.sources import Frame, Source
from trexton.onboard.status import Status
from trexton.onboard.tally import Tally, flush, say

CLOCK_TOLERANCE = 0.5  # seconds a stamp may lie in the future
MAX_FRAME_AGE = 60.0  # seconds: an older stamp is of another clock, a younger one of an old frame
MIN_STAMP_STEP = 1e-3  # seconds
CAUSES = {  # of what the frames may contradict
    "velocity": "heading, compass, height, attitude, and the odometry's camera",
    "attitude": "the camera's mount, the autopilot's level, signs and order",
}
# Share of the period after which the next frame is looked for: cameras are not exact.
POLL_SHARE = 0.9


class Onboard:
    """Localizes the frames of a source and hands a `Fix` for each to every sink.

    Parameters
    ----------
    rate : float, optional
        Frames a second that are localized at most from a live source, and the deadline of each; the
        map's own rate unless given.
    zone : LandingZone, optional
        Where to land.
    landers : sequence of LandingLink
        Asked whether they fly, and commanded to land there with `lands`; else it is only said.
    log : Guard, optional
        Takes fixes and events.
    tally : Tally
        Shared with source and sinks.
    frames : int, optional
        Stop after so many.
    aiding : {"tilt", "all", "none"}
        What the recording and the sinks may tell of the vehicle; see `trexton.onboard.intake`.
    warnings : sequence of str
        Said at the start, and in every status line.
    clock : callable
        Steady clock in seconds, the one that stamps live frames.
    """

    def __init__(
        self, localizer: Localizer, source: Source, sinks: list[Guard], *, tally: Tally,
        rate: float | None = None, zone: LandingZone | None = None,
        landers: Sequence[LandingLink] = (), lands: bool = True, log: Guard | None = None,
        frames: int | None = None, aiding: str = "tilt", warnings: Sequence[str] = (),
        clock: Callable[[], float] = time.monotonic,
    ):  # fmt: skip
        self.localizer, self.source, self.sinks, self.log = localizer, source, sinks, log
        self.tally, self._frames, self._clock = tally, frames, clock
        self.commander = None
        if zone is not None:
            self.commander = Commander(zone, landers, self.report, commands=lands)
        self._model_period = localizer.map.period_s
        self._period = 1 / rate if rate else self._model_period
        self._fix_period = self._period if source.live else self._model_period
        self.aids = Aids(aiding, sinks)
        made = source.rectification  # of a camera's images, which are checked as they come
        self._inspector = Inspector(made.source[::-1] if made else localizer.map.image_shape)
        self._continuity = Continuity(localizer.parts["motion"].growth, self._fix_period)
        self.status = Status(tally, sinks, self.commander, warnings)
        self._observed_at = -np.inf
        self._fix: Fix | None = None
        self._number = 0

    def run(self, stop: threading.Event) -> dict[str, Any]:
        """Go on until the source ends, `frames` are done or `stop` is set; returns the summary.

        Its ``left_out`` counts what outputs did not take.
        """
        feed = Grabber(self.source, self.tally)
        for guard in self.sinks:
            if guard.sink.autopilot:  # heartbeat, clock and origin do not wait for a frame
                guard.event({"event": "start"})
        if self.log is not None:
            clocks = {"unix_s": time.time(), "clock_s": self._clock()}
            self.log.event({"event": "start", **clocks, "map": self.localizer.map.provenance})
        for warning in self.status.warnings:
            self.report({"event": "warning", "what": warning})
        try:
            while not stop.is_set() and (
                self._frames is None or self.tally["frames"] < self._frames
            ):
                started = self._clock()
                frame = feed.next(1.5 * self._period)
                if frame is not None:
                    self._take(frame)
                elif feed.ended:
                    break
                else:
                    self._bridge()
                self._speak()
                if self.source.live:
                    stop.wait(max(0.0, POLL_SHARE * self._period - (self._clock() - started)))
        finally:
            feed.close()
            summary = self.status.summary()
            for guard in self._everything():
                guard.event({"event": "end", **summary, "left_out": self._left_out()})
                guard.close()
            flush()
        return {**summary, "left_out": self._left_out()}

    def _left_out(self) -> dict[str, int]:
        """What each output did not take, by its file or name; standard output is not counted."""
        counts = {(each.sink.file or each.sink.name): each.left_out for each in self._everything()}
        return {name: count for name, count in counts.items() if count and name != "-"}

    def _everything(self) -> list[Guard]:
        return self.sinks + ([self.log] if self.log is not None else [])

    def _take(self, frame: Frame) -> None:
        """Localize one frame."""
        arrived = self._clock()
        stamp, captured = float(frame.time), arrived  # of NumPy's floats comes no bool
        if self.source.live:
            latest = arrived - self.source.delay
            if not arrived - MAX_FRAME_AGE <= stamp <= latest + CLOCK_TOLERANCE:
                self.tally.count("clock")  # of another clock: nobody knows how old it is
                stamp = latest
            captured = min(stamp, latest)
            if self._fix is not None:  # what was predicted may reach beyond it
                stamp = max(stamp, self._fix.time + MIN_STAMP_STEP)
        self._number = self.tally["frames"] if frame.number is None else frame.number
        self.tally.count("frames")
        picture, made = frame.picture, self.source.rectification
        fault = "corrupt" if picture is None else self._inspector.check(picture)
        if made is not None and picture is not None and fault is None and picture.ndim > 1:
            frame = replace(frame, picture=made.apply(picture))
        if self.source.watch is not None:
            self.source.watch(frame)
        aiding = self.aids.of(frame, captured if self.source.live else stamp)
        estimate, fault = self._step(frame.picture, fault, aiding, stamp)
        if estimate.observed:
            self._observed_at = stamp
            self.tally.count("observed")
        if estimate.velocity_bias is not None:
            off = round(float(np.hypot(*estimate.velocity_bias)), 2)
            self._contradicted("velocity", off_m_s=off)
        if estimate.tilt_bias is not None:
            roll, pitch = np.degrees(estimate.tilt_bias).round(1).tolist()
            self._contradicted("attitude", roll_off_deg=roll, pitch_off_deg=pitch)
        self._pass_on(estimate, stamp, fault, captured)
        total = self._clock() - captured
        self.status.latencies.append(total)
        if total - self.source.delay > self._period:  # its own delay no computer makes up for
            self.tally.count("late")

    def _step(
        self, picture: np.ndarray | None, fault: str | None, aiding: Aiding | None, stamp: float
    ) -> tuple[Estimate, str | None]:
        """The estimate of a frame, predicted only where the frame is at fault."""
        if fault is None:
            try:
                return self.localizer.step(picture, aiding=aiding, time=stamp), None
            except TrextonError as error:
                fault = "misfit"
                if not self.tally[fault]:
                    say(f"trexton onboard: {error}")
        elif fault == "size" and picture is not None and not self.tally[fault]:
            shapes = picture.shape[:2], self._inspector.shape or (0, 0)
            came, own = (f"{columns}x{rows}" for rows, columns in shapes)
            say(f"trexton onboard: frames of {came}, and a map of {own}: set the camera to that")
        self.tally.count(fault)
        return self.localizer.step(None, time=stamp), fault

    def _contradicted(self, what: str, **off: float) -> None:
        """Count what the frames take for wrong; once it was a second long, say it."""
        self.tally.count(what)
        if self.tally[what] == np.ceil(1.0 / self._model_period):
            event = f"{what} contradicted by the frames"
            self.report({"event": event, **off, "look at": CAUSES[what]})

    def _bridge(self) -> None:
        """No frame in time: report what the filter predicts, until one comes."""
        if self.localizer.time is None:
            return
        seen_until = self._clock() - self.source.delay
        missed = int((seen_until - self.localizer.time) / self._model_period - 0.5)
        missed = min(missed, MAX_CATCH_UP)  # what is left comes next
        if missed > 0:
            self.tally.count("gap", missed)
            for _ in range(missed):
                estimate = self.localizer.step(None)
            self._pass_on(estimate, self.localizer.time, "gap", self.localizer.time)

    def _pass_on(
        self, estimate: Estimate, stamp: float, fault: str | None, captured: float
    ) -> None:
        latency = max(0.0, self._clock() - captured)
        # A recording has its own time; a live frame grows old while it is worked on.
        age = stamp - self._observed_at + (latency if self.source.live else 0.0)
        area = self.localizer.map.area
        fix = Fix.of(
            estimate, stamp, self._number, area, self._fix_period,
            stale=age > STALE_AFTER, latency=latency, fault=fault, captured=captured,
        )  # fmt: skip
        self._fix = self._continuity.mark(fix)
        for sink in self._everything():
            sink.write(self._fix)
        if self.commander is not None:
            self.commander.update(estimate, self._fix, self._clock())

    def _speak(self) -> None:
        """Pass news on to the log, and say how things stand once a second."""
        for guard in self.sinks:
            for event in guard.sink.news():
                self.report({"output": guard.sink.name, **event})
        now = self._clock()
        if self.status.due(now):
            line = self.status.line(self._fix, now)
            say(line)
            if self.log is not None:
                self.log.event({"event": "status", "time_s": self._time(), "line": line})

    def _time(self) -> float | None:
        """Of the latest position, for what is logged with it; None before the first."""
        return None if self._fix is None else self._fix.time

    def report(self, event: dict[str, Any]) -> None:
        """Remember an event, and say it."""
        if self.log is not None:
            self.log.event({"time_s": self._time(), **event})
        say(
            "trexton onboard: "
            + ", ".join(f"{key} {value}" for key, value in event.items() if value != "")
        )
