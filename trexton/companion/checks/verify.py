"""Are the results still the same? A record's experiment runs again, in fresh processes.

The processes differ in what must not matter (hash seed, threads, cache), and must agree to
the byte; with other kernels of the BLAS, which round their sums otherwise, to 1e-9 (1e-6 where a
method multiplies in single precision). What they agree on is compared with the record; where that
differs, the versions that moved since are named.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trexton.base.cache import kept_results
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file, canonical_json, digest
from trexton.base.progress import progress
from trexton.base.records import Record, software_versions, upgraded
from trexton.companion.executor import THREAD_VARIABLES
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights.splits import load_pair

__all__ = ["QUICK", "VARIANTS", "Verdict", "rebuild", "references", "update", "verify"]

RELATIVE, NEAR_ZERO = 1e-9, 1e-12  # of numbers that are not whole
SINGLE = {"kidnapping": 1e-6}  # instead, where a method multiplies in single precision
RESULTS = ("values", "series", "images")
_PROGRAM = "from trexton.companion.checks.verify import rebuild; rebuild(*sys.argv[1:])"

Content = dict[str, Any]
Variants = Mapping[str, dict[str, str]]

_ONE = dict.fromkeys(THREAD_VARIABLES, "1") | {"PYTHONHASHSEED": "0"}
_TWO = dict.fromkeys(THREAD_VARIABLES, "2") | {"PYTHONHASHSEED": "1"}
_WARM = "warm cache"  # that the first process left
_BLAS = "OPENBLAS_CORETYPE"
# What is different in one process: its environment. BLAS kernels with and without fused products
# round apart; the others must agree to the last bit.
VARIANTS = {
    "one thread, cold cache": _ONE,
    "another hash seed, two threads": _TWO,
    _WARM: _ONE,
    "BLAS kernels of Haswell": _ONE | {_BLAS: "Haswell"},
    "BLAS kernels of Nehalem": _ONE | {_BLAS: "Nehalem"},  # without fused products
}
# As far from the process that made the references as the bits allow.
QUICK = {"another hash seed, two threads": _TWO}


@dataclass(frozen=True)
class Verdict:
    """What came of a record.

    Attributes
    ----------
    path : Path
    disagreements : list of str
        Between the processes, each with the name of the one that is off.
    changes : list of str
        Between the record and the first process.
    versions : list of str
        What moved since the record was made.
    rebuilt : dict
        The record of the first process, as its file has it.
    """

    path: Path
    disagreements: list[str]
    changes: list[str]
    versions: list[str]
    rebuilt: Content


def references() -> list[Path]:
    """The committed reference values: records that say how their flights are simulated.

    Raises
    ------
    TrextonError
        There are none, as where the package is installed without its repository.
    """
    kept = [path for path in kept_results() if path.name.startswith("verify-")]
    if not kept:
        raise TrextonError("no reference values are here: name a record, or work in a whole clone")
    return kept


def verify(
    path: Path, work: Path, flight: str | None = None, test_flight: str | None = None,
    variants: Variants = VARIANTS,
) -> Verdict:  # fmt: skip
    """Run the experiment of the record at `path` once for each of the `variants`, and compare.

    Parameters
    ----------
    path, work : Path
        The record, and a folder for caches, flights and results, which several records may share.
    flight, test_flight : str, optional
        Folders of its flights; needed where the record does not say how they are simulated.

    Raises
    ------
    TrextonError
        The record cannot be read, its flights are missing, or a process fails.
    """
    record = _read(path)
    given = [str(each) for each in (flight, test_flight) if each]
    flights = given or _simulated(record, work)
    work = work / path.stem
    work.mkdir(parents=True, exist_ok=True)
    if not flights:
        raise TrextonError(
            f"{path}: was made of {', '.join(record['provenance'].get('flights', {})) or 'flights'}"
            ": name their folders with --flight and --test-flight"
        )
    made = {}
    for number, (name, chosen) in enumerate(progress(variants.items(), "processes", len(variants))):
        cache = work / f"cache-{0 if name == _WARM else number}"
        environment = os.environ | chosen | {"TREXTON_CACHE": str(cache)}
        made[name] = _run(name, environment, path, work / f"results-{number}", flights)
    first, within = next(iter(made.values())), SINGLE.get(record["experiment"], RELATIVE)
    disagreements = [
        f"{name}: {line}"
        for name, other in made.items()
        for line in differences(first, other, within=within if _BLAS in variants[name] else 0)
    ]
    changes = [
        line
        for section in RESULTS
        if record.get(section)
        for line in differences(record[section], first[section], section, within)
    ]
    then, now = record["provenance"], first["provenance"]
    # The last bits of what is simulated here are this processor's; values tell more than they do.
    if given:
        changes += differences(then.get("flights", {}), now["flights"], "data of flight")
    versions = differences(then.get("versions", {}), software_versions())
    return Verdict(path, disagreements, changes, versions, first)


def _run(
    name: str, environment: Mapping[str, str], path: Path, out: Path, flights: list[str]
) -> Content:  # without what the clock says
    command = [sys.executable, "-c", f"import sys; {_PROGRAM}", str(path), str(out), *flights]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, errors="replace"
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise TrextonError(f"{path}: its experiment failed with {name}: {last}")
    (made,) = out.glob("*.json")
    return {key: value for key, value in _read(made).items() if key != "timings"}


def rebuild(path: str, out: str, flight: str, test_flight: str | None = None) -> None:
    """Run the experiment of the record at `path` with its parameters; the new record goes to `out`.

    Raises
    ------
    TrextonError
        The experiment is unknown, or reads the records of all flights.
    """
    record = _read(Path(path))
    name = record["experiment"]
    if name not in EXPERIMENTS or EXPERIMENTS[name].every_flight:
        raise TrextonError(f"{path}: {name!r} is no experiment on flights: choose another record")
    experiment = EXPERIMENTS[name]
    parameters = experiment.parameters.parse(record["parameters"], name)
    train, test = load_pair(flight, test_flight)
    assert experiment.run is not None
    experiment.run(train, test, parameters).save(out)


def update(verdict: Verdict) -> None:
    """Write what the processes agreed on as the new reference values.

    Raises
    ------
    TrextonError
        They do not agree, or the record is a result of a run and no reference.
    """
    record = _read(verdict.path)
    if "simulated" not in record["provenance"]:
        raise TrextonError(
            f"{verdict.path}: is the result of a run, not a reference: "
            "run its experiment again with trexton run"
        )
    if verdict.disagreements:
        raise TrextonError(f"{verdict.path}: kept, for the processes disagree: see above")
    simulated = {"simulated": record["provenance"]["simulated"]}
    kept: Content = {"series": {}, "images": {}, "timings": {}}
    new = verdict.rebuilt | kept | {"provenance": verdict.rebuilt["provenance"] | simulated}
    with atomic_file(verdict.path) as stream:
        stream.write(canonical_json(new))


def differences(
    expected: object, actual: object, place: str = "", within: float = RELATIVE
) -> list[str]:
    """Lines that name each entry of nested values that is not as expected, as ``a.b: 1 -> 2``.

    Whole numbers, words and truth values must be equal; other numbers `within` a share of each
    other, or, for 0, to the last bit.
    """
    trees = before, after = dict(_leaves(expected, place)), dict(_leaves(actual, place))
    return [
        f"{key}: {' -> '.join(repr(each[key]) if key in each else 'absent' for each in trees)}"
        for key in sorted(before.keys() | after.keys())
        if not (key in before and key in after and _equal(before[key], after[key], within))
    ]


def _leaves(tree: Any, place: str) -> Iterator[tuple[str, object]]:
    if not (isinstance(tree, (dict, list)) and tree):
        yield place, tree
        return
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield from _leaves(value, f"{place}.{key}".lstrip("."))


def _equal(one: object, other: object, within: float) -> bool:
    if type(one) is float and type(other) is float and within:
        return math.isclose(one, other, rel_tol=within, abs_tol=NEAR_ZERO)
    return type(one) is type(other) and one == other


def _simulated(record: Content, work: Path) -> list[str]:
    """Folders of the flights that a reference says how to simulate."""
    recipe = record["provenance"].get("simulated")
    if not recipe:
        return []
    from trexton.simulator import record_flight

    folders = []
    for name in ("train", "test"):
        if name in recipe:
            folders.append(work / "flights" / digest(recipe[name])[:12] / name)
            if not folders[-1].exists():
                record_flight(folders[-1], **recipe[name])
    return [str(folder) for folder in folders]


def _read(path: Path) -> Content:
    """A record's file as it would be written today, its pictures by their hashes."""
    Record.load(path)  # says what is wrong with it
    content: Content = upgraded(json.loads(path.read_text(encoding="utf-8")))
    return content
