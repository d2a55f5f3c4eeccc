"""Damaged input of every kind gives a sentence or a result; see `fuzzing` for longer searches."""

from __future__ import annotations

import subprocess
import sys

import fuzz_targets
import fuzzing
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trexton.base.progress import set_quiet

NAMES = (
    "flight.toml",
    "frames.csv",
    "histograms.csv",
    "image",
    "map",
    "cache",
    "record",
    "record picture",
    "plan",
    "import euroc",
    "import tum",
    "import csv",
    "import features",
    "import video",
    "import photos",
    "track",
    "calibration",
    "log",
    "sink address",
    "source address",
    "import bag",
)


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    set_quiet(True)
    found = fuzz_targets.targets(tmp_path_factory.mktemp("fuzz"))
    assert tuple(found) == NAMES
    return found


@pytest.mark.parametrize("name", NAMES)
def test_sound_input_is_read(name, targets):
    target, seeds = targets[name]
    for data in seeds:
        assert target(data) is not None


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("name", NAMES)
@settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(seed=st.integers(0, 2**32 - 1))
def test_damaged_input_is_read_or_refused_in_a_sentence(name, targets, seed):
    target, seeds = targets[name]
    rng = np.random.default_rng(seed)
    data = fuzzing.mutate(seeds[int(rng.integers(len(seeds)))], rng)
    assert fuzzing.attempt(target, data) is None


@pytest.mark.parametrize("name", NAMES)
@settings(
    max_examples=10,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(data=st.binary(max_size=300))
def test_noise_is_refused_in_a_sentence(name, targets, data):
    assert fuzzing.attempt(targets[name][0], data) is None


def test_what_once_broke_a_target_does_no_more(targets):
    for path in sorted(fuzzing.CORPUS.glob("*")):
        name = next(name for name in NAMES if path.name.startswith(name.replace(" ", "-")))
        assert fuzzing.attempt(targets[name][0], path.read_bytes()) is None, path.name


PNG_HEAD = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0 \0\0\0\x18\x08\x02\0\0\0\x14\x31hc"


@pytest.mark.parametrize(
    "bomb",
    [b"P6 30000 30000 255\n" + bytes(300), PNG_HEAD + b"\x40\0\0\0IDAT" + bytes(300)],
    ids=["pixels", "chunk"],
)
def test_a_picture_that_declares_too_much_is_refused_before_it_is_made(tmp_path, bomb):
    """The limit that OpenCV itself holds to, for formats whose heads are not parsed here."""
    (tmp_path / "bomb.ppm").write_bytes(bomb)
    code = (
        "import sys\nfrom trexton.cli.main import sentence\n"
        "from trexton.vision.images import read_image\ntry: read_image(sys.argv[1])\n"
        "except Exception as error: print(sentence(error))\n"
        # Not ru_maxrss, which a child inherits from whoever started it.
        "peak = next(line for line in open('/proc/self/status') if line.startswith('VmHWM'))\n"
        "sys.exit(int(peak.split()[1]) > 300_000)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "bomb.ppm")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and str(tmp_path / "bomb.ppm") in done.stdout, done


def test_the_harness_notices(targets):
    def crash(data: bytes) -> None:
        raise KeyError("oops")

    assert fuzzing.attempt(crash, b"") == "KeyError: 'oops'"
