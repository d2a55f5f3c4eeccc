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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trexton.base.cache import kept_results
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file, canonical_json, digest
from trexton.base.progress import progress
from trexton.base.records import software_versions, upgraded
from trexton.companion.executor import THREAD_VARIABLES
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights.splits import load_pair

__all__ = [
    "QUICK", "VARIANTS", "ProcessVariant", "Verdict", "differences", "moved", "precision",
    "rebuild", "references", "update", "verify",
]  # fmt: skip

RELATIVE, NEAR_ZERO = 1e-9, 1e-12  # of numbers that are not whole
SINGLE = {"kidnapping": 1e-6}  # instead, where a method multiplies in single precision
RESULTS = ("values", "series", "images")
_PROGRAM = "from trexton.companion.checks.verify import rebuild; rebuild(*sys.argv[1:])"

Content = dict[str, Any]


@dataclass(frozen=True)
class ProcessVariant:
    """What is different in one process.

    Attributes
    ----------
    name, hash_seed : str
    threads : int
    warm : bool
        With the cache that the first process left.
    blas : str
        Kernels that OpenBLAS shall take; empty: those of this processor.
    """

    name: str
    hash_seed: str = "0"
    threads: int = 1
    warm: bool = False
    blas: str = ""

    @property
    def exact(self) -> bool:
        """The last bit must be the same: kernels with and without fused products round apart."""
        return not self.blas

    def environment(self, cache: Path) -> dict[str, str]:
        """Of the process."""
        chosen = dict.fromkeys(THREAD_VARIABLES, str(self.threads))
        chosen |= {"PYTHONHASHSEED": self.hash_seed, "TREXTON_CACHE": str(cache)}
        return dict(os.environ) | chosen | ({"OPENBLAS_CORETYPE": self.blas} if self.blas else {})


VARIANTS = (
    ProcessVariant("one thread, cold cache"),
    ProcessVariant("another hash seed, two threads", hash_seed="1", threads=2),
    ProcessVariant("warm cache", warm=True),
    ProcessVariant("BLAS kernels of Haswell", blas="Haswell"),
    ProcessVariant("BLAS kernels of Nehalem", blas="Nehalem"),  # without fused products
)
# As far from the process that made the references as the bits allow.
QUICK = (VARIANTS[1],)


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

    @property
    def holds(self) -> bool:
        """All processes agree, with the record too."""
        return not self.disagreements and not self.changes


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
    variants: tuple[ProcessVariant, ...] = VARIANTS,
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
    results = []
    for number, variant in enumerate(progress(variants, "processes", len(variants))):
        cache = work / f"cache-{0 if variant.warm else number}"
        results.append(_run(variant, path, cache, work / f"results-{number}", flights))
    first, *others = results
    within = precision(record)
    disagreements = [
        f"{variant.name}: {line}"
        for variant, other in zip(variants[1:], others, strict=True)
        if canonical_json(other) != canonical_json(first)
        for line in differences(first, other, within=0 if variant.exact else within)
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
        changes += differences(then.get("flights", {}), now["flights"], "data of flight ")
    versions = moved(then.get("versions", {}), software_versions())
    return Verdict(path, disagreements, changes, versions, first)


def _run(
    variant: ProcessVariant, path: Path, cache: Path, out: Path, flights: list[str]
) -> Content:  # without what the clock says
    command = [sys.executable, "-c", f"import sys; {_PROGRAM}", str(path), str(out)]
    done = subprocess.run(
        [*command, *flights],
        env=variant.environment(cache),
        capture_output=True,
        text=True,
        errors="replace",
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise TrextonError(f"{path}: its experiment failed with {variant.name}: {last}")
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


def precision(record: Content) -> float:
    """How far numbers of a record may relatively be apart, the kernels of the BLAS being others."""
    return SINGLE.get(record["experiment"], RELATIVE)


def differences(
    expected: object, actual: object, place: str = "", within: float = RELATIVE
) -> list[str]:
    """Lines that name each entry of nested values that is not as expected.

    Whole numbers, words and truth values must be equal; other numbers `within` a share of each
    other, or, for 0, to the last bit.
    """
    if isinstance(expected, dict) and isinstance(actual, dict):
        keys = sorted(expected.keys() | actual.keys())
        pairs = [(key, expected.get(key, _ABSENT), actual.get(key, _ABSENT)) for key in keys]
    elif isinstance(expected, list) and isinstance(actual, list) and len(expected) == len(actual):
        pairs = [(str(row), *both) for row, both in enumerate(zip(expected, actual, strict=True))]
    elif _equal(expected, actual, within):
        return []
    else:
        return [f"{place}: {_shown(expected)} -> {_shown(actual)}"]
    joint = "." if place and not place.endswith(" ") else ""
    return [
        line
        for key, one, other in pairs
        for line in differences(one, other, f"{place}{joint}{key}", within)
    ]


_ABSENT = object()


def _equal(one: object, other: object, within: float) -> bool:
    if type(one) is float and type(other) is float and within:
        return math.isclose(one, other, rel_tol=within, abs_tol=NEAR_ZERO)
    return type(one) is type(other) and one == other


def _shown(value: object) -> str:
    if value is _ABSENT:
        return "absent"
    if isinstance(value, list):
        return f"{len(value)} entries"
    return repr(value)


def moved(then: dict[str, str], now: dict[str, str]) -> list[str]:
    """Versions that are not what they were, as ``numpy 2.4.5 -> 2.4.6``."""
    return [
        f"{name} {then.get(name, 'absent')} -> {now.get(name, 'absent')}"
        for name in sorted(then.keys() | now.keys())
        if then.get(name) != now.get(name)
    ]


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
    try:
        content: Content = upgraded(json.loads(path.read_text(encoding="utf-8")))
        if not all(
            isinstance(content[key], dict) for key in ("parameters", "provenance", *RESULTS)
        ):
            raise ValueError("sections are missing")
        str(content["experiment"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise TrextonError(f"{path}: not a readable record ({error}): name another") from None
    return content
