"""Installed from the wheel, in an empty folder without the repository: one runs a flight."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, UNNEEDED
from small_recording import recording


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from a copy, so that no build folder is left in the repository."""
    folder = tmp_path_factory.mktemp("wheel")
    tracked = subprocess.run(
        ["git", "-C", ROOT, "ls-files", "-z"], capture_output=True, text=True, check=True
    ).stdout
    for name in filter(None, tracked.split("\0")):
        if (ROOT / name).is_file():
            (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "source" / name).write_bytes((ROOT / name).read_bytes())
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--quiet"]
    subprocess.run([*build, "--wheel-dir", folder, folder / "source"], check=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def trexton(wheel, tmp_path_factory):
    """Calls the command of a fresh environment, which borrows what trexton stands on."""
    place = tmp_path_factory.mktemp("environment")
    venv.create(place, symlinks=True)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site = place / "lib" / version / "site-packages"
    (site / "borrowed.pth").write_text(sysconfig.get_paths()["purelib"])
    install = ["install", "--no-deps", "--no-index", "--no-compile", "--quiet", wheel]
    pip = [sys.executable, "-m", "pip", "--python", place / "bin" / "python"]
    subprocess.run([*pip, *install], check=True)
    for source in (ROOT / "trexton").rglob("*.py"):  # as old as here: what is compiled fits
        installed = site / source.relative_to(ROOT)
        assert installed.read_bytes() == source.read_bytes()
        os.utime(installed, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
    for compiled in (ROOT / "trexton").rglob("__pycache__/*"):
        if compiled.suffix in (".pyc", ".nbi", ".nbc"):
            copied = site / compiled.relative_to(ROOT)
            copied.parent.mkdir(exist_ok=True)
            shutil.copy2(compiled, copied)
    environment = {k: v for k, v in os.environ.items() if k != "TREXTON_CACHE"}
    environment["PYTHONPATH"] = str(UNNEEDED)  # and nothing of the repository

    def call(*words: object, folder: Path) -> str:
        done = subprocess.run(
            [place / "bin" / "trexton", *map(str, words)], cwd=folder, text=True,
            env=environment | {"HOME": str(folder)}, capture_output=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        return done.stdout

    return call


def test_the_wheel_carries_notebooks_and_numbers_but_no_results(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    shipped = [name for name in names if name.startswith("trexton/_shipped/")]
    for path in (ROOT / "notebooks").glob("*.md"):
        assert f"trexton/_shipped/notebooks/{path.name}" in shipped
    assert "trexton/_shipped/data/paper/claims.toml" in shipped
    assert "trexton/_shipped/book/_toc_small.yml" in shipped
    assert not [name for name in shipped if name.endswith((".ipynb", ".npz", ".html"))]
    assert wheel.stat().st_size < 3e6


def test_a_recording_is_imported_and_run_in_an_empty_folder(trexton, tmp_path):
    recording(tmp_path / "recording")
    trexton("import", "recording", "--out", "room", "--split", "0.5", folder=tmp_path)
    words = ["--only", "mocap_training", "--no-book"]
    words += ["--set", "repeats=1", "neighbors=2", "particles=9"]
    said = trexton("run", "room", "--out", "mine", *words, folder=tmp_path)
    assert said.startswith("ran     room/mocap_training")
    assert (tmp_path / "mine" / "room" / "mocap_training.json").is_file()
    assert "cyberzoo" in trexton("data", "list", folder=tmp_path)


@pytest.mark.slow
def test_the_report_and_its_small_book_are_made_in_an_empty_folder(trexton, tmp_path):
    recording(tmp_path / "recording", frames=36)
    trexton("import", "recording", "--out", "room", "--split", "0.5", folder=tmp_path)
    said = trexton("report", "room", "--out", "mine", folder=tmp_path)
    assert "always guessing the centre" in said
    assert "Will it work here?" in (tmp_path / "mine" / "report.html").read_text()
    (page,) = [line for line in said.splitlines() if line.endswith("index.html")]
    assert list((tmp_path / page).parent.rglob("assessment.html"))


# Whatever is not in the base installation cannot be imported. What is, pyproject.toml says: an
# environment may have been made before a requirement was.
ALONE = """
import sys, tomllib
from packaging.requirements import Requirement
from importlib.metadata import packages_distributions
project = tomllib.loads(open(sys.argv.pop(1)).read())["project"]
base = {Requirement(each).name for each in project["dependencies"]} | {"trexton", "llvmlite"}
extras = {name for name, of in packages_distributions().items() if not base & set(of)}

for name in [name for name in sys.modules if name.partition(".")[0] in extras]:
    del sys.modules[name]
sys.modules.update(dict.fromkeys(extras))
from trexton.cli.main import main
from trexton.companion.experiments import virtual_flights
virtual_flights.LATER = 1  # what is imported does not depend on how many
*words, out = sys.argv[1:]
refused = main([*words, "--out", out])
print("then", file=sys.stderr)
sys.exit(main(words) or refused != 1)
"""


def test_a_floor_is_judged_by_the_base_installation_alone(tmp_path):
    import cv2

    cv2.imwrite(
        str(tmp_path / "floor.jpg"), np.random.default_rng(0).integers(0, 255, (200, 300, 3))
    )
    words = ["suitability", tmp_path / "floor.jpg", "--width", "3", "--frames", "25"]
    call = [sys.executable, "-c", ALONE, ROOT / "pyproject.toml", *words, "--test-frames", "20"]
    done = subprocess.run([*call, tmp_path / "out"], capture_output=True, text=True)
    assert done.returncode == 0 and "expect method field" in done.stdout, done.stderr
    refused, flown = done.stderr.split("then\n")
    assert "pip install 'trexton[book]'" in refused
    assert "coarse flights" not in refused and "coarse flights" in flown  # said before any
