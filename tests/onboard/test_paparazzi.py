"""Paparazzi's Ivy bus: the message's fields, and a second agent on loopback that reads them."""

from __future__ import annotations

import math
import re
import socket

import numpy as np
import pytest
from onboard_tools import make_fix, surroundings
from patience import eventually

ivy = pytest.importorskip("ivy.ivy", reason="the extra 'paparazzi' is not installed")

from trexton.base.errors import ParameterError  # noqa: E402
from trexton.onboard.local import LocalFrame  # noqa: E402
from trexton.onboard.sinks import open_sink  # noqa: E402
from trexton.onboard.sinks.paparazzi import remote_gps_local  # noqa: E402

# name and type of each field, after Paparazzi's message definitions (datalink, REMOTE_GPS_LOCAL)
FIELDS = [
    ("ac_id", int),
    ("pad", int),
    ("enu_x", float),
    ("enu_y", float),
    ("enu_z", float),
    ("enu_xd", float),
    ("enu_yd", float),
    ("enu_zd", float),
    ("tow", int),
    ("course", float),
]


def decoded(text: str) -> dict:
    sender, name, *values = text.split()
    assert (sender, name) == ("datalink", "REMOTE_GPS_LOCAL")
    assert len(values) == len(FIELDS)
    return {name: kind(value) for (name, kind), value in zip(FIELDS, values, strict=False)}


def test_every_field():
    local = LocalFrame(math.radians(90), 1.25)  # the map's +y points east
    fields = decoded(remote_gps_local(make_fix(12.3456, (1.0, 2.0)), 42, local))
    assert fields == {
        "ac_id": 42,
        "pad": 0,
        "enu_x": 2.0,
        "enu_y": -1.0,
        "enu_z": 1.25,
        "enu_xd": 0,
        "enu_yd": 0,
        "enu_zd": 0,
        "tow": 12346,
        "course": 0,
    }


def test_time_of_week_stays_within_the_week():
    week = 7 * 24 * 3600
    assert decoded(remote_gps_local(make_fix(3 * week + 1.5), 1, LocalFrame()))["tow"] == 1500


@pytest.mark.parametrize(
    "address", ["paparazzi", "paparazzi:x", "paparazzi:256", "paparazzi:1@bus"]
)
def test_wrong_addresses(address):
    with pytest.raises(ParameterError, match="AIRCRAFT"):
        open_sink(address, surroundings())


def test_a_second_agent_on_the_bus_reads_it():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        bus = f"127.255.255.255:{probe.getsockname()[1]}"
    heard = []
    agent = ivy.IvyServer("ground station", usesDaemons=True)
    agent.bind_msg(lambda sender, text: heard.append(text), r"^(\S* REMOTE_GPS_LOCAL .*)")
    agent.start(bus)
    sink = open_sink(f"paparazzi:7@{bus}", surroundings())
    sink.open()
    try:
        fix = make_fix(5.0, (1.5, 2.5))
        assert eventually(lambda: sink.write(fix) or heard)
        assert decoded(heard[0]) | {
            "enu_x": 1.5,
            "enu_y": 2.5,
            "enu_z": 1.0,
            "ac_id": 7,
            "tow": 5000,
        } == decoded(heard[0])
        count = len(heard)
        for bad in (
            {"lost": True},
            {"stale": True},
            {"observed": False},
            {"position": (np.nan, 0)},
        ):
            sink.write(make_fix(6.0, **{"position": (9, 9), **bad}))
        sink.write(make_fix(7.0, (3, 3)))
        assert eventually(lambda: len(heard) > count)
        assert all(re.search(r" (1\.5|3\.0)000 ", text) for text in heard)
    finally:
        sink.close()
        agent.stop()
        agent.server_close()
    sink.open()  # a bus that is joined again
    sink.close()
