"""From settings to a loop that is ready to run. The parts are chosen here and nowhere else."""

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from trexton.base.errors import MapError, ParameterError, TrextonError
from trexton.base.files import check_not_read
from trexton.base.streams import stream
from trexton.evaluation.held_out import LEAST_COVERAGE
from trexton.localization.alike import check_kind
from trexton.localization.landing import TouchdownZone
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.map_files import load_map
from trexton.localization.methods import parse_choices
from trexton.onboard.commander import LandingLink
from trexton.onboard.loop import Onboard
from trexton.onboard.settings import Flying, Landing, MapPlacement, MavlinkOptions, Settings
from trexton.onboard.sinks import Guard, Sink, Surroundings, open_sink
from trexton.onboard.sinks.files import JsonLines
from trexton.onboard.sources import Source, open_source
from trexton.onboard.tally import Tally


def build(settings: Settings) -> Onboard:
    """The loop that the settings describe.

    Raises
    ------
    TrextonError
        A setting does not fit, the map cannot be read, a file cannot be made or would be written
        over what is read.
    ModuleNotFoundError
        An extra is not installed.
    """
    flying, landing = settings.of(Flying), settings.of(Landing)
    texton_map = load_map(settings.map)
    zone = landing.zone(texton_map.area)
    localizer = _localizer(texton_map, settings, isinstance(zone, TouchdownZone))
    _warm_up(localizer)
    tally = Tally()
    source = _source(texton_map, settings)
    around = Surroundings(
        settings.of(MapPlacement).local,
        texton_map.area,
        localizer.parts["motion"].growth(1.0),
        tally,
        flying.aiding,
        None if zone is None else np.array(zone.center),
    )
    sinks = [open_sink(address, around, settings.options) for address in settings.outputs]
    landers: list[LandingLink] = [each for each in sinks if isinstance(each, LandingLink)]
    if landing.arm_landing and not landers:
        raise ParameterError("--arm-landing needs a MAVLink link: add --output udpout:HOST:PORT")
    key = settings.of(MavlinkOptions).sign_key or settings.map
    _check_files([settings.map, key, *source.files], [sink.file for sink in sinks], flying.log)
    for address in settings.outputs:
        if settings.outputs.count(address) > 1:
            raise ParameterError(f"output {address!r} is given twice: give it once")
    warnings = [_overconfidence(texton_map, settings), _unread(settings, source, sinks)]
    if any(sink.autopilot for sink in sinks) and settings.of(MapPlacement).heading is None:
        warnings.append("no --heading: the map's +y is taken for north")
    log = Guard(JsonLines(flying.log, events=True), tally) if flying.log else None
    return Onboard(
        localizer,
        source,
        [Guard(sink, tally) for sink in sinks],
        tally=tally,
        rate=flying.rate,
        log=log,
        frames=flying.frames,
        aiding=flying.aiding,
        zone=zone,
        landers=landers,
        lands=landing.arm_landing,
        warnings=list(filter(None, warnings)),
    )


def _source(texton_map: TextonMap, settings: Settings) -> Source:
    """The camera, whose frames come as the map wants them; raises `MapError` where they cannot."""
    camera, rectification = settings.of(Flying).camera, texton_map.rectification
    shape = texton_map.image_shape if rectification is None else rectification.source[::-1]
    source = open_source(camera, shape, settings.options)
    if source.gives == "images" and texton_map.dictionary is None:
        raise MapError(f"{camera} gives images, the map holds no textons: train it on images")
    if source.flight is not None:
        check_kind(source.flight, texton_map)
    if not source.rectified:
        source.rectification = rectification
    if source.live:
        source.delay = settings.of(Flying).camera_delay
    return source


def _unread(settings: Settings, source: Source, sinks: Sequence[Sink]) -> str:
    """What was chosen and nothing here reads, if anything."""
    read = {Flying, MapPlacement, Landing, *(each.options for each in (source, *sinks))}
    delay = "" if source.live else "camera_delay"  # a recording's stamps are of the capture
    flags = [
        kind.flag(each.name)
        for kind, chosen in settings.options.items()
        for each in kind.declared()
        if getattr(chosen, each.name) != each.default
        # A camera is at its own pace, whatever is said.
        and (each.name == delay if kind in read else each.name != "pace")
    ]
    return f"nothing here reads {', '.join(flags)}" if flags else ""


def _localizer(texton_map: TextonMap, settings: Settings, touchdown: bool) -> Localizer:
    """The localizer that flies; raises `ParameterError` where it lacks what the flight asks for."""
    flying = settings.of(Flying)
    choices: dict[str, Any] = dict(parse_choices(settings.choices))
    localizer = Localizer(
        texton_map,
        flying.method,
        samples=flying.samples or None,
        particles=flying.particles,
        # The stream of the first run in the experiments: equal seeds, equal estimates.
        rng=stream(flying.seed, "flight", 0),
        **choices,
    )
    if touchdown and not localizer.parts["filter"].knows_velocity:
        raise ParameterError(
            f"--trigger touchdown needs a velocity, which method {localizer.map.method!r} does not "
            "estimate: take --trigger inside, or a map for method field or fine"
        )
    if settings.of(MavlinkOptions).send_yaw and (
        not localizer.parts["filter"].knows_heading or flying.aiding == "all"
    ):
        raise ParameterError("--send-yaw needs method fine: take a map for it, no --aiding all")
    return localizer


def _overconfidence(texton_map: TextonMap, settings: Settings) -> str:
    """What left-out parts of the training flight say against the map's covariances, if anything.
    Raises `MapError` where a landing by it was asked for, and not by the word that it takes.
    """
    flying, landing = settings.of(Flying), settings.of(Landing)
    found = texton_map.provenance.get("assessment")
    own = bool(found) and flying.method in (None, texton_map.method)
    coverage = found["coverage_90"] if own and found else None
    if not own or (coverage is not None and coverage >= LEAST_COVERAGE):
        same = flying.particles is None and flying.samples == Flying.samples
        if own and same and not settings.choices:
            return ""
        return "nobody measured how many positions the 90 % region of this map and method holds"
    held = "no" if coverage is None else f"{coverage:.0%} of"
    words = f"the map's 90 % region held {held} positions of its own flight"
    if landing.arm_landing and not landing.allow_overconfident:
        advice = "record a closer survey, train field or fine, or add --allow-overconfident"
        raise MapError(f"{settings.map}: {words}, and --arm-landing would land by it: {advice}")
    return words


def _warm_up(localizer: Localizer) -> None:
    """Compile and load now what a frame needs: a first start takes many seconds.

    Another localizer of the same map does it: the one that flies draws what it would have drawn.
    """
    texton_map = localizer.map
    width = texton_map.histograms.shape[1]
    blank = np.full(width, 1 / width)
    if texton_map.dictionary is not None and texton_map.image_shape is not None:
        blank = np.zeros((*texton_map.image_shape, 3), np.uint8)
    with suppress(TrextonError):
        Localizer(texton_map, samples=localizer.samples, rng=np.random.default_rng(1)).step(blank)


def _check_files(read: Sequence[str], outputs: Iterable[str], log: str | None) -> None:
    """Refuse to write over what is read, and to write one file twice, or standard output."""
    written: set[str] = set()
    for path in filter(None, [*outputs, log]):
        real = path if path == "-" else os.path.realpath(path)
        if path != "-":
            check_not_read(path, *read)
        if real in written and not real.startswith("/dev/"):
            raise ParameterError(f"{path}: two outputs would write it: give each a file of its own")
        written.add(real)
