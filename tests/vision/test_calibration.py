"""Calibrations as OpenCV and ASL write them, and as nobody should."""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np
import pytest

from trexton.base.errors import FlightError
from trexton.vision.calibration import read_calibration

ASL = """resolution: [64, 48]
intrinsics: [50.0, 52.0, 31.0, 23.0]
distortion_coefficients: [0.1, 0.0, 0.0, 0.0]
"""


def tens(first: str, following: str) -> str:
    """Eight lists of ten, each of the one before: 10^9 values in a few lines."""
    lines = [f"a0: &a0 {first}"]
    for i in range(1, 9):
        lines.append(f"a{i}: &a{i} {following}" % ",".join([f"*a{i - 1}"] * 10))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("suffix", [".yml", ".json"])
def test_opencv_s_own_file_with_all_the_points_it_saw(tmp_path, suffix):
    path = tmp_path / f"camera{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 64)
    storage.write("image_height", 48)
    storage.write("camera_matrix", np.array([[50.0, 0, 31], [0, 52, 23], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([[0.1, 0, 0, 0, 0]]))
    storage.write("image_points", np.random.default_rng(0).uniform(-64, 64, (20, 54)))
    storage.release()
    camera, distortion = read_calibration(path)
    assert (camera.width, camera.height, camera.focal) == (64, 48, 51)
    assert camera.center == (31, 23)
    np.testing.assert_array_equal(distortion, [0.1, 0, 0, 0, 0])


def test_without_distortion_there_is_none(tmp_path):
    (tmp_path / "sensor.yaml").write_text(ASL.replace("0.1", "0.0"))
    assert read_calibration(tmp_path / "sensor.yaml")[1] is None


@pytest.mark.parametrize(
    ("what", "why"),
    [
        (ASL.replace("64", "0"), "sensor.yaml: a camera of 0x48 pixels"),
        (ASL.replace("64", "9999999"), "expected a picture of"),
        (ASL.replace("50.0", "-80.0"), "expected sizes and a focal length above 0"),
        (ASL.replace("0.1", ".nan"), "expected a picture of"),
        (ASL.replace("intrinsics", "interests"), "no calibration"),
    ],
)
def test_of_no_camera(tmp_path, what, why):
    (tmp_path / "sensor.yaml").write_text(what)
    with pytest.raises(FlightError, match=why):
        read_calibration(tmp_path / "sensor.yaml")


def hostile() -> dict[str, str]:
    """By name; of megabytes, so made only where they are asked for."""
    return {
        "lists of lists": tens("[1,1,1,1,1,1,1,1,1,1]", "[%s]")
        + ASL.replace("[0.1, 0.0, 0.0, 0.0]", "*a8"),
        "merged mappings": tens("{x: 1}", "{<<: [%s]}") + ASL,
        "deep": f"{ASL}z: {'[' * 20_000}",
        "deep enough for the stack": f"%YAML:1.0\n---\nz: {'[' * 500_000}",
        "deep without a bracket": f"%YAML:1.0\n---\nz:\n  {'-' * 500_000}",
        "deep keys": f"%YAML:1.0\n---\nz:\n  {'a:' * 500_000}",
        "deep questions": f"{ASL}z: {'? ' * 120_000}",
        "deep as the bound, in questions": f"{ASL}z:\n  {'? ' * 9_980}",
        "deep elements": f'<?xml version="1.0"?><opencv_storage>{"<a>" * 300_000}',
        "deep as the bound": f"%YAML:1.0\n---\nz: {'[' * 9_990}",
        "long": ASL + "".join(f"key{i}: [1, 2, 3]\n" for i in range(300_000)),
        "entities": '<!DOCTYPE a [<!ENTITY a "1 1 1 1 1 1 1 1">]>'
        "<opencv_storage>&a;</opencv_storage>",
        "numbers": f"{ASL}z: [{'1,' * 60_000}1",
        "long number": ASL.replace("64", "0x" + "9" * 10_000),
    }


def test_hostile_ones_are_refused_at_once(tmp_path):
    """In a process of its own, which a stack that overflows would end."""
    texts = hostile()
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    code = (
        "import resource, sys, time; from pathlib import Path\n"
        "from trexton.base.errors import FlightError\n"
        "from trexton.vision.calibration import read_calibration\n"
        "resource.setrlimit(resource.RLIMIT_CPU, (20, 20))\n"
        "resource.setrlimit(resource.RLIMIT_DATA, (2**30, 2**30))\n"
        "for name in sys.argv[1:]:\n"
        "    begun = time.process_time()\n"
        "    try: print(name, read_calibration(Path(name)))\n"
        "    except FlightError as error:\n"
        "        quick = time.process_time() - begun < 2 and len(str(error)) < 300\n"
        "        print(name, 'refused' if quick else 'refused late or at length', flush=True)\n"
    )
    command = [sys.executable, "-c", code, *texts]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.stdout.splitlines() == [f"{name} refused" for name in texts], done
