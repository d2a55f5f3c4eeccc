"""Make a book: flights, experiments, pages, HTML. Only what changed is made again."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path

import trexton
from trexton.base.cache import code_hashes, repository_root, shipped
from trexton.base.errors import DataError, FlightError, TrextonError
from trexton.base.files import canonical_json, digest, put_in_place, work_folder, write_file
from trexton.base.progress import say
from trexton.companion.build.display import Display, Outcome
from trexton.companion.build.engine import Entries, Fact, Step, build, labelled
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.notebooks import inputs_of
from trexton.companion.build.plan import run_experiments, sole_writer
from trexton.companion.build.postprocessing import finish_book
from trexton.companion.build.prose import findings, records_by_name
from trexton.companion.build.sources import Contents, lead_from_old_addresses, put_outputs, stage
from trexton.flights.folder import read_flight
from trexton.flights.registry import fetch, registry

_BUILDERS = ("jupyter-book", "sphinx", "sphinx-book-theme", "myst-nb", "latex2mathml")

_PATTERNS = ("survey", "waypoints")  # of a training and a test flight
_REAL = "cyberzoo"


@dataclass
class Prepared:
    """Flights that are ready, sentences on what was made or reused, and why one is absent."""

    pairs: list[FlightPair] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)


@dataclass
class Made:
    """What `make_book` did, and what was found, as sentences; outcomes; where the book is."""

    index: Path
    said: list[str] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)
    whole: bool = False  # no flight was absent

    @property
    def failed(self) -> bool:
        return any(outcome.status == "failed" for outcome in self.outcomes)


def make_book(
    *, settings: Mapping[str, object] | None = None, jobs: int | None = None, quick: bool = False
) -> Made:
    """Make the book of this clone: ``book/_build/html/index.html``.

    The authors' flight may be out of reach; the book then says so and goes without it. With `quick`
    it is the first page, one experiment with its player, and its ledger, in ``book/_build/quick``.

    Raises `TrextonError` outside a clone, or where Jupyter Book finds a fault.
    """
    root = repository_root()
    if root is None:
        raise TrextonError(
            "the book belongs to the repository and this is an installed package: "
            "make it in a clone"
        )
    # The notebooks show the paths they were given: relative ones read the same on every machine.
    os.chdir(root)
    say("flights, then notebooks, then pages; what has not changed is reused")
    prepared = prepare_flights(Path("data") / "flights", quick)
    results = Path("results") / "quick" if quick else Path("results")
    html = Path("book") / "_build" / ("quick" if quick else "html")
    toc = "_toc_quick.yml" if quick else "_toc.yml"
    contents = Contents(Path("book"), results, prepared.pairs, (), prepared.absent, toc)
    outcomes = run_experiments(
        prepared.pairs, results, only=contents.named, settings=settings, jobs=jobs
    )
    contents = replace(contents, outcomes=outcomes)
    made = Made(html / "index.html", prepared.said, outcomes=outcomes, whole=not prepared.absent)
    made.said.append(_build(contents, made.index.parent))
    found = findings(results, records_by_name(results, outcomes))
    made.findings += [" ".join(filter(None, (each["text"], each["flight"]))) for each in found]
    return made


def build_small_book(pairs: list[FlightPair], outcomes: list[Outcome], results: Path) -> Path:
    """A book of one run only, in ``<results>/book/html``; returns its index page.

    Raises `TrextonError` where another run writes to `results`, or Jupyter Book finds a fault.
    """
    contents = Contents(shipped("book"), results, pairs, outcomes, toc_file="_toc_small.yml")
    say(_build(contents, results / "book" / "html"))
    return results / "book" / "html" / "index.html"


def _build(contents: Contents, html: Path) -> str:
    """Stage and build, unless the sources are those of the last build; returns a sentence."""
    html.parent.mkdir(parents=True, exist_ok=True)
    stamp = html.parent / ".book.stamp"
    with sole_writer(contents.results), work_folder(html) as work:
        source = work / "source"
        source.mkdir()
        stage(contents, source)
        staged = sorted(filter(Path.is_file, source.rglob("*")))
        key = digest(
            {str(path.relative_to(source)): digest(path) for path in staged},
            code_hashes("trexton.companion.build.make"),
            # The page of the library shows docstrings.
            [digest(path) for path in sorted(Path(trexton.__path__[0]).rglob("*.py"))],
            {name: version(name) for name in _BUILDERS},
        )
        if (html / "index.html").is_file() and stamp.is_file() and stamp.read_text() == key:
            return f"book: reused, none of its pages changed ({html / 'index.html'})"
        stamp.unlink(missing_ok=True)
        built = _jupyter_book(source, work)
        put_outputs(contents, built)
        finish_book(built)
        lead_from_old_addresses(contents, built)
        put_in_place(built, html)
    write_file(stamp, key)
    return f"book: built ({html / 'index.html'})"


def _jupyter_book(source: Path, work: Path) -> Path:
    """Run Jupyter Book with warnings as errors; returns the folder of HTML."""
    say("building the pages")
    program = "import trexton.companion.build; from jupyter_book.cli.main import main; main()"
    command = [sys.executable, "-c", program, "build", str(source), "--path-output", str(work)]
    command += ["--all", "-W", "-n", "--keep-going", "-q"]
    run = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | {"PYTHONWARNINGS": "ignore"}
    )
    built = work / "_build" / "html"
    if run.returncode or not (built / "index.html").is_file():
        lines = [
            line
            for line in (run.stdout + run.stderr).splitlines()
            if "WARNING" in line or "ERROR" in line or "rror:" in line
        ]
        if any(os.strerror(errno.ENOSPC) in line for line in lines):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(work.parent))
        lines = lines or (run.stdout + run.stderr).splitlines()[-20:]
        raise TrextonError(
            "Jupyter Book did not accept the pages:\n"
            + "\n".join(line.replace(f"{source}/", "") for line in lines)
        )
    return built


def prepare_flights(folder: Path, quick: bool = False) -> Prepared:
    """Make sure that the simulated pair and, if it can be had, the real flight are in `folder`.

    With `quick` the real flight alone, which needs no simulation, unless it cannot be had.

    Raises `TrextonError` where a flight could not be made, but not where it cannot be fetched.
    """
    simulated, real, prepared = [folder / f"sim-{p}" for p in _PATTERNS], folder / _REAL, Prepared()

    def fetch_real() -> None:
        try:
            fetch(_REAL, real, replace=True)
        except DataError as error:
            prepared.absent[_REAL] = str(error)
            raise

    code = labelled("module", code_hashes("trexton.companion.public_flights"))
    raw = {file["key"]: canonical_json(file) for file in registry()[_REAL]["files"]}
    files = labelled("file", raw)
    _make([_step(real, code | files, fetch_real)], folder, prepared)
    if not (quick and not prepared.absent):
        room = code_hashes("trexton.simulator.recording")
        steps = [
            _step(path, inputs_of({"pattern": each}, room, {}), partial(_simulate, path, each))
            for path, each in zip(simulated, _PATTERNS, strict=True)
        ]
        _make(steps, folder, prepared)
        prepared.pairs.append(FlightPair(*map(str, simulated)))
    if not prepared.absent:
        prepared.pairs.append(FlightPair(str(real)))
    return prepared


def _step(path: Path, inputs: Entries, make: Callable[[], object]) -> Step:
    """The step that makes the flight at `path`, unless it is whole and of the same inputs."""

    def read() -> Entries | None:
        try:
            return {path.name: read_flight(path).data_hash}
        except (OSError, ValueError, FlightError):
            return None

    return Step(path.name, inputs, make, [Fact(f"flight {path.name}", read)])


def _simulate(path: Path, pattern: str) -> None:
    from trexton.simulator.recording import record_flight

    say(f"simulating {path}")
    record_flight(path, pattern=pattern, replace=True)


def _make(steps: list[Step], folder: Path, prepared: Prepared) -> None:
    """Bring flights up to date, and note what became of each."""
    outcomes = build(steps, folder / ".engine", 1, lambda: None, Display())
    for name in (step.name for step in steps):
        one = outcomes[name]
        if name in prepared.absent:
            why = f"absent, the book goes without it: {prepared.absent[name]}"
        elif not one.good:
            raise TrextonError(one.reasons[0])
        else:
            why = one.status if one.status == "reused" else f"made, because {one.reasons[0]}"
        prepared.said.append(f"flight {name}: {why}")
