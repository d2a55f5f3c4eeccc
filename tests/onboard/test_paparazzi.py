"""The example for Paparazzi's Ivy bus: the message's fields, and an agent on loopback that reads
them."""

from __future__ import annotations

import json
import math
import runpy
import socket
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT
from onboard_tools import make_fix
from patience import eventually

from trexton.onboard.sinks.files import row

EXAMPLE = str(ROOT / "examples" / "paparazzi_ivy.py")
# name and type of each field, after Paparazzi's message definitions (datalink, REMOTE_GPS_LOCAL)
FIELDS = [
    ("ac_id", int), ("pad", int), ("enu_x", float), ("enu_y", float), ("enu_z", float),
    ("enu_xd", float), ("enu_yd", float), ("enu_zd", float), ("tow", int), ("course", float),
]  # fmt: skip


def decoded(text: str) -> dict:
    sender, name, *values = text.split()
    assert (sender, name) == ("datalink", "REMOTE_GPS_LOCAL")
    return {name: kind(value) for (name, kind), value in zip(FIELDS, values, strict=True)}


def said(fix, heading=0.0):
    message = runpy.run_path(EXAMPLE)["message"]
    return message(json.loads(json.dumps(row(fix))), 42, heading, 1.25)


def test_every_field():
    fields = decoded(said(make_fix(12.3456, (1.0, 2.0)), math.radians(90)))  # +y points east
    assert fields == {
        "ac_id": 42, "pad": 0, "enu_x": 2.0, "enu_y": -1.0, "enu_z": 1.25,
        "enu_xd": 0, "enu_yd": 0, "enu_zd": 0, "tow": 12346, "course": 0,
    }  # fmt: skip


def test_time_of_week_stays_within_the_week():
    week = 7 * 24 * 3600
    assert decoded(said(make_fix(3 * week + 1.5)))["tow"] == 1500


@pytest.mark.parametrize(
    "bad", [{"lost": True}, {"stale": True}, {"observed": False}, {"position": (np.nan, 0)}]
)
def test_what_no_vehicle_may_steer_by_is_not_said(bad):
    assert said(make_fix(6.0, **{"position": (9, 9), **bad})) is None


def test_an_agent_on_the_bus_reads_it():
    ivy = pytest.importorskip("ivy.ivy", reason="the extra 'test' is not installed")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        bus = f"127.255.255.255:{probe.getsockname()[1]}"
    heard = []
    agent = ivy.IvyServer("ground station", usesDaemons=True)
    agent.bind_msg(lambda sender, text: heard.append(text), r"^(\S* REMOTE_GPS_LOCAL .*)")
    agent.start(bus)
    words = [sys.executable, EXAMPLE, "7", "--bus", bus]
    example = subprocess.Popen(words, stdin=subprocess.PIPE, text=True)
    try:
        line = json.dumps(row(make_fix(5.0, (1.5, 2.5)))) + "\n"
        assert eventually(
            lambda: example.stdin.write(line) and example.stdin.flush() is None and heard
        )
        fields = decoded(heard[0])
        assert (fields["enu_x"], fields["enu_y"], fields["ac_id"]) == (1.5, 2.5, 7)
        example.stdin.close()
        assert example.wait(60) == 0
    finally:
        example.kill()
        agent.stop()
        agent.server_close()
