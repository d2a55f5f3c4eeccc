"""Are the results still the same? A record's experiment runs again, with an empty cache.

Numbers may be apart by what BLAS kernels of another processor round otherwise: 1e-9, 1e-6 where a
method multiplies in single precision. What changed is named, with the versions that moved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file, canonical_json, digest
from trexton.base.records import Record, read_content, software_versions
from trexton.companion.build.flight_pairs import load_pair
from trexton.companion.executor import environment
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.provenance import kept_results

__all__ = ["Verdict", "references", "update", "verify"]

RELATIVE, NEAR_ZERO = 1e-9, 1e-12  # of numbers that are not whole
SINGLE = {"kidnapping": 1e-6}  # instead, where a method multiplies in single precision
RESULTS = ("values", "series", "images")

Content = dict[str, Any]


@dataclass(frozen=True)
class Verdict:
    """What came of the record at `path`: its changes, the versions that moved since it was made,
    and what it is now, as its file has it.
    """

    path: Path
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
    path: Path, work: Path, flight: str | None = None, test_flight: str | None = None
) -> Verdict:
    """Run the experiment of the record at `path` again, and compare.

    Parameters
    ----------
    path, work : Path
        The record, and a folder for caches, flights and results, which several records may share.
    flight, test_flight : str, optional
        Folders of its flights; needed where the record does not say how they are simulated.

    Raises
    ------
    TrextonError
        The record cannot be read, its flights are missing, or its experiment is unknown or reads
        the records of all flights.
    """
    record = _read(path)
    given = [str(each) for each in (flight, test_flight) if each]
    flights = given or _simulated(record, work)
    if not flights:
        raise TrextonError(
            f"{path}: was made of {', '.join(record['provenance'].get('flights', {})) or 'flights'}"
            ": name their folders with --flight and --test-flight"
        )
    name = record["experiment"]
    if name not in EXPERIMENTS or EXPERIMENTS[name].every_flight:
        raise TrextonError(f"{path}: {name!r} is no experiment on flights: choose another record")
    own = work / path.stem
    with environment({"TREXTON_CACHE": str(own / "cache")}):
        rebuilt = rebuild(name, record["parameters"], flights, own / "results")
    within = SINGLE.get(record["experiment"], RELATIVE)
    changes = [
        line
        for section in RESULTS
        if record.get(section)
        for line in differences(record[section], rebuilt[section], section, within)
    ]
    then = record["provenance"]
    # The last bits of what is simulated here are this processor's; values tell more than they do.
    if given:
        now = rebuilt["provenance"]["flights"]
        changes += differences(then.get("flights", {}), now, "data of flight")
    versions = differences(then.get("versions", {}), software_versions())
    return Verdict(path, changes, versions, rebuilt)


def rebuild(name: str, parameters: Content, flights: list[str], out: Path) -> Content:
    """A record of this experiment, as its file in `out` has it."""
    experiment = EXPERIMENTS[name]
    train, test = load_pair(flights[0], flights[1] if len(flights) > 1 else None)
    assert experiment.run is not None
    return _read(
        experiment.run(train, test, experiment.parameters.parse(parameters, name)).save(out)
    )


def update(verdict: Verdict) -> None:
    """Write what came out as the new reference values; raises `TrextonError` where the record is
    the result of a run and no reference.
    """
    record = _read(verdict.path)
    if "simulated" not in record["provenance"]:
        raise TrextonError(
            f"{verdict.path}: is the result of a run, not a reference: "
            "run its experiment again with trexton run"
        )
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
    other.
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
    if type(one) is float and type(other) is float:
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
    content: Content = read_content(path)
    return content
