"""What is kept is made again once anything that made it has changed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import trexton
from trexton.base.cache import _hash_and_imports, cached, code_hashes
from trexton.localization.methods import ROLES

# In a copy of the package: change a constant of one reached module after the other, ask each time.
# A module is read once a process: here again when it was changed.
EDITS = """
import importlib.util, sys
from pathlib import Path
import numpy as np
import trexton.base.cache as cache

read, known = cache._hash_and_imports.__wrapped__, {}
def remembered(name):
    if name not in known:
        known[name] = read(name)
    return known[name]
cache._hash_and_imports = remembered

def made():
    cache.code_hashes.cache_clear()
    calls = []
    cache.cached("thing", sys.argv[1], {"a": 1}, lambda: calls.append(1) or {"x": np.zeros(1)})
    return bool(calls)

assert made() and not made()
modules = list(cache.code_hashes(sys.argv[1]))
places = [(name, Path(importlib.util.find_spec(name).origin)) for name in modules]
for beside in Path("trexton/companion/player").glob("player.*"):
    places.append(("trexton.companion.player", beside))
for name, place in places:
    with open(place, "a") as stream:
        stream.write("\\nEDITED = 1\\n")
    del known[name]
    if not made():
        print("stale after a change of", place)
print(len(modules))
"""


def test_a_change_in_any_module_that_is_reached_makes_it_anew(tmp_path):
    package = Path(trexton.__file__).parent
    shutil.copytree(package, tmp_path / "trexton", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {"PYTHONPATH": str(tmp_path), "TREXTON_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", EDITS, "trexton.companion.player.playback"],
        capture_output=True, text=True, cwd=tmp_path, env=environment,
    )  # fmt: skip
    assert done.stdout.split() and done.stdout.split() == done.stdout.split()[:1], done
    assert int(done.stdout) >= 5


def test_what_a_docstring_says_is_not_code(tmp_path, monkeypatch):
    module = tmp_path / "trexton" / "module.py"
    module.parent.mkdir()
    texts = [
        '"""One."""\nx = "a text"\n',
        '"""Two,\nlonger.\n"""\nx = "a text"\n',
        '"""Two,\nlonger.\n"""\nx = "another text"\n',
    ]
    monkeypatch.setattr("trexton.base.cache._PACKAGE", module.parent)
    hashes = []
    for text in texts:
        module.write_text(text)
        hashes.append(_hash_and_imports.__wrapped__("trexton.module")[0])
    assert hashes[0] == hashes[1] != hashes[2]


def test_parts_that_are_loaded_by_name_are_reached():
    named = {place.partition(":")[0] for names in ROLES.values() for place in names.values()}
    assert named <= code_hashes("trexton.localization.localizer").keys()
    assert named <= code_hashes("trexton.companion.experiments.beyond").keys()


TWICE = """
import sys, time
import numpy as np
from trexton.base.cache import cached

def compute():
    time.sleep(1)
    print("computed", flush=True)
    return {"x": np.arange(3)}

assert cached("thing", "trexton.base.cache", {}, compute)["x"].tolist() == [0, 1, 2]
"""


def test_of_processes_that_ask_at_once_one_computes_and_the_others_wait(tmp_path):
    environment = os.environ | {"TREXTON_CACHE": str(tmp_path)}
    words = [sys.executable, "-c", TWICE]
    runs = [
        subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(3)
    ]
    said = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0, 0] and "".join(said) == "computed\n"
    assert [path.suffix for path in tmp_path.iterdir()] == [".npz"]


def test_a_lock_that_a_killed_run_left_is_taken(tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    assert cached("thing", "trexton.base.cache", {}, lambda: {"x": np.arange(3)})
    (kept,) = tmp_path.iterdir()
    kept.rename(kept.with_suffix(".lock")).write_text("of nobody")
    assert cached("thing", "trexton.base.cache", {}, lambda: {"x": np.arange(3)})
    assert list(tmp_path.iterdir()) == [kept]


HOLD = """
import os, sys
from pathlib import Path
from trexton.base.cache import _turn

file, alone = Path(sys.argv[1]), Path(sys.argv[1]).with_suffix(".alone")
for _ in range(50):
    with _turn(file):
        os.close(os.open(alone, os.O_CREAT | os.O_EXCL))  # fails where another holds it as well
        alone.unlink()
"""


def test_a_lock_that_is_removed_while_others_wait_for_it_is_never_held_twice(tmp_path):
    words = [sys.executable, "-c", HOLD, str(tmp_path / "thing.npz")]
    runs = [subprocess.Popen(words) for _ in range(4)]
    assert [run.wait(60) for run in runs] == [0] * 4 and not list(tmp_path.iterdir())
