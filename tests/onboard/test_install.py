"""The onboard script stands alone: what it imports, and what its command line says about
mistakes.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT, small_flight

from trexton.cli.main import main
from trexton.companion.build.prose import context, render
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map
from trexton.onboard.sinks import SINKS
from trexton.onboard.tally import FAULTS

# numba looks for SciPy when it compiles, and goes without where there is none.
HEAVY = (
    "pandas",
    "matplotlib",
    "scipy",
    "IPython",
    "ipykernel",
    "jupyter_core",
    "nbformat",
    "papermill",
    "sklearn",
    "pooch",
    "tqdm",
)


NEVER = tuple(name for name in HEAVY if name != "scipy")


def test_import_pulls_in_nothing_heavy():
    code = (
        "import sys, pkgutil, importlib, trexton.onboard as package\n"
        "for found in pkgutil.walk_packages(package.__path__, 'trexton.onboard.'):\n"
        "    importlib.import_module(found.name)\n"
        "import trexton.cli.onboard\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_flight_of_the_script_pulls_in_nothing_heavy_either(flight_folder, tmp_path):
    path = save_map(
        train_map(small_flight(60), neighbors=3, rng=np.random.default_rng(1)), tmp_path / "map.npz"
    )
    code = (
        "import importlib.metadata, sys\nfrom trexton.cli.main import main\n"
        "importlib.metadata.entry_points = None\n"  # of all packages: reading them takes long
        f"words = ['onboard', {str(path)!r}, '--camera', {str(flight_folder)!r}, '--output', "
        "'csv:/dev/null', '-q']\n"
        "status = main(words)\n"
        f"never = {(*NEVER, 'pymavlink', 'cflib', 'logging')!r}\n"
        "print(status, [name for name in never if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0 []" and done.stderr == ""


@pytest.mark.parametrize("extra", ["pymavlink", "cflib"])
def test_a_missing_extra_is_named(extra, flight_folder, tmp_path):
    path = save_map(
        train_map(small_flight(60), neighbors=3, rng=np.random.default_rng(1)), tmp_path / "map.npz"
    )
    output = {
        "pymavlink": "udpout:127.0.0.1:14540",
        "cflib": "crazyflie:radio://0/80",
    }[extra]
    code = (
        f"import sys\nsys.modules[{extra!r}] = None\nfrom trexton.cli.main import main\n"
        f"words = ['onboard', {str(path)!r}, '--camera', {str(flight_folder)!r}, '--output', "
        f"{output!r}]\n"
        "sys.exit(main(words))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "pip install 'trexton[" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--camera", "nowhere"], "camera 'nowhere'"),
        (["--output", "smoke"], "output 'smoke'"),
        (["--arm-landing"], "without --land"),
        (["--land", "1"], "expected 2 numbers"),
        (["--land", "a,b"], "expected 2 numbers"),
        (["--land", "99,1"], "outside the map"),
        (["--spread", "1,2,3", "--land", "1,1"], "expected 1 or 2 numbers"),
        (["--pace", "slow"], "--pace"),
        (["--seed", "-1"], "--seed"),
        (["--target", "0"], "target"),
        (["--origin", "52,4,1e9"], "1e+09"),
        (["--origin", "52,4"], "LAT,LON,ALT"),
        (["--output", "udpout:127.0.0.1:14540", "--sign-key", "/no/such/key"], "cannot be read"),
        (["--land", "1,1", "--arm-landing"], "add --output udpout"),
        (["--land", "1,1", "--radius", "-1"], "radius"),
        (["--rate", "0"], "--rate"),
        (["--frames", "0"], "--frames"),
        (["--origin", "91,0,0"], "origin"),
        (["--height", "-1"], "height"),
        (["--particles", "0"], "particles"),
        (["--log", "/no/such/folder/log"], "cannot be written"),
    ],
)
def test_mistakes_on_the_command_line_get_one_sentence(
    options, sentence, flight_folder, tmp_path, capsys
):
    path = save_map(
        train_map(small_flight(60), neighbors=3, rng=np.random.default_rng(1)), tmp_path / "map.npz"
    )
    camera = [] if "--camera" in options else ["--camera", str(flight_folder)]
    assert main(["onboard", str(path), *camera, *options]) == 1
    errors = capsys.readouterr().err
    assert sentence in errors and len(errors.splitlines()) == 1


def test_no_map(capsys):
    assert main(["onboard", "no-such-map.npz"]) == 1
    assert "no such map" in capsys.readouterr().err


def test_the_systemd_unit_names_the_command():
    unit = (ROOT / "examples" / "trexton-onboard.service").read_text()
    assert "trexton onboard" in unit and "KillSignal=SIGTERM" in unit and "Restart=" in unit


def test_the_book_tells_what_is_done_about_every_fault():
    page = (ROOT / "book" / "onboard.md").read_text()
    table = page[page.index("| fault |") :]
    assert [name for name in FAULTS if f"`{name}`" not in table] == []


def test_the_book_names_every_source_and_sink(tmp_path):
    names = context(tmp_path, {}, lambda page, words: words)
    page = render(ROOT / "book" / "onboard.md", names)
    for name in (*SINKS, "stream:", "flight:"):
        assert f"`{name}" in page
