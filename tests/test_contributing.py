"""CONTRIBUTING.md, carried out exactly as printed, in a copy of the package."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, python_path

from trexton.flights.flight import Flight
from trexton.flights.writing import write_flight

SECTION = re.compile(r"^## (?P<title>.+?)\n(?P<body>.*?)(?=^## |\Z)", re.S | re.M)
FILE = re.compile(r"`(?P<path>trexton/[\w/]+\.py)`:\n\n```python\n(?P<code>.*?)```", re.S)
LINE = re.compile(
    r"One line in `(?P<path>[^`]+)`, under `(?P<anchor>[^`]+)`:\n\n```\w+\n(?P<line>[^\n]+)\n```"
)
NOTEBOOK = re.compile(r"`(?P<path>notebooks/\w+\.md)`:\n\n````markdown\n(?P<text>.*?)````", re.S)
SECTIONS = {
    found["title"]: found["body"]
    for found in SECTION.finditer((ROOT / "CONTRIBUTING.md").read_text())
}


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> Path:
    """A flight of histograms that follow the place, with splits."""
    rng = np.random.default_rng(1)
    angle = np.linspace(0, 8 * np.pi, 120)
    place = np.column_stack([np.cos(angle), np.sin(1.3 * angle)])
    values = np.exp(-((place[:, None] - rng.uniform(-1, 1, (8, 2))) ** 2).sum(axis=2)) + 0.05
    recorded = Flight(
        "loop",
        np.arange(120),
        np.arange(120) * 0.08,
        place,
        (-1.1, 1.1, -1.1, 1.1),
        histograms=values / values.sum(axis=1, keepdims=True),
        split={"train": (0, 69), "test": (70, 119)},
    )
    return write_flight(recorded, tmp_path_factory.mktemp("flights") / "loop")


def test_there_are_the_five_that_are_promised():
    assert list(SECTIONS) == [
        "A motion model",
        "A histogram distance",
        "A sink",
        "A flight importer",
        "An experiment",
    ]


def add(body: str, folder: Path) -> None:
    """Follow a section: its file, its notebook if it has one, its lines."""
    (file,), lines = FILE.findall(body), LINE.findall(body)
    assert len(file[1].splitlines()) <= 60
    (folder / file[0]).write_text(file[1])
    for path, text in NOTEBOOK.findall(body):
        (folder / path).write_text(text)
    assert lines
    for path, under, line in lines:
        before, anchor, after = (folder / path).read_text().partition(under + "\n")
        assert anchor, f"{under!r} is not in {path}"
        (folder / path).write_text(f"{before}{anchor}{line}\n{after}")


@pytest.mark.parametrize("title", SECTIONS)
def test_it_is_done_as_printed(title, tmp_path, flight):
    body = SECTIONS[title]
    # What is compiled comes along: it is as old and as long as what it was compiled from.
    ignored = shutil.ignore_patterns("*.pyc.*", "*.tmp.*")
    shutil.copytree(ROOT / "trexton", tmp_path / "trexton", ignore=ignored)
    for name in ("notebooks", "data/paper"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignored)
    (tmp_path / "book").mkdir()
    for name in ("pyproject.toml", "codecheck.yml", "book/_toc.yml"):
        shutil.copy(ROOT / name, tmp_path / name)
    add(body, tmp_path)
    work = tmp_path / "work"
    work.mkdir()
    write_recording(work / "recording.npz")
    for command in re.search(r"```bash\n(.*?)```", body, re.S)[1].splitlines():
        words = shlex.split(command.replace("FLIGHT", str(flight)))
        run = subprocess.run(
            [sys.executable, "-m", "trexton", *words[1:]],
            cwd=work,
            capture_output=True,
            text=True,
            timeout=300,
            env=os.environ
            | {"PYTHONPATH": python_path(tmp_path), "TREXTON_CACHE": str(tmp_path / "cache")},
        )
        assert run.returncode == 0, f"{command}\n{run.stdout}\n{run.stderr}"
    check(title, work)


def write_recording(path: Path) -> None:
    rng = np.random.default_rng(2)
    histograms = rng.dirichlet(np.ones(5), 30)
    np.savez(
        path,
        time_s=np.arange(30) * 0.1,
        position_m=rng.uniform(0, 2, (30, 2)),
        histograms=histograms,
    )


def check(title: str, work: Path) -> None:
    """What the commands must have left."""
    if title == "A motion model":
        assert len((work / "fixes.csv").read_text().splitlines()) == 6
    elif title == "A histogram distance":
        assert (work / "map.npz").stat().st_size > 1000
    elif title == "A sink":
        lines = (work / "fixes.txt").read_text().splitlines()
        assert len(lines) == 5 and all(re.fullmatch(r"-?\d+ -?\d+ cm", line) for line in lines)
    elif title == "A flight importer":
        assert (work / "imported" / "histograms.csv").is_file()
    else:
        results = work / "results" / "loop"
        names = {path.name for path in results.iterdir()}
        assert {"stillness.json", "stillness.ipynb", "stillness-steps.svg"} <= names
        assert "A frame looks like the one before" in (results / "stillness.ipynb").read_text()


# What is new, and the tables that name it: of all else the types are as they were.
TYPED = [
    path
    for body in SECTIONS.values()
    for path in (FILE.search(body)["path"], LINE.search(body)["path"])
    if path.endswith(".py")
]
# Of all pages only that of the experiment is new.
NEW_PAGES = " or ".join(
    Path(path).stem for body in SECTIONS.values() for path, _ in NOTEBOOK.findall(body)
)
# What the suite itself asks of whatever is added: formats, types, directions, tables, prose.
CHECKS = [
    ["-m", "ruff", "format", "--check", "."],
    ["-m", "ruff", "check", "."],
    ["-m", "mypy", *sorted(set(TYPED))],
    ["-c", "from importlinter.cli import lint_imports_command as run; run()"],
    ["-m", "vulture"],
    [
        "-m", "pytest", "-q", "-p", "no:randomly", "-m", "not slow", "tests/test_prose.py",
        "tests/base/test_options.py", "tests/localization/test_methods.py",
        "tests/onboard/test_edges.py", "tests/companion/experiments/test_findings.py",
        "tests/companion/claims", "tests/companion/build/test_book_prose.py",
        "tests/companion/build/test_book.py::test_every_experiment_stands_on_one_page_of_thirty",
        "tests/test_release.py::test_the_manifest_names_what_experiments_leave",
        "-k", f"not test_python_runs_as_printed or {NEW_PAGES}",
    ],
]  # fmt: skip


def test_all_of_them_leave_the_checks_and_the_suite_green(tmp_path):
    names = subprocess.run(
        ["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, text=True, check=True
    ).stdout
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tmp_path / name)
    compiled = (
        file for part in ("trexton", "tests") for file in (ROOT / part).rglob("__pycache__/*")
    )
    for file in compiled:  # as old and as long as its source
        if file.suffix in (".pyc", ".nbi", ".nbc"):
            place = tmp_path / file.relative_to(ROOT)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(file, place)
    if (ROOT / ".mypy_cache").is_dir():
        shutil.copytree(ROOT / ".mypy_cache", tmp_path / ".mypy_cache")
    for body in SECTIONS.values():
        add(body, tmp_path)
    own = {"PYTHONPATH": python_path(tmp_path), "TREXTON_CACHE": str(tmp_path / "c")}
    for words in CHECKS:
        done = subprocess.run(
            [sys.executable, *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            env=os.environ | own,
        )
        assert done.returncode == 0, f"{words}\n{done.stdout[-4000:]}\n{done.stderr[-2000:]}"
