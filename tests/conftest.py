"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from painted_once import painted_once

from trexton.base import plugins
from trexton.base.progress import set_quiet
from trexton.base.records import Record
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.flights.registry import registry
from trexton.flights.writing import write_flight

ROOT = Path(__file__).resolve().parent.parent


def _shared_data() -> Path | None:
    named = os.environ.get("TREXTON_DATA")
    candidates = ([Path(named)] if named else []) + [ROOT.parent / "shared" / "data"]
    return next((folder for folder in candidates if (folder / "cyberzoo").is_dir()), None)


UNNEEDED = ROOT / "tests" / "unneeded"  # hides what costs every process seconds, unused


def python_path(*folders: Path) -> str:
    """PYTHONPATH of a process that a test begins: these folders, then those of the tests' own."""
    own = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    return os.pathsep.join(dict.fromkeys(map(str, [*folders, UNNEEDED, *own])))


os.environ["PYTHONPATH"] = python_path()
if found := _shared_data():  # as make test says it: pytest by hand runs the same
    os.environ["TREXTON_DATA"] = str(found)


# Files that take longest, the longest first (`--durations`): begun last, one of them would run on
# where all else is done.
LONG = [
    "test_contributing.py", "test_cluster.py", "test_workflow.py", "test_closed_loop.py",
    "test_appearance.py", "test_installed.py", "test_floors.py", "test_sweep.py", "test_book.py",
    "test_mosaic.py", "test_filter.py", "test_aerial.py", "test_preflight.py", "test_prose.py",
]  # fmt: skip


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is imported and collected lives to the end: no need to look for garbage in it."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The long files come first, in whatever order they were shuffled."""
    place = {name: number for number, name in enumerate(LONG)}
    items.sort(key=lambda item: place.get(item.path.name, len(LONG)))


@pytest.fixture(scope="session", autouse=True)
def _painted(tmp_path_factory):
    """Floors are painted once a run, in one place for all its processes."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    (folder / "floors").mkdir(exist_ok=True)
    with painted_once(folder / "floors"):
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """A local copy of the public data, laid out as the registry names them."""
    folder = _shared_data()
    if folder is None:
        pytest.skip(
            "the authors' data are not here: set TREXTON_DATA to a folder with cyberzoo/ in it"
        )
    return folder


@pytest.fixture(scope="session")
def cyberzoo(shared_data) -> Flight:
    """The authors' real flight."""
    from trexton.companion.public_flights import read_cyberzoo

    return read_cyberzoo(*(shared_data / file["key"] for file in registry()["cyberzoo"]["files"]))


@pytest.fixture(autouse=True)
def _audible():
    """Commands run in this process with --quiet silence only their own test."""
    yield
    set_quiet(False)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs a module, as pip would, by what it is found by: a line of ``entry_points.txt``."""
    names = []

    def install(name: str, source: str, group: str, entry: str) -> Path:
        (tmp_path / f"{name}.py").write_text(source)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[trexton.{group}]\n{entry}\n")
        monkeypatch.syspath_prepend(str(tmp_path))
        plugins._installed.cache_clear()
        names.append(name)
        return tmp_path

    yield install
    plugins._installed.cache_clear()
    for name in names:
        sys.modules.pop(name, None)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20160620)


def small_flight(frames: int = 40, textons: int = 4, name: str = "small") -> Flight:
    """A flight with histograms only, on a circle of one metre."""
    angle = np.linspace(0, 2 * np.pi, frames, endpoint=False)
    rng = np.random.default_rng(7)
    return Flight(
        name=name,
        frame=np.arange(1, frames + 1),
        time=np.arange(frames) * 0.08,
        position=np.column_stack([np.cos(angle), np.sin(angle)]),
        area=(-1.0, 1.0, -1.0, 1.0),
        histograms=rng.dirichlet(np.ones(textons), frames),
        split={"train": (1, frames // 2), "test": (frames // 2 + 1, frames)},
    )


@pytest.fixture(scope="session")
def field():
    """A field that has learned the small survey; the one it flies with is `motion`."""
    from small_survey import training

    from trexton.field.field import Field

    return Field().fit(training())


@pytest.fixture(scope="session")
def motion():
    """What the small survey says of how its vehicle moves."""
    from small_survey import training

    from trexton.field.linear_motion import Singer

    return Singer().fit(training())


@pytest.fixture(scope="session")
def later():
    """Places of a later flight over the small survey, and what was seen there."""
    from small_survey import look, path

    places, _ = path(120, start=51.3)
    return places, look(places, np.random.default_rng(9))


@pytest.fixture
def flight_folder(tmp_path) -> Path:
    """`small_flight` on disk."""
    return write_flight(small_flight(), tmp_path / "small")


@pytest.fixture
def image_folder(tmp_path) -> Path:
    """Six frames with images of 32x24 pixels, on disk."""
    import cv2

    images = tmp_path / "images"
    images.mkdir()
    rng = np.random.default_rng(8)
    files = tuple(images / f"{number:04d}.jpg" for number in range(6))
    for file in files:
        cv2.imwrite(str(file), rng.integers(0, 256, (24, 32, 3), dtype=np.uint8))
    line = np.linspace(0, 1, 6)
    flight = Flight(
        name="pictures",
        frame=np.arange(6),
        time=np.arange(6) * 0.08,
        position=np.column_stack([line, -line]),
        area=(0.0, 1.0, -1.0, 0.0),
        frames=ImageFiles(tuple(files)),
    )
    return write_flight(flight, tmp_path / "pictures")


def mocap_record(flight: str, value: float) -> Record:
    """A record of mocap_training with everything that claims read, each entry the same value."""
    names = ("axis_mean_cm", "p95_cm", "error_cm_x", "error_cm_y", "std_cm_x", "std_cm_y")
    values = {
        "filter": dict.fromkeys((*names, "axis_std_cm"), value),
        "knn": {"p95_cm": value},
        "drift_cm_per_min": value,
        "model": {"first_rank_std_cm": value, "last_rank_std_cm": value},
        "spread": {"within_two": value},
    }
    return Record("mocap_training", flight, {}, values)
