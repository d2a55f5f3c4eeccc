"""What limits the methods on a flight, and what to do: in words, from an assessment's record.

Offers `advice`, a list of sentences; each kind of limit has a function of its own.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trexton.base.records import Record
from trexton.companion.experiments.assessment import STRETCH_S, best_method
from trexton.companion.wording import distance, middle, percent

HELPS = 0.8  # of the error with half of the survey: where the whole errs less, more of it helps


def advice(record: Record) -> list[str]:
    """What limits it and what to do, a sentence each."""
    makers = (
        _of_gaps, _of_prediction, _of_half, _of_odometry, _of_texture, _of_blur, _of_hard_places,
        _of_methods, _of_commands,
    )  # fmt: skip
    return [sentence for make in makers for sentence in make(record)]


def _of_gaps(record: Record) -> Iterator[str]:
    gap_m, area = record.values["limits"]["gap_m"], record.series["area_m"]
    if gap_m > 0.1 * np.hypot(*np.ptp(np.reshape(area, (2, 2)), axis=1)):
        yield (
            f"Too few frames: one test frame in twenty is more than {gap_m:.2g} m from any of the "
            f"{record.values['counts']['train']} training frames. Fly closer lanes."
        )


def _of_prediction(record: Record) -> Iterator[str]:
    if predicted := record.values.get("predicted"):
        measured = record.values["errors"][predicted["method"]]["mean_cm"]
        yield (
            f"The error predicted from the training frames alone, for the places of the test, is "
            f"{distance(predicted['error_cm'])}; the measured one {distance(measured)}."
        )


def _of_half(record: Record) -> Iterator[str]:
    if half := record.values.get("half"):
        whole = middle(record.values["errors"][half["method"]]["mean_cm"])
        yield (
            f"With every other {STRETCH_S:.0f} s of the survey the error of `{half['method']}` "
            f"is {distance(half['error_cm'])}, with all of it {distance(whole)}: "
            + (
                "lanes between these should help again."
                if whole < HELPS * half["error_cm"]
                else "a denser survey would bring little."
            )
        )


def _of_odometry(record: Record) -> Iterator[str]:
    if moving := record.values.get("odometry"):
        alone = middle(record.values["errors"][moving["method"]]["mean_cm"])
        yield (
            f"With a velocity from the motion of the frames themselves the error of "
            f"`{moving['method']}` is {distance(moving['error_cm'])}"
            + (
                ": train with `--set odometry=visual`."
                if moving["error_cm"]["high"] < alone
                else f", which is no gain over {distance(alone)} beyond chance."
            )
        )


def _of_texture(record: Record) -> Iterator[str]:
    repeated = record.values["limits"]["repeated"]
    if repeated is None:
        yield "The training flight is too short to tell whether its texture repeats."
    elif repeated > 0.1:
        yield (
            f"Repeated texture: for {percent(repeated)} of the training frames the frame that "
            "looks most alike lies more than a quarter of the area away. Add something distinct "
            "there."
        )


def _of_blur(record: Record) -> Iterator[str]:
    blurred = record.values["limits"].get("blurred") or 0
    if blurred > 0.1:
        yield (
            f"Blur: {percent(blurred)} of the frames are less than half as sharp as usual. "
            "Shorten the exposure or fly slower."
        )


def _of_hard_places(record: Record) -> Iterator[str]:
    for place in record.values.get("hardest", []):
        yield (
            f"Hard place: at x = {place['x_m']:.1f} m, y = {place['y_m']:.1f} m expect to be off "
            f"by {distance(place['predicted_cm'])}."
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


def _of_commands(record: Record) -> Iterator[str]:
    best = best_method(record)[0]
    if seconds := record.timings.get(best, {}).get("median_s"):
        drawn, learned, flown = _settings(record, best)
        yield (
            f"On this computer `{best}` takes {1000 * seconds:.2g} ms a frame{drawn}: "
            f"`trexton train FLIGHT -o MAP --method {best}{learned}`"
            + (
                f", then `trexton onboard MAP{flown}`. "
                if "blurred" in record.values["limits"]
                else " makes its map, for histograms alone; a camera needs a training flight of "
                "pictures. "
            )
            + "`trexton tune FLIGHT` looks for better settings."
        )


def _settings(record: Record, method: str) -> tuple[str, str, str]:
    """What the method flew with, in words, and as options of training and of flight."""
    chosen, words, learned, flown = record.parameters, [], "", ""
    if "blurred" in record.values["limits"]:  # it flew pictures, of which it drew patches
        words = [f"{chosen['textons']} textons", f"{chosen['samples']} samples"]
        learned, flown = f" --textons {chosen['textons']}", f" --samples {chosen['samples']}"
    if method == "paper":
        words.append(f"{chosen['particles']} particles")
        flown += f" --particles {chosen['particles']}"
    return f" with {', '.join(words)}" if words else "", learned, flown
