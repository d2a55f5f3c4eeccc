"""The unit for systemd."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest
from conftest import ROOT

UNIT = ROOT / "examples" / "trexton-onboard.service"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_unit_is_hardly_exposed():
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=30", str(UNIT)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-300:]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_camera_goes_into_a_pipe_and_no_file(tmp_path):
    unit = ROOT / "examples" / "trexton-camera.service"
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (command,) = re.findall(r"^ExecStartPre=/bin/sh -c '(.*)'$", unit.read_text(), re.M)
    command = command.replace("/opt/trexton", str(tmp_path))
    for _ in range(2):
        assert subprocess.run(["sh", "-c", command]).returncode == 0
        assert (tmp_path / "camera.y4m").is_fifo()
    (tmp_path / "camera.y4m").unlink()
    (tmp_path / "camera.y4m").touch()
    assert subprocess.run(["sh", "-c", command], capture_output=True).returncode != 0
