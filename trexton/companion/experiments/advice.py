"""What limits the methods on a flight, and what to do.

Offers `limits`, measured on the flights, and `advice`, sentences from an assessment's record.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import TrextonError
from trexton.base.records import Record
from trexton.companion.experiments.evaluation import evenly_spread
from trexton.companion.wording import apart, distance, middle, percent
from trexton.evaluation.metrics import euclidean
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap
from trexton.localization.training import training_set
from trexton.localization.training_set import EXCLUDED_SECONDS

BLURRED = 0.5  # of the median sharpness: below it a frame counts as blurred
SHARPNESS_FRAMES = 200  # are enough to tell
STRETCH_S = 5.0  # of a survey: every other one makes half of it
HELPS = 0.8  # of the error with half of the survey: where the whole errs less, more of it helps
DENSE = "a denser survey would bring little"


def limits(texton_map: TextonMap, train: Flight, test: Flight) -> dict[str, Any]:
    """What may be wrong with the flights, as shares of their frames."""
    known = test.located
    positions, diagonal = texton_map.positions, train.diagonal
    gaps = np.array([euclidean(positions, place).min() for place in test.position[known]])
    found: dict[str, Any] = {"gap_m": float(np.percentile(gaps, 95))}
    try:
        rows = training_set(texton_map).neighbors(1, EXCLUDED_SECONDS)[:, 0]
        far = euclidean(positions[rows], positions) > diagonal / 4
        found["repeated"] = float(far.mean())
    except TrextonError:  # too short a flight to leave neighbours in time out
        found["repeated"] = None
    if test.has_images:
        chosen = evenly_spread(len(test), SHARPNESS_FRAMES)
        sharp = np.array(
            [cv2.Laplacian(test.image(row)[..., 0], cv2.CV_64F).var() for row in chosen]
        )
        found["blurred"] = float((sharp < BLURRED * np.median(sharp)).mean())
    return found


def best_method(record: Record) -> tuple[str, dict[str, float]]:
    """The method of least mean error, and that error."""
    methods = record.parameters["methods"].split()
    errors = record.values["errors"]
    name = min(methods, key=lambda method: middle(errors[method]["mean_cm"]))
    return name, errors[name]["mean_cm"]


def is_useful(record: Record) -> bool:
    """Whether the best method can be told from always guessing the centre."""
    _, error = best_method(record)
    centre = record.values["errors"]["centre"]["mean_cm"]
    return middle(error) < middle(centre) and apart(error, centre)


def advice(record: Record, flight: str | None = None) -> list[str]:
    """What limits it and what to do, a sentence each; `flight` is the folder for the commands."""
    makers = (_of_survey, _of_frames, _of_methods)
    sentences = [sentence for make in makers for sentence in make(record)]
    return sentences + list(_of_commands(record, flight or record.flight))


def _of_survey(record: Record) -> Iterator[str]:
    """Whether it covers the floor, what it predicts, whether more of it or odometry would help."""
    values, area = record.values, np.reshape(record.series["area_m"], (2, 2))
    gap_m = values["limits"]["gap_m"]
    if gap_m > 0.1 * np.hypot(*np.ptp(area, axis=1)):
        yield (
            f"Too few frames: one test frame in twenty is more than {gap_m:.2g} m from any of the "
            f"{values['counts']['train']} training frames. Fly closer lanes."
        )
    errors = {name: entry["mean_cm"] for name, entry in values["errors"].items()}
    if predicted := values.get("predicted"):
        yield (
            f"The mean error of `{predicted['method']}` predicted from the training frames alone, "
            f"for the places of the test, is {distance(predicted['error_cm'])}; the measured one "
            f"{distance(errors[predicted['method']])}."
        )
    if half := values.get("half"):
        whole = middle(errors[half["method"]])
        helps = whole < HELPS * half["error_cm"]
        yield (
            f"With every other {STRETCH_S:.0f} s of the survey the error of `{half['method']}` "
            f"is {distance(half['error_cm'])}, with all of it {distance(whole)}: "
            f"{'lanes between these should help again' if helps else DENSE}."
        )
    if moving := values.get("odometry"):
        alone = middle(errors[moving["method"]])
        gains = moving["error_cm"]["high"] < alone
        yield (
            f"With a velocity from the motion of the frames themselves the error of "
            f"`{moving['method']}` is {distance(moving['error_cm'])}"
            + (
                ": train with `--set odometry=visual`."
                if gains
                else f", which is no gain over {distance(alone)} beyond chance."
            )
        )


def _of_frames(record: Record) -> Iterator[str]:
    """Texture that repeats, blur, and places that are hard."""
    repeated = record.values["limits"]["repeated"]
    if repeated is None:
        yield "The training flight is too short to tell whether its texture repeats."
    elif repeated > 0.1:
        yield (
            f"Repeated texture: for {percent(repeated)} of the training frames the frame that "
            "looks most alike lies more than a quarter of the area away. Add something distinct "
            "there."
        )
    blurred = record.values["limits"].get("blurred") or 0
    if blurred > 0.1:
        yield (
            f"Blur: {percent(blurred)} of the frames are less than half as sharp as usual. "
            "Shorten the exposure or fly slower."
        )
    if not (predicted := record.values.get("predicted")):
        return
    for place in record.values.get("hardest", []):
        if place["predicted_cm"] > predicted["error_cm"]:  # no harder than the others otherwise
            yield (
                f"Hard place: at x = {place['x_m']:.1f} m, y = {place['y_m']:.1f} m the predicted "
                f"mean error of `{predicted['method']}` is {distance(place['predicted_cm'])}, "
                f"where it is {distance(predicted['error_cm'])} on average."
            )


def _of_methods(record: Record) -> Iterator[str]:
    errors = record.values["errors"]
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
                f"{distance(error - knn)}: its filter brings nothing on this flight."
            )


def _of_commands(record: Record, flight: str) -> Iterator[str]:
    """How to train and fly the best method with the settings that were flown, if it is any good."""
    best, chosen = best_method(record)[0], record.parameters
    if not is_useful(record):
        yield "No method is worth flying here as it is: change the floor or the survey first."
        return
    folder, made = shlex.quote(flight), shlex.quote(f"{record.flight}.npz")
    pictures = "blurred" in record.values["limits"]  # of which it drew patches
    if not (seconds := record.timings.get(best, {}).get("median_s")):
        return
    words, learned, flown = [], "", ""
    if pictures:
        words = [f"{chosen['textons']} textons", f"{chosen['samples']} samples"]
        learned, flown = f" --textons {chosen['textons']}", f" --samples {chosen['samples']}"
    if best == "paper":
        words.append(f"{chosen['particles']} particles")
        flown += f" --particles {chosen['particles']}"
    drawn = f" with {', '.join(words)}" if words else ""
    after = (
        f", then `trexton onboard {made}{flown}`. "
        if pictures
        else " makes its map, for histograms alone; a camera needs a training flight of pictures. "
    )
    yield (
        f"On this computer `{best}` takes {1000 * seconds:.2g} ms a frame{drawn}: "
        f"`trexton train {folder} -o {made} --method {best}{learned}`{after}"
        f"`trexton tune {folder}` looks for better settings."
    )
