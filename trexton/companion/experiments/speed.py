"""How near each stage comes to the machine's limit: the rows of `trexton bench`, roofs and
exponents.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.base.records import Record, machine
from trexton.base.streams import stream
from trexton.companion.checks.bench import STAGES, measure
from trexton.companion.checks.timing import Row, interleave
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.wording import number
from trexton.flights.flight import Flight

__all__ = ["EXPERIMENT", "finding", "Parameters", "run"]

_COPIED = 64 * 2**20  # bytes: beyond every cache
# stage and size of a row: (operations, bytes that must be read or written at least)
_WORK = {
    ("full histogram", "640x480"): (1.303e9, 640 * 480 * 3),
    ("full histogram, NumPy", "640x480"): (1.303e9, 640 * 480 * 3),
    ("sampled histogram", "400"): (400 * 20 * 108 * 2, 400 * 108),
    ("neighbours", "800"): (800 * 20 * 2, 800 * 20 * 8),
    ("filter step", "50"): (50**2 * 8, 50 * 2 * 3 * 8),  # with more, not all pairs are looked at
}


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    quick: bool = option(True, "fewer and smaller measurements, as in trexton bench --quick")


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Run the bench, and measure the two roofs: copying memory and multiplying matrices, both on
    one thread.

    Parameters
    ----------
    train, test : Flight
        Name the record; the bench makes its own frames, which are the same for every flight.
    """
    start = time.perf_counter()
    rows = list(measure(quick=parameters.quick, seed=parameters.seed))
    with limited_threads(1):
        roofs = _roofs(stream(parameters.seed, "roofs"))
    return parameters.record(
        train,
        test,
        values={"stages": list(STAGES), "limits": sum(row.limit is not None for row in rows)},
        timings={
            "machine": machine(),
            "rows": [row.as_dict() for row in rows],
            "held": sum(row.holds is True for row in rows),
            "points": _points(rows),
            "bench_s": time.perf_counter() - start,
            **roofs,
        },
    )


def _roofs(rng: np.random.Generator) -> dict[str, Any]:
    source = np.zeros(_COPIED, np.uint8)
    target, square = np.empty_like(source), rng.random((1024, 1024), dtype=np.float32)
    times = interleave(
        {"copy": lambda: np.copyto(target, source), "sgemm": lambda: square @ square}, 0.3
    )
    return {
        "bytes_per_s": 2 * _COPIED / times["copy"].median,
        "operations_per_s": 2.0 * 1024**3 / times["sgemm"].median,
    }


def _points(rows: list[Row]) -> list[dict[str, Any]]:
    """Work and rate of the stages whose work can be counted, on one thread where that was timed."""
    points = {}
    for row in rows:
        if (key := (row.stage, row.size)) in _WORK and key not in points:
            operations, touched = _WORK[key]
            points[key] = {
                "stage": row.stage, "size": row.size, "operations_per_byte": operations / touched,
                "operations_per_s": operations / row.ours_s,
            }  # fmt: skip
    return list(points.values())


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    limits, held = record.values["limits"], record.timings["held"]
    missed = [row for row in record.timings["rows"] if row["holds"] is False]
    text = f"{held} of {limits} stages reach what they must against their yardstick"
    if missed:
        worst = max(missed, key=lambda row: row["ratio"] / row["limit"])
        text += (
            f"; furthest off is {worst['stage']} ({worst['size']}) with {number(worst['ratio'])} "
            f"times its yardstick ({worst['yardstick']}), where {number(worst['limit'])} is asked"
        )
    return text + "."


EXPERIMENT = Experiment(
    "As fast as the machine allows", Parameters, run, finding, needs=IMAGES, cost_s=65, alone=True
)
