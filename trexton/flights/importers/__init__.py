"""Flights from the formats that people have: a module or a class each, and one line here.

It declares its options (`Settings`, a dataclass of `trexton.base.options`), says whether a source
looks like its own (``recognises(path)``) and reads it (``read(path, settings) -> Recording``).
Command line, checks and the table in the documentation are made from these.
"""

from pathlib import Path
from typing import Any, Protocol, cast

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.base.plugins import addresses, resolve
from trexton.flights.importers.recording import Recording
from trexton.flights.tables import read_table

IMPORTERS = {
    "euroc": "trexton.flights.importers.listed:Euroc",
    "tum": "trexton.flights.importers.listed:Tum",
    "video": "trexton.flights.importers.video",
    "bag": "trexton.flights.importers.bag",
    "photos": "trexton.flights.importers.photos",
    "csv": "trexton.flights.importers.listed:Table",
    "features": "trexton.flights.importers.listed:Features",
    "signals": "trexton.flights.importers.signals",
}


class Importer(Protocol):
    """What an importer offers; the first sentence of its docstring describes it."""

    Settings: type[Options]

    def recognises(self, source: Path) -> bool:
        """Whether the source looks like this format."""

    def read(self, source: Path, settings: Any) -> Recording:
        """The recording at `source`; raises `FlightError` where it is none."""


def importer(kind: str) -> Importer:
    """The importer called `kind`: of `IMPORTERS`, an entry point in the group
    ``trexton.importers``, or ``package.module`` of one's own; raises `ParameterError` for others.
    """
    own = {kind: kind} if "." in kind else {}
    return cast(Importer, resolve("importers", kind, IMPORTERS | own))


def guess_kind(source: Path) -> str:
    """The one kind that recognises `source`; raises `ParameterError` where none or several do,
    `FlightError` where it is a table that cannot be read.
    """
    if not source.exists():
        raise ParameterError(f"{source}: no such file or folder")
    kinds = addresses("importers", IMPORTERS)
    fitting = [kind for kind in kinds if importer(kind).recognises(source)]
    fitting = [kind for kind in fitting if kind != "photos"] or fitting  # lists may lie beside them
    if len(fitting) == 1:
        return fitting[0]
    found = f"looks like {' and '.join(fitting)}" if fitting else "is of no kind that is recognised"
    if not fitting and source.suffix.lower() in (".csv", ".tsv"):
        found = f"has the columns {', '.join(read_table(source).header)} (others by --x, --image)"
    raise ParameterError(f"{source} {found}: name the kind, one of {', '.join(IMPORTERS)}")
