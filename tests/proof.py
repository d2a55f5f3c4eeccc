"""What autopilots fuse of what is sent, and wrong places before and after they are held back.

``make proof`` writes ``data/reference/onboard.json``, whose tables the page "On board" shows.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

import numpy as np
from onboard_proof import (
    BOUNDS_M,
    DELAYS_S,
    FRAMES,
    SURVEY,
    estimated,
    flights,
    held_back,
    kidnapped,
    proofs,
)

from trexton.base.files import write_file
from trexton.base.progress import say
from trexton.base.records import Record
from trexton.companion.executor import limited, limited_threads, spread, working_on
from trexton.companion.experiments.rates import mean_over_groups
from trexton.companion.provenance import made_by
from trexton.companion.public_flights import read_cyberzoo
from trexton.flights.registry import data_folder, registry
from trexton.localization.training import train_map
from trexton.onboard.fix import Fix

OUT = Path(__file__).resolve().parents[1] / "data" / "reference"
# Of the first painted floors, on which nothing was chosen; of those whose mats repeat.
MOVED, REPEATS = 903, 920
REPEATED_FRAMES, EVERY_S = 800, 8.0  # of a flight over mats that repeat; between kidnappings
NOTICED_S = 0.5  # after a kidnapping: no frame alone can show it
SIGMAS = 4.0  # of the position's own covariance, beyond which it is wrong
MODULES = ("trexton.onboard.loop", "trexton.localization.training", "trexton.simulator.recording")
MEANS = ("inside", "error_cm")  # over delays; what else is measured says how far they lie apart
Measures = dict[str, Any]  # of a flight


def of(texton_map: Any, test: Any, method: str) -> Measures:
    """What each autopilot makes of a flight: mean over the delays, and how far they lie apart."""
    flown: Measures = {}
    for profile, _, wire, best in proofs(texton_map, test, method):
        row = wire.inside, 100 * wire.error_m, wire.error_m / best.error_m
        flown.setdefault(profile, []).append(row)
    values = {}
    for profile, rows in flown.items():
        (inside, error_cm, _), (moved, moved_cm, _) = np.mean(rows, axis=0), np.ptp(rows, axis=0)
        values[profile] = {
            "inside": inside, "error_cm": error_cm, "inside_moved": moved,
            "error_moved_cm": moved_cm, "over_once": max(each[2] for each in rows),
        }  # fmt: skip
    return values


def fused(seed: int) -> Measures:
    """Both methods over one painted floor."""
    say(f"floor moved {seed}")
    with tempfile.TemporaryDirectory() as folder, limited_threads(1):
        survey, test = flights(Path(folder), "moved", seed)
        maps = {m: train_map(survey, method=m, rng=rng_of(1)) for m in ("field", "fine")}
        return {method: of(texton_map, test, method) for method, texton_map in maps.items()}


def repeated(seed: int) -> Measures:
    """Method `field` over one floor whose mats repeat, before and after places are held back."""
    say(f"floor repeats {seed}")
    with tempfile.TemporaryDirectory() as folder, limited_threads(1):
        survey, test = flights(Path(folder), "repeats", seed, REPEATED_FRAMES)
        texton_map = train_map(survey, method="field", rng=rng_of(1))
        made = estimated(texton_map, test)
        cut, since_s = kidnapped(test, EVERY_S)
        taken = estimated(texton_map, cut)
        return {
            name: {
                "wrong_rate": wrong(rule(made), test.position).mean(),
                "kidnapped_wrong_rate": wrong(rule(taken), cut.position).mean(),
                "later_wrong_rate": wrong(rule(taken), cut.position)[since_s > NOTICED_S].mean(),
                "first_s": first(rule(made)),
            }
            for name, rule in (
                ("estimated", list),
                ("sent", lambda fixes: held_back(fixes, texton_map)),
            )
        }


def wrong(fixes: list[Fix], truth: np.ndarray) -> np.ndarray:
    """Whether each is off by more than `SIGMAS` and not lost."""
    off = truth - [fix.position for fix in fixes]
    covariances = np.array([fix.covariance for fix in fixes])
    squares = (off * np.linalg.solve(covariances, off[..., None])[..., 0]).sum(axis=1)
    return (squares > SIGMAS**2) & [fix.usable for fix in fixes]


def first(fixes: list[Fix]) -> float:
    """Seconds to the first that is not lost; the whole flight where none is."""
    begin = next((fix.time for fix in fixes if fix.usable), fixes[-1].time)
    return begin - fixes[0].time


def rng_of(seed: int) -> np.random.Generator:
    """The one that a map is trained with."""
    return np.random.default_rng(seed)


def real() -> Measures:
    """Method `field` on the authors' flight; empty where their data are not."""
    files = [data_folder() / file["key"] for file in registry()["cyberzoo"]["files"]]
    if not all(file.is_file() for file in files):
        say("without the real flight, whose data are not here")
        return {}
    flight = read_cyberzoo(*files)
    texton_map = train_map(flight.part("train"), method="field", rng=rng_of(1))
    return {"field": of(texton_map, flight.part("test"), "field")}


def average(rows: list[Any], name: str = "") -> Any:
    """Means of every measure over floors with their intervals; shares end at 1."""
    if isinstance(rows[0], dict):
        return {key: average([each[key] for each in rows], key) for key in rows[0]}
    share = name.endswith("_rate") or name == "inside"
    return mean_over_groups(rows, highest=1.0 if share else np.inf)


def measure(floors: int, processes: int) -> Record:
    """The record of so many floors of each kind, and of the real flight."""
    with limited(1), working_on(processes):
        alike = spread(repeated, range(REPEATS, REPEATS + floors), "floors whose mats repeat")
        rows = spread(fused, range(MOVED, MOVED + floors), "floors")
    recorded = real()
    cells = [cell for own in [*rows, recorded] for each in own.values() for cell in each.values()]
    most = {key: max(cell[key] for cell in cells) for key in cells[0] if key not in MEANS}
    worst = {
        method: {
            profile: min((own[method][profile] for own in rows), key=lambda cell: cell["inside"])
            for profile in BOUNDS_M
        }
        for method in rows[0]
    }
    return Record(
        "onboard",
        "painted-floors",
        {
            "floors": floors, "first_floor": MOVED, "first_repeating": REPEATS,
            "survey": SURVEY, "frames": FRAMES, "repeating_frames": REPEATED_FRAMES,
            "kidnapped_every_s": EVERY_S, "noticed_s": NOTICED_S, "sigmas": SIGMAS,
            "delays_s": DELAYS_S, "bounds_m": BOUNDS_M,
        },
        {
            "floors": floors, "delays_s": DELAYS_S, "bounds_m": BOUNDS_M, "every_s": EVERY_S,
            "noticed_s": NOTICED_S, "repeats": average(alike), "real": recorded,
            "fused": average(rows), "worst": worst, "most": most,
        },
        series={"fused": rows, "repeats": alike},
        provenance={"modules": MODULES, **made_by(*MODULES)},
    )  # fmt: skip


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--floors", type=int, default=10, help="of each kind (default 10)")
    parser.add_argument("--processes", type=int, default=2, help="that fly them (default 2)")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of onboard.json")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        saved = measure(chosen.floors, chosen.processes).save(made)
        write_file(chosen.out / saved.name, saved.read_text(encoding="utf-8"))
    sys.exit()
