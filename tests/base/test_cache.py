"""What is kept is made again once anything that made it has changed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import trexton
from trexton.base.cache import code_hashes
from trexton.localization.roles import ROLES

# In a copy of the package: change a constant of one reached module after the other, ask each time.
EDITS = """
import importlib, sys
from pathlib import Path
import numpy as np
import trexton.base.cache as cache

def made():
    importlib.reload(cache)  # it reads every module once a process
    calls = []
    cache.cached("thing", sys.argv[1], {"a": 1}, lambda: calls.append(1) or {"x": np.zeros(1)})
    return bool(calls)

assert made() and not made()
modules = list(cache.code_hashes(sys.argv[1]))
places = [Path(importlib.util.find_spec(name).origin) for name in modules]
for place in places + list(Path("trexton/companion/player").glob("player.*")):
    with open(place, "a") as stream:
        stream.write("\\nEDITED = 1\\n")
    if not made():
        print("stale after a change of", place)
print(len(modules))
"""


def test_a_change_in_any_module_that_is_reached_makes_it_anew(tmp_path):
    package = Path(trexton.__file__).parent
    shutil.copytree(package, tmp_path / "trexton", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {"PYTHONPATH": str(tmp_path), "TREXTON_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", EDITS, "trexton.companion.player.page"],
        capture_output=True, text=True, cwd=tmp_path, env=environment,
    )  # fmt: skip
    assert done.stdout.split() and done.stdout.split() == done.stdout.split()[:1], done
    assert int(done.stdout) >= 5


def test_parts_that_are_loaded_by_name_are_reached():
    named = {place.partition(":")[0] for names in ROLES.values() for place in names.values()}
    assert named <= code_hashes("trexton.localization.localizer").keys()
    assert named <= code_hashes("trexton.companion.experiments.beyond").keys()
