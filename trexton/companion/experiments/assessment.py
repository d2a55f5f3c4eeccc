"""Will it work here? What a person asks who brings a flight, answered in plain words.

Every method is flown over the test flight; beside its error stand yardsticks, the error predicted
over the floor, and what limits it. `advice` makes sentences of the record.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.cache import cached
from trexton.base.errors import ParameterError
from trexton.base.files import canonical_json
from trexton.base.records import SECTIONS, Record
from trexton.base.streams import stream
from trexton.companion.experiments.advice import (
    best_method,
    is_undecided,
    is_useful,
    least_error_cm,
    lengths_of,
    limits,
)
from trexton.companion.experiments.declaration import Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import (
    constant_guess,
    floor_picture,
    flown,
    frames_of,
    map_of,
    method_map,
    shuffled_neighbors,
    whereabouts,
)
from trexton.companion.experiments.metrics import euclidean, summarize
from trexton.companion.experiments.rates import of_frames
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    heat_map,
    legend_above,
    length_unit,
    plan_canvas,
)
from trexton.companion.wording import middle
from trexton.field.likelihood import grid_cells
from trexton.flights.flight import Flight
from trexton.localization.methods import compose


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    methods: str = option("paper field", "methods to compare, separated by blanks")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.methods.split():
            raise ParameterError("no methods to compare: name some, as in methods='paper field'")
        for method in self.methods.split():
            compose(method)  # refuses what is none


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly every method over the test flight and say what limits them.

    With images, or with histograms; test frames without a position are flown and not judged. The
    record is cached: a report says what it found before the page that shows it is made.
    """
    inputs = {"train": train.data_hash, "test": test.data_hash, **parameters.as_dict()}

    def compute() -> dict[str, Any]:
        record = _run(train, test, parameters)
        content = {key: getattr(record, key) for key in ("experiment", "flight", *SECTIONS)}
        return record.images | {"record": canonical_json(content)}

    arrays = cached("assessment", __name__, inputs, compute)
    return Record(**json.loads(str(arrays.pop("record"))), images=arrays)


def _run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    frames, known = frames_of(test), test.located
    runs, timings, field_map = {}, {}, None
    base = map_of(train, parameters)
    for method in parameters.methods.split():
        texton_map = method_map(train, parameters, method)
        [track] = flown(train, test, parameters, method, repeats=1, texton_map=texton_map)
        runs[method], timings[method] = track.position, of_frames(track.step_s)
        if hasattr(texton_map.parts.get("measurement"), "predicted_error"):
            field_map = texton_map
    rng = stream(parameters.seed, "intervals")
    runs["knn"] = flown(train, test, parameters, repeats=1)[0].knn
    middle_of = np.reshape(train.area, (2, 2)).mean(axis=1)[None]
    guesses = [constant_guess(places, len(test)) for places in (base.positions, middle_of)]
    errors = [euclidean(guess[known], test.position[known]).mean() for guess in guesses]
    runs["centre"] = guesses[int(np.argmin(errors))]
    runs["shuffled"] = shuffled_neighbors(base.positions, len(test), parameters.neighbors, rng=rng)
    values: dict[str, Any] = {
        "errors": {
            name: summarize([track[known]], test.position[known], test.diagonal, rng=rng)
            for name, track in runs.items()
        },
        "limits": limits(base, train, test, frames),
        "counts": {"train": len(base.positions), "test": int(known.sum())},
    }
    series: dict[str, Any] = {
        "area_m": train.area,
        "truth_m": test.position[known],
        "time_s": (test.time - test.time[0])[known],
        "start_s": test.time[0],
        **{f"{name}_m": track[known] for name, track in runs.items()},
        **whereabouts(train),
    }
    if field_map is not None:
        predict = field_map.parts["measurement"].predicted_error
        error = 100 * float(predict(test.position[known]).mean())
        values["predicted"] = {"method": field_map.method, "error_cm": error}
        series["predicted"] = _predicted(predict, train)
    floor, pictures = floor_picture(train)
    return parameters.record(
        train, test, values=values, series=series | floor, images=pictures, timings=timings
    )


def _predicted(predict: Any, flight: Flight) -> dict[str, Any]:
    """The predicted error over the floor, near where was flown."""
    sides = np.diff(np.reshape(flight.area, (2, 2)), axis=1)
    places, shape = grid_cells(flight.area, round(sides.prod() / (flight.diagonal / 70) ** 2))
    known = flight.position[flight.located]
    apart = np.array([euclidean(known, place).min() for place in places])
    heat = np.where(apart < flight.diagonal / 10, predict(places), np.nan).reshape(shape).T
    return {"error_m": heat.round(4)}


def finding(record: Record) -> str:
    """A few sentences: will it work here?"""
    say, (best, error) = lengths_of(record), best_method(record)
    errors = record.values["errors"]
    centre = middle(errors["centre"]["mean_cm"])
    if is_undecided(record):
        judgement = f"It cannot be judged by {record.values['counts']['test']} test frames"
    elif not is_useful(record):
        judgement = (
            "It will not work here, for no method is clearly better than always guessing the centre"
        )
    elif error["high"] > 0.5 * centre:
        judgement = "It works poorly here"
    else:
        judgement = "It works here"
    return (
        f"{judgement}. The mean error of the method `{best}` is {say(error)}, against "
        f"{say(errors['centre']['mean_cm'])} for always guessing the centre. 95 % of its frames "
        f"are off by less than {say(middle(errors[best]['p95_cm']))}, and by less than "
        f"{say(middle(errors['centre']['p95_cm']))} where the centre is guessed."
    )


# name: what it is called, and its colour
LABELS = {
    "paper": ("the paper's filter", "paper"),
    "field": ("field", "field"),
    "fine": ("fine", "fine"),
    "knn": ("neighbours alone", "neighbors"),
    "centre": ("always the centre", "zone"),
    "shuffled": ("frames drawn at random", "neighbors"),
}


def label_of(name: str) -> tuple[str, str]:
    """What a method or yardstick is called, and its colour; of others their own name."""
    return LABELS.get(name, (name, "neighbors"))


def over_the_floor(record: Record) -> Figure:
    """The truth, and the best method's estimates joined to it, over the predicted error."""
    series, best = record.series, best_method(record)[0]
    truth, estimate = np.array(series["truth_m"]), np.array(series[f"{best}_m"])
    label, color = label_of(best)
    with plan_canvas(record, (6.2, 5.2), fade=0.3) as (figure, plan):
        unit, scale = length_unit(least_error_cm(record) / 100)
        plan.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
        for axis in (plan.xaxis, plan.yaxis):
            axis.set_major_formatter(lambda metres, _: f"{scale * metres:g}")
        if "predicted" in series:
            heat = scale * np.array(series["predicted"]["error_m"], dtype=float)
            heat_map(figure, plan, heat, series["area_m"], f"predicted error ({unit})")
        for true, guess in zip(truth[::5], estimate[::5], strict=True):
            plan.plot(*zip(true, guess, strict=True), color=COLORS[color], linewidth=0.6)
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=1.6, label="true track")
        label = f"{label}, every 5th frame"
        plan.plot(*estimate[::5].T, "o", color=COLORS[color], markersize=3, label=label)
        legend_above(plan)
    return figure


def error_shares(record: Record) -> Figure:
    """Cumulated shares of the errors: a line further to the left is better."""
    series, truth = record.series, np.array(record.series["truth_m"])
    unit, scale = length_unit(least_error_cm(record) / 100)
    names = [*record.parameters["methods"].split(), "knn", "centre", "shuffled"]
    with canvas(size=(7.2, 3.4)) as (figure, [[plot]]):
        for name in names:
            label, color = label_of(name)
            error = scale * np.sort(euclidean(np.array(series[f"{name}_m"]), truth))
            share = 100 * np.arange(1, len(error) + 1) / len(error)
            stroke = "--" if name in ("centre", "shuffled") else "-"
            line: dict[str, Any] = {"color": COLORS[color], "label": label, "linestyle": stroke}
            plot.step(error, share, where="post", **line)
        plot.set(xlabel=f"error ({unit})", ylabel="frames below it (%)", ylim=(0, 100))
        plot.set_xlim(0, None)
        legend_above(plot)
    return figure


EXPERIMENT = Experiment("Will it work here?", Parameters, run, finding, cost_s=14)
