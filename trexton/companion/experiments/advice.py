"""What limits the methods on a flight, and what to do.

`limits` are measured on the flights; `advice` and its parts are sentences from an assessment's
record, with all lengths in one unit (`lengths_of`).
"""

import shlex
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import TrextonError
from trexton.base.records import Record
from trexton.companion.experiments.evaluation import evenly_spread
from trexton.companion.experiments.metrics import euclidean
from trexton.companion.wording import apart, lengths, middle, percent
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap
from trexton.localization.training_set import EXCLUDED_SECONDS, training_set

BLURRED = 0.5  # of the median sharpness: below it a frame counts as blurred
SHARPNESS_FRAMES = 200  # are enough to estimate the share
PARTS = 3  # of the floor along each side
FEWEST_THERE = 5  # test frames that say something of a part
FEWEST = 20  # test frames that say something of a flight
PROMISING = 0.75  # of the error of guessing the centre
MOST_HIGHER = 1.3  # times the height of the other flight
NO_CAMERA = "for histograms alone; a camera needs a training flight of pictures"


def limits(
    texton_map: TextonMap, train: Flight, test: Flight, frames: Sequence[np.ndarray]
) -> dict[str, Any]:
    """What may be wrong with the flights, as shares of their frames; `frames` are the test's."""
    known = test.located
    positions, diagonal = texton_map.positions, train.diagonal
    gaps = np.array([euclidean(positions, place).min() for place in test.position[known]])
    found: dict[str, Any] = {"gap_m": float(np.percentile(gaps, 95))}
    heights = [np.nan if each.height is None else each.height for each in (train, test)]
    if all(np.isfinite(each).any() for each in heights):
        found["heights_m"] = [float(np.nanmedian(each)) for each in heights]
    try:
        rows = training_set(texton_map).neighbors(1, EXCLUDED_SECONDS)[:, 0]
        far = euclidean(positions[rows], positions) > diagonal / 4
        found["repeated"] = float(far.mean())
    except TrextonError:  # too short a flight to leave neighbours in time out
        found["repeated"] = None
    if test.has_images:
        lumas = (frames[row][..., 0] for row in evenly_spread(len(test), SHARPNESS_FRAMES))
        sharp = np.array([cv2.Laplacian(luma, cv2.CV_64F).var() for luma in lumas])
        found["blurred"] = float((sharp < BLURRED * np.median(sharp)).mean())
    return found


def best_method(record: Record) -> tuple[str, dict[str, float]]:
    """The method of least mean error, and that error."""
    methods = record.parameters["methods"].split()
    errors = record.values["errors"]
    name = min(methods, key=lambda method: middle(errors[method]["mean_cm"]))
    return name, errors[name]["mean_cm"]


def is_useful(record: Record) -> bool:
    """Whether the best method is better than always guessing the centre, beyond chance."""
    _, error = best_method(record)
    centre = record.values["errors"]["centre"]["mean_cm"]
    return middle(error) < middle(centre) and apart(error, centre)


def is_undecided(record: Record) -> bool:
    """Whether the test is too short to judge by: it has few frames, or errors that promise more."""
    _, error = best_method(record)
    centre = middle(record.values["errors"]["centre"]["mean_cm"])
    few = record.values["counts"]["test"] < FEWEST
    return few or not is_useful(record) and middle(error) < PROMISING * centre


def lengths_of(record: Record) -> Callable[[Any], str]:
    """Says each length of a record, given in cm, in one unit: that of its least mean error."""
    return lengths(least_error_cm(record))


def least_error_cm(record: Record) -> float:
    """The least mean error, yardsticks among them."""
    return min(middle(entry["mean_cm"]) for entry in record.values["errors"].values())


def advice(record: Record, flight: str | None = None) -> list[str]:
    """Where it fails, what limits it and what to do, a sentence each; `flight` is the folder for
    the commands.
    """
    train, fly = commands(record, flight)
    sentences = [*where_it_fails(record), *what_limits(record), *what_next(record, flight)]
    if train:
        best, _ = best_method(record)
        seconds = record.timings[best]["median_s"]
        after = f", then `{fly}`." if fly else f" makes its map, {NO_CAMERA}."
        sentences.append(
            f"On this computer `{best}` takes {1000 * seconds:.2g} ms a frame: `{train}`{after}"
        )
    return sentences


def where_it_fails(record: Record) -> Iterator[str]:
    """The part of the floor where the best method has the largest error."""
    say, (best, error) = lengths_of(record), best_method(record)
    truth = np.array(record.series["truth_m"], dtype=float)
    off = 100 * euclidean(np.array(record.series[f"{best}_m"], dtype=float), truth)
    low, high = np.reshape(record.series["area_m"], (2, 2)).T
    cell = np.clip((truth - low) / (high - low) * PARTS, 0, PARTS - 1).astype(int)
    cells, inverse = np.unique(cell, axis=0, return_inverse=True)
    count = np.bincount(inverse.ravel())
    mean = np.bincount(inverse.ravel(), off) / count
    well = count >= max(FEWEST_THERE, 0.02 * len(off))
    worst = int(np.where(well, mean, 0).argmax())
    if well.any() and mean[worst] > 1.3 * middle(error):
        begin = low + cells[worst] * (high - low) / PARTS
        (x, y), (right, top) = 100 * begin, 100 * (begin + (high - low) / PARTS)
        yield (
            f"It fails most between x = {say(x)} and {say(right)}, y = {say(y)} and {say(top)}: "
            f"there `{best}` is off by {say(mean[worst])} on average, over {count[worst]} "
            f"frames of the test, against {say(middle(error))} over all."
        )


def what_limits(record: Record) -> Iterator[str]:
    """Too few frames, texture that repeats, blur, filters that bring nothing."""
    say, found, area = lengths_of(record), record.values["limits"], record.series["area_m"]
    gap_m, errors = found["gap_m"], record.values["errors"]
    best, error_cm = best_method(record)
    diagonal = np.hypot(*np.ptp(np.reshape(area, (2, 2)), axis=1))
    off = np.array(record.series[f"{best}_m"]) - record.series["truth_m"]
    x, y = 100 * np.median(off, axis=0)
    if np.hypot(x, y) > max(0.8 * middle(error_cm), 5 * diagonal):
        yield f"All positions are off by about x {say(x)}, y {say(y)}: has the test another origin?"
    low, high = sorted(found.get("heights_m", [1, 1]))
    if high > MOST_HIGHER * low:
        yield f"The heights were {say(100 * low)} and {say(100 * high)}: fly both flights at one."
    if gap_m > 0.1 * diagonal:
        yield (
            f"Too few frames: one test frame in twenty is more than {say(100 * gap_m)} from any of "
            f"the {record.values['counts']['train']} training frames. Fly closer lanes."
        )
    if predicted := record.values.get("predicted"):
        yield (
            f"The mean error of `{predicted['method']}` predicted from the training frames alone, "
            f"for the places of the test, is {say(predicted['error_cm'])}; the measured one "
            f"{say(errors[predicted['method']]['mean_cm'])}."
        )
    if found["repeated"] is None:
        yield "The training flight is too short to tell whether its texture repeats."
    elif found["repeated"] > 0.1:
        yield (
            f"Repeated texture: for {percent(found['repeated'])} of the training frames the frame "
            "that looks most alike lies more than a quarter of the area away. Add something "
            "distinct there."
        )
    if (blurred := found.get("blurred") or 0) > 0.1:
        yield (
            f"Blur: {percent(blurred)} of the frames are less than half as sharp as usual. "
            "Shorten the exposure or fly slower."
        )
    centre, knn = (middle(errors[name]["mean_cm"]) for name in ("centre", "knn"))
    for method in record.parameters["methods"].split():
        error = middle(errors[method]["mean_cm"])
        if error >= centre:
            yield (
                f"The method `{method}` is worse here than always guessing the centre: do not fly "
                "it."
            )
        elif error > knn:
            yield (
                f"The method `{method}` is worse here than the plain mean of its neighbours, by "
                f"{say(error - knn)}: its filter brings nothing on this flight."
            )


def what_next(record: Record, flight: str | None = None) -> Iterator[str]:
    """What to try."""
    if is_undecided(record):
        yield "This test cannot judge whether it works: fly a longer one, over the whole area."
    elif is_useful(record):
        yield f"`trexton tune {shlex.quote(flight or record.flight)}` looks for better settings."
    else:
        yield "No method is worth flying here as it is: change the floor or the survey first."


def commands(record: Record, flight: str | None = None) -> tuple[str, str]:
    """How to train and fly the best method with the settings that were flown; empty where it is no
    good, the second also where there are no pictures.
    """
    best, chosen = best_method(record)[0], record.parameters
    useful = is_useful(record) and not is_undecided(record)
    if not useful or not record.timings.get(best, {}).get("median_s"):
        return "", ""
    folder, made = shlex.quote(flight or record.flight), shlex.quote(f"{record.flight}.npz")
    train, fly = f"trexton train {folder} -o {made} --method {best}", f"trexton onboard {made}"
    if "blurred" not in record.values["limits"]:  # no pictures to draw patches of
        return train, ""
    fly += f" --samples {chosen['samples']}"
    fly += f" --particles {chosen['particles']}" if best == "paper" else ""
    return f"{train} --textons {chosen['textons']}", fly
