"""From settings to a loop that is ready to run; where the parts are chosen and nowhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trexton.errors import ParameterError
from trexton.landing import LandingZone
from trexton.localizer import Localizer, TextonMap
from trexton.methods import parse_choices
from trexton.onboard.commander import Commander
from trexton.onboard.local import LocalFrame
from trexton.onboard.loop import Onboard
from trexton.onboard.sinks import Guard, SinkOptions, open_sink
from trexton.onboard.sinks.json_lines import JsonLines
from trexton.onboard.sources import SourceOptions, open_source
from trexton.onboard.tally import Tally
from trexton.streams import stream

__all__ = ["Settings", "build"]


@dataclass(frozen=True)
class Settings:
    """Everything that can be chosen; the command line has an option for each.

    Attributes
    ----------
    map : str
        File of the texton map.
    camera : str
        See `trexton.onboard.sources`.
    outputs : tuple of str
        See `trexton.onboard.sinks`.
    samples, particles, method, seed
        See `trexton.localizer.Localizer`; 0 samples stand for every patch.
    choices : tuple of str
        ``role=part`` and ``role.option=value``; see `trexton.methods`.
    rate : float or None
        Frames a second; None for the map's own.
    pace, laps : see `SourceOptions`
    frames : int or None
        Stop after so many.
    log : str or None
        File of fixes and events.
    autopilot : {"px4", "ardupilot"}
    heading_deg, height : float
        See `LocalFrame`; the heading in degrees, as a compass shows it.
    origin : (latitude, longitude, altitude) or None
        To be set as the autopilot's global origin.
    land : (x, y) or None
        Centre of the landing zone in metres; None lands nowhere.
    radius : float
        Its radius in metres.
    spread : (2,) floats
        Thresholds of the particles' standard deviations in metres.
    consecutive : int
        Estimates in a row that must agree.
    arm_landing : bool
        Command the landing; otherwise it is only said.
    """

    map: str
    camera: str = "/dev/video0"
    outputs: tuple[str, ...] = ()
    samples: int = 400
    particles: int | None = None
    method: str | None = None
    choices: tuple[str, ...] = ()
    seed: int = 1
    rate: float | None = None
    pace: str | None = None
    laps: int = 1
    frames: int | None = None
    log: str | None = None
    autopilot: str = "px4"
    heading_deg: float = 0.0
    height: float = 1.0
    origin: tuple[float, float, float] | None = None
    land: tuple[float, float] | None = None
    radius: float = 0.6
    spread: tuple[float, float] = (0.6, 0.6)
    consecutive: int = 3
    arm_landing: bool = False

    def __post_init__(self):
        if self.rate is not None and not 0 < self.rate <= 1000:
            raise ParameterError(
                f"rate {self.rate}: expected frames a second, more than 0 and up to 1000"
            )
        if self.laps < 1 or (self.frames is not None and self.frames < 1):
            raise ParameterError(f"{self.laps} laps, {self.frames} frames: expected at least 1")
        if not (math.isfinite(self.heading_deg) and math.isfinite(self.height) and self.height > 0):
            raise ParameterError(
                f"heading {self.heading_deg} degrees, height {self.height} m: expected a positive height"
            )
        if self.origin is not None and not (
            abs(self.origin[0]) <= 90
            and abs(self.origin[1]) <= 180
            and math.isfinite(self.origin[2])
        ):
            raise ParameterError(
                f"origin {self.origin}: expected latitude, longitude in degrees and altitude in metres"
            )
        if self.arm_landing and self.land is None:
            raise ParameterError(
                "--arm-landing is given without --land: say where, as in --land 2.5,2.5"
            )


def build(settings: Settings) -> Onboard:
    """The loop that the settings describe.

    Raises
    ------
    TrextonError
        A setting does not fit, the map cannot be read, a file cannot be made, or an extra is not installed.
    """
    texton_map = TextonMap.load(settings.map)
    localizer = Localizer(
        texton_map,
        settings.method,
        samples=settings.samples or None,
        particles=settings.particles,
        **parse_choices(settings.choices),
        # The stream of the first run in the experiments: equal seeds, equal estimates.
        rng=stream(settings.seed, "flight", 0),
    )
    tally = Tally()
    source = open_source(
        settings.camera,
        SourceOptions(
            texton_map.image_shape, texton_map.period_s, settings.pace, settings.laps, settings.seed
        ),
    )
    options = SinkOptions(
        LocalFrame(math.radians(settings.heading_deg), settings.height),
        settings.autopilot,
        settings.origin,
        texton_map.area,
        localizer.growth(1.0),
        tally,
    )
    sinks = [Guard(open_sink(address, options), tally) for address in settings.outputs]
    log = Guard(JsonLines(settings.log, events=True), tally) if settings.log else None
    onboard = Onboard(
        localizer, source, sinks, tally=tally, rate=settings.rate, log=log, frames=settings.frames
    )
    onboard.commander = onboard.status.commander = _commander(settings, sinks, onboard)
    return onboard


def _commander(settings: Settings, sinks: list[Guard], onboard: Onboard) -> Commander | None:
    if settings.land is None:
        return None
    zone = LandingZone(settings.land, settings.radius, settings.spread, settings.consecutive)
    landers = (
        [guard.sink for guard in sinks if hasattr(guard.sink, "land")]
        if settings.arm_landing
        else []
    )
    if settings.arm_landing and not landers:
        raise ParameterError(
            "--arm-landing needs an output that can command it: add --output udpout:HOST:PORT or another MAVLink link"
        )
    return Commander(zone, landers, onboard.report)
