"""``trexton train FLIGHT -o MAP``: make a texton map. It says what error to expect."""

import argparse
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from trexton.base.arguments import add_assignments, add_options, chosen_options
from trexton.base.defaults import PATCH, TEXTONS, USUAL_CELLS
from trexton.base.errors import MapError, ParameterError
from trexton.base.files import check_not_read, check_writable
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.base.streams import stream
from trexton.evaluation.held_out import LEAST_COVERAGE, Assessment, assess
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.flights.plausibility import warnings
from trexton.localization.map_files import check_map_or_new, load_map, save_map
from trexton.localization.methods import compose, parse_choices
from trexton.localization.renewal import renewed
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import train_map

_USUAL = ", ".join(f"{cells} of method {method}" for method, cells in USUAL_CELLS.items())
MOST_LOST = 0.5  # share of frames from which on a map is no use in the air


@dataclass(frozen=True)
class TrainOptions(Options):
    """What is trained"""

    textons: int = option(TEXTONS, "textons in the dictionary")
    patch: int = option(PATCH, "side of a patch in pixels")
    cells: int | None = option(None, f"parts of an image along a side (default 1; {_USUAL})")
    method: str | None = option(None, "parts to train; else field or fine, by left-out frames")
    update: str | None = option(None, "map to renew: frames the flight contradicts are replaced")
    seed: int = option(1, "of the random patches")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its train split is used where it has one")
    parser.add_argument("-o", "--output", required=True, metavar="MAP", help="map to write (.npz)")
    words = "another part, or an option of one, repeatable: distance=hellinger, motion.sigma=0.2"
    add_assignments(parser, "ROLE[.OPTION]=VALUE", words)
    add_options(parser, TrainOptions)


def run(arguments: argparse.Namespace) -> int:
    options = chosen_options(arguments, TrainOptions)
    check_not_read(arguments.output, arguments.flight)
    check_writable(arguments.output)
    check_map_or_new(arguments.output)
    flight = read_flight(arguments.flight).part_or_all("train")
    for doubt in warnings(flight):
        say(f"warning  {doubt}")
    choices: dict[str, Any] = {**parse_choices(arguments.settings)}
    if options.update is not None:
        return _update(flight, options, choices, arguments.output)
    methods = [options.method] if options.method else _candidates(flight, choices)
    choices = {"patch": options.patch, "cells": options.cells, **choices}
    tried = []
    for method in methods:
        rng = stream(options.seed, "training")  # as experiments do: equal seeds give equal maps
        frames = flight.select(flight.located) if method == "fine" else None
        try:
            made = train_map(flight, method=method, n_textons=options.textons, rng=rng, **choices)
            tried.append(_assessed(made, frames, options))
        except MapError as error:
            if method == methods[-1] and not tried:
                raise
            say(f"method {method} is left out: {error}")
    texton_map, assessment = min(tried, key=lambda each: _demerit(each[1]))
    path = save_map(texton_map, arguments.output)
    say(f"{len(texton_map.positions)} frames of {flight.name} became {path}")
    others = [(each.method, other) for each, other in tried if other and each is not texton_map]
    words = "".join(f" ({method} {100 * other.error_m:.0f} cm)" for method, other in others)
    why = "" if options.method else ", chosen for flying" + words
    say(f"method {texton_map.method}{why}: {_verdict(assessment)}")
    return 0


def _update(flight: Flight, options: TrainOptions, choices: dict[str, Any], output: str) -> int:
    """Renew a map; its own textons, method and parts stay."""
    if choices or options != TrainOptions(update=options.update, seed=options.seed):
        raise ParameterError("--update renews a map as it is: leave other options out, but --seed")
    old = load_map(str(options.update))
    made, replaced = renewed(old, flight, rng=stream(options.seed, "training"))
    texton_map, assessment = _assessed(made, None, options)
    count, path = len(texton_map.positions), save_map(texton_map, output)
    say(f"{flight.name} replaced {replaced} frames of {options.update}: {count} now in {path}")
    say(f"method {texton_map.method}: {_verdict(assessment)}")
    return 0


def _candidates(flight: Flight, choices: dict[str, Any]) -> list[str]:
    """Methods one may fly that can read the flight and all choices; the paper's where none can."""
    methods = ["field", "fine"] if flight.has_images and flight.camera else ["field"]
    fit = []
    for method in methods:
        with suppress(ParameterError):
            compose(method, choices)
            fit.append(method)
    return fit or ["paper"]


def _assessed(
    texton_map: TextonMap, frames: Flight | None, options: TrainOptions
) -> tuple[TextonMap, Assessment | None]:
    """The map with what left-out parts of its flight say of it; None of a short or slow flight."""
    try:
        assessment = assess(texton_map, frames, rng=stream(options.seed, "assessment"))
    except MapError:
        return texton_map, None
    provenance = texton_map.provenance | {"assessment": asdict(assessment)}
    return replace(texton_map, provenance=provenance), assessment


def _demerit(assessment: Assessment | None) -> tuple[bool, float]:
    """Least for the method to fly: those that are honest and seldom lost, then by their error."""
    if assessment is None:
        return True, np.inf
    honest = (assessment.coverage_90 or 0.0) >= LEAST_COVERAGE
    return not honest or assessment.lost_share > MOST_LOST, assessment.error_m


def _verdict(assessment: Assessment | None) -> str:
    """What to expect of a map, and how honest its covariances are."""
    if assessment is None:
        return "the flight is too short to tell what to expect of it, or its frames are too rare"
    lost, coverage = assessment.lost_share, assessment.coverage_90
    words = f"{100 * assessment.error_m:.0f} cm mean error on left-out parts of this flight"
    if coverage is None or lost > MOST_LOST:
        why = "frames look like several places, or like none"
        if assessment.wide_share > 0.5:
            why = "what it may claim at best is too wide for so small an area"
        return f"{words}. LOST in {lost:.0%} of frames, {why}: record a longer, closer survey"
    honest = "honest" if coverage >= LEAST_COVERAGE else "OVERCONFIDENT, do not steer by it"
    held = f"The 90 % region held the true position in {coverage:.0%} of the others: {honest}"
    return f"{words}, lost in {lost:.0%} of frames.\n{held}"
