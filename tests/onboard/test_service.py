"""The unit for systemd."""

from __future__ import annotations

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
