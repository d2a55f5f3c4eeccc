"""What experiments run on: a flight to train on and one to test on, or two splits of one.

`FlightPair` holds their folders, `load_pair` reads both, `with_splits` divides a flight that has no
splits of its own; `given` reads what a notebook was given.
"""

from __future__ import annotations

import re
import reprlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.cache import repository_root
from trexton.base.errors import FlightError, ParameterError
from trexton.base.files import check_writable
from trexton.base.options import Options
from trexton.base.progress import say
from trexton.companion.experiments.declaration import NEEDS, Experiment
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.flights.frames import ImageFiles
from trexton.localization.alike import check_kind, fingerprints

_SHARE = 0.6  # of the positions of a flight without splits is for training
_HELD_BYTES = 2**29  # of images of a test flight that stay in memory


def check_out(out: Path, pairs: Sequence[FlightPair]) -> None:
    """Refuse results of two flights in one folder, or among the files of a flight: ``--out
    FLIGHT``, or ``--out .`` beside it.

    Raises
    ------
    ParameterError
        A name comes twice, or is that of something that lies beside them; they would lie there.
        The folder is a file, or may not be written to.
    """
    check_writable(out / "report.html")
    names = [pair.name for pair in pairs]
    if ours := [name for name in names if name in ("book", "report.html")]:
        raise ParameterError(f"a flight is named {ours[0]!r}, as a result is: name it otherwise")
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise ParameterError(
            f"two flights are named {twice[0]!r}: give each its own name in flight.toml"
        )
    for pair in pairs:
        for flight in filter(None, (pair.flight, pair.test_flight)):
            if Path(flight).resolve() in (out.resolve(), (out / pair.name).resolve()):
                raise ParameterError(
                    f"{out}: results would lie among the files of the flight {flight}: name "
                    "another folder with --out"
                )


@dataclass(frozen=True)
class FlightPair:
    """Two Flight folders, or one by its splits; paths as notebooks will see them."""

    flight: str
    test_flight: str | None = None

    @cached_property
    def train(self) -> Flight:
        flight = read_flight(self.flight)
        if self.test_flight is None:
            own, flight = flight.split, with_splits(flight)
            if flight.split != own:
                first, last = flight.split["train"]
                say(
                    f"{self.flight} has no splits train and test: frames {first} to {last} train, "
                    f"the later ones test, {len(flight)} in all"
                )
        if not re.fullmatch(r"\w[\w .+-]{0,79}", flight.name):  # longer ones no disk takes
            raise FlightError(
                f"{self.flight}: the name {reprlib.repr(flight.name)} cannot name a folder of "
                "results: use at most 80 letters, digits, - and _"
            )
        return flight

    @cached_property
    def test(self) -> Flight:
        return self.train if self.test_flight is None else read_flight(self.test_flight)

    @property
    def name(self) -> str:
        """The name of the training flight, which names the folder of results too."""
        return self.train.name

    @cached_property
    def hashes(self) -> dict[str, str]:
        """Hash of all data, by role."""
        both = {"train": self.train.data_hash}
        return both if self.test_flight is None else both | {"test": self.test.data_hash}

    def obstacle(self, experiment: Experiment) -> str | None:
        """Why the flights cannot serve the experiment; None if they can."""
        for need in experiment.needs:
            for flight in (self.train, self.test):
                if not NEEDS[need].has(flight):
                    return f"{flight.name} {NEEDS[need].lacking}"
        return None


class _Held(ImageFiles):
    """Images that one method after another is flown over: decoded once, where they have room."""

    def __getitem__(self, row: int) -> np.ndarray:
        held: dict[int, np.ndarray] = self.__dict__.setdefault("held", {})
        if row in held:
            return held[row].copy()  # what one method does to its frame, no other sees
        image = super().__getitem__(row)
        if len(self) * image.nbytes <= _HELD_BYTES:
            held[row] = image.copy()
        return image

    def at(self, rows: np.ndarray) -> ImageFiles:
        return ImageFiles(self.files).at(rows)

    def __reduce__(self) -> Any:  # other processes read their own
        return type(self), (self.files,)


def load_pair(flight: str | Path, test_flight: str | Path | None) -> tuple[Flight, Flight]:
    """The training and the test flight.

    Parameters
    ----------
    flight, test_flight : path
        Of two flights their splits ``train`` and ``test`` where they have them, else all frames; of
        one flight (`test_flight` None) its two splits (`with_splits`).

    Raises
    ------
    FlightError
        A folder is no flight, fewer than three frames of the test have a position, most are frames
        of the training, or images or features are of another kind.
    """
    first = read_flight(flight)
    if test_flight is None:
        first = with_splits(first)
        train, test = first.part("train"), first.part("test")
    else:
        train = first.part_or_all("train")
        test = read_flight(test_flight).part_or_all("test")
        # The same places may be visited again, where other values are sensed.
        for known, came in zip(_marks(train), _marks(test), strict=False):
            if (shared := len(known & came)) > len(came) / 2:
                found = f"{shared} frames of flight {test.name!r} are those it would be trained on"
                raise FlightError(f"{found}, which proves nothing: give another flight to test on")
        _check_places(train, test)
    located = int(test.located.sum())
    if located < 3:
        found = f"flight {test.name!r} has {located} frames with a position to test on"
        raise FlightError(f"{found}: a test needs at least 3")
    if type(test.frames) is ImageFiles:
        test = replace(test, frames=_Held(test.frames.files))
    if train.has_images == test.has_images:
        check_kind(test, train)
    return train, test


def _marks(flight: Flight) -> list[set[bytes]]:
    """What a copy of a flight has too: places with values, and pictures."""
    files = flight.frames.files if type(flight.frames) is ImageFiles else ()
    pictures = {sha256(file.read_bytes()).digest() for file in files}
    return [fingerprints(flight.position, flight.histograms), pictures]


def _check_places(train: Flight, test: Flight) -> None:
    low, high = np.reshape(train.area, (2, 2)).T
    most = train.diagonal / 4
    beside = (test.position < low - most) | (test.position > high + most)
    if (count := int(beside.any(axis=1).sum())) > test.located.sum() / 2:
        found = f"{count} positions of {test.name!r} lie far beside the area of {train.name!r}"
        raise FlightError(f"{found}: give them from the same origin, in metres")


def with_splits(flight: Flight) -> Flight:
    """The flight with splits ``train`` and ``test``: its own if it has both.

    Otherwise training ends with the frame that has three fifths of the positions behind it, and the
    test is what follows.
    """
    if {"train", "test"} <= set(flight.split) or len(flight) < 2:
        return flight
    located = np.flatnonzero(flight.located)
    rows = located if len(located) > 1 else np.arange(len(flight))
    last = int(rows[min(max(1, round(_SHARE * len(rows))), len(rows) - 1) - 1])
    first, last, then, end = flight.frame[[0, last, last + 1, -1]].tolist()
    return replace(flight, split={"train": (first, last), "test": (then, end)})


def _resolve(path: str) -> Path:
    """`path` from here or, for a notebook opened in its own folder, from the top of the clone."""
    here, root = Path(path), repository_root()
    return root / path if root and not here.exists() and (root / path).exists() else here


@dataclass(frozen=True)
class Given:
    """What a notebook was given: flights, folder of results, and the experiment's parameters."""

    flight: str
    test_flight: str | None
    out: str
    parameters: Any

    @cached_property
    def _pair(self) -> tuple[Flight, Flight]:
        test_flight = None if self.test_flight is None else _resolve(self.test_flight)
        return load_pair(_resolve(self.flight), test_flight)

    @property
    def train(self) -> Flight:
        """The training flight: the first folder, of it the split ``train`` where there is one."""
        return self._pair[0]

    @property
    def test(self) -> Flight:
        """The test flight: the second folder, or the split ``test`` of the first."""
        return self._pair[1]


def given(parameters: type[Options], names: Mapping[str, object]) -> Given:
    """Read flights, folder and parameters from the `names` of a notebook (its ``globals()``).

    A parameter that the notebook does not name has its default, which stands in the class alone.

    Raises `ParameterError` where a value does not fit, or a name is nearly that of a parameter.
    """
    mine = ("flight", "test_flight", "out")
    declared = {each.name for each in parameters.declared()}.union(mine)
    for name, value in names.items():
        near = get_close_matches(name, declared - names.keys(), n=1, cutoff=0.75)
        if near and name not in declared and isinstance(value, (int, float, str)):
            raise ParameterError(
                f"the notebook sets {name} = {value!r}, which is no parameter: write {near[0]}, or "
                "give what is your own a name less like it"
            )
    chosen = {each.name: names[each.name] for each in parameters.declared() if each.name in names}
    flight, test_flight, out = (names.get(name) for name in mine)
    second = None if test_flight is None else str(test_flight)
    return Given(str(flight), second, str(out), parameters(**chosen))
