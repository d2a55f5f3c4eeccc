"""Words to systemd, and the unit that waits for them."""

from __future__ import annotations

import shutil
import socket
import subprocess
import threading

import numpy as np
import pytest
from conftest import ROOT, small_flight

from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.onboard import Onboard
from trexton.onboard.sources.recorded import FlightSource
from trexton.onboard.status import Service
from trexton.onboard.tally import Tally

UNIT = ROOT / "examples" / "trexton-onboard.service"


def test_a_flight_says_ready_alive_and_stopping(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "3")
        flight = small_flight(30)
        localizer = Localizer(
            train_map(flight, neighbors=3, rng=np.random.default_rng(1)),
            rng=np.random.default_rng(2),
        )
        systemd.setblocking(False)
        Onboard(localizer, FlightSource(flight), [], tally=Tally(), frames=3).run(threading.Event())
        heard = []
        while True:
            try:
                heard.append(systemd.recv(4096).decode().split("=")[0])
            except BlockingIOError:
                break
    assert heard[0] == "READY" and "STOPPING" in heard
    assert "WATCHDOG" in heard and "STATUS" in heard


def test_alive_no_oftener_than_asked_and_nothing_where_nobody_listens(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.setblocking(False)
        service = Service({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "9000000"})
        for now in (0.0, 1.0, 2.0, 3.5):
            service.alive(now)
        assert [systemd.recv(100) for _ in range(2)] == [b"WATCHDOG=1"] * 2
        with pytest.raises(BlockingIOError):
            systemd.recv(100)
    Service({}).say("READY=1")
    Service({"NOTIFY_SOCKET": "/no/such/socket"}).say("READY=1")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_unit_is_hardly_exposed():
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=30", str(UNIT)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-300:]
