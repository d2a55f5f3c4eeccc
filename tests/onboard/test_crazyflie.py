"""A Crazyflie's packets, read back by cflib's own: as bytes from the sink to a driver of ours."""

from __future__ import annotations

import struct
import sys
import threading
import time
from functools import partial

import numpy as np
import pytest
from onboard_tools import make_fix, surroundings
from patience import eventually

pytest.importorskip("cflib", reason="the extra 'crazyflie' is not installed")

from cflib import crtp  # noqa: E402
from cflib.crtp.crtpdriver import CRTPDriver  # noqa: E402
from cflib.crtp.crtpstack import CRTPPacket, CRTPPort  # noqa: E402
from cflib.crtp.exceptions import WrongUriType  # noqa: E402

from trexton.base.errors import ParameterError  # noqa: E402
from trexton.onboard.fix import LocalFrame  # noqa: E402
from trexton.onboard.sinks import Guard, open_sink  # noqa: E402
from trexton.onboard.tally import Tally, flush  # noqa: E402


class Air(CRTPDriver):
    """What went through the air, as bytes."""

    sent: list[bytes] = []
    opened = closed = 0
    lost = None

    def connect(self, uri, statistics, on_error):
        if not uri.startswith("air://"):
            raise WrongUriType
        if uri == "air://none":
            raise Exception("Cannot find a Crazyradio Dongle")
        type(self).lost = staticmethod(on_error)
        type(self).opened += 1

    def send_packet(self, packet):
        self.sent.append(bytes([packet.header]) + bytes(packet.data))

    def close(self):
        type(self).closed += 1


@pytest.fixture
def air(monkeypatch):
    monkeypatch.setattr(crtp, "CLASSES", [Air])
    monkeypatch.setattr(Air, "sent", [])
    monkeypatch.setattr(Air, "opened", 0)
    monkeypatch.setattr(Air, "closed", 0)
    yield Air
    assert eventually(lambda: Air.opened == Air.closed)  # by its thread, not in the next test


def was_sent(air, x: float) -> bool:
    return bool(air.sent) and struct.pack("<f", -x) in air.sent[-1]


def read(data: bytes):
    packet = CRTPPacket(data[0], data[1:])
    return packet.port, packet.channel, bytes(packet.data)


def test_positions_and_how_far_they_may_be_off(air):
    around = surroundings(local=LocalFrame(np.pi / 2, 1.2))
    sink = open_sink("crazyflie:air://1", around)
    sink.open()
    for fix in (
        make_fix(1.0, (1.5, 2.5), 0.04 * np.eye(2)),
        make_fix(1.1, (9.0, 9.0), lost=True),
        make_fix(1.2, (9.0, 9.0), observed=False),
        make_fix(1.3, (1.6, 2.5), 0.041 * np.eye(2)),
        make_fix(1.4, (1.7, 2.5), 0.25 * np.eye(2)),
    ):
        sink.write(fix)
        if fix.usable and fix.observed:
            assert eventually(partial(was_sent, air, fix.position[0]))
    sink.close()
    assert eventually(lambda: (air.opened, air.closed) == (1, 1))
    packets = [read(data) for data in air.sent]
    places = [
        struct.unpack("<fff", data) for port, _, data in packets if port == CRTPPort.LOCALIZATION
    ]
    # The map's +y points east, its +x south.
    assert places == [pytest.approx((2.5, -x, 1.2)) for x in (1.5, 1.6, 1.7)]
    deviations = [data for port, channel, data in packets if (port, channel) == (CRTPPort.PARAM, 3)]
    name = b"\0locSrv\0extPosStdDev\0\x06"
    assert [data[: len(name)] for data in deviations] == [name] * 2
    assert [struct.unpack("<f", data[len(name) :])[0] for data in deviations] == pytest.approx(
        [0.2, 0.5]
    )
    # No setpoint: cflib's own way to close a link sends one, of no thrust.
    assert {port for port, _, _ in packets} == {CRTPPort.PARAM, CRTPPort.LOCALIZATION}


def test_a_radio_that_is_lost_is_counted_and_opened_again(air, capsys):
    tally, now = Tally(), [0.0]
    guard = Guard(open_sink("crazyflie:air://1", surroundings()), tally, lambda: now[0])
    guard.write(make_fix(1.0))
    assert eventually(lambda: air.opened == 1)
    lost = air.lost
    lost("Too many packets lost")
    guard.write(make_fix(1.1))
    assert eventually(lambda: (tally["output"], air.closed) == (1, 1))
    now[0] += 2.0
    guard.write(make_fix(1.2))
    assert eventually(lambda: air.opened == 2)
    lost("said by the connection of before")
    guard.write(make_fix(1.3))
    assert tally["output"] == 1
    guard.close()


def test_how_far_positions_may_be_off_is_said_again(air, monkeypatch):
    """A vehicle that starts anew while the radio goes on takes them for good to a centimetre."""
    monkeypatch.setattr("trexton.onboard.sinks.crazyflie.REPEATED_S", 0.0)
    sink = open_sink("crazyflie:air://1", surroundings())
    sink.open()
    for x in (1.0, 2.0):
        sink.write(make_fix(x, (1.0, x), 0.04 * np.eye(2)))
        assert eventually(lambda x=x: bool(air.sent) and struct.pack("<f", x) in air.sent[-1])
    sink.close()
    ports = [read(data)[0] for data in air.sent]
    assert ports == 2 * [CRTPPort.PARAM, CRTPPort.LOCALIZATION]


def test_a_driver_that_fails_while_it_sends_is_opened_again(air, monkeypatch):
    """cflib keeps the lock of such a link: nothing went out any more, and nothing said so."""
    send, failed = Air.send_packet, []

    def fail_once(self, packet):
        if not failed:
            failed.append(packet)
            raise Exception("USB gone")
        send(self, packet)

    monkeypatch.setattr(Air, "send_packet", fail_once)
    tally, now = Tally(), [0.0]
    guard = Guard(open_sink("crazyflie:air://1", surroundings()), tally, lambda: now[0])
    guard.write(make_fix(1.0))
    assert eventually(lambda: guard.sink._why == "USB gone")
    guard.write(make_fix(1.1))
    now[0] += 2.0
    guard.write(make_fix(1.2, (3.0, 2.0)))
    assert eventually(lambda: bool(air.sent) and struct.pack("<f", 3.0) in air.sent[-1])
    assert (tally["output"], air.opened) == (1, 2)
    guard.close()


@pytest.mark.parametrize(("uri", "why"), [("air://none", "Dongle"), ("sea://1", "no driver")])
def test_no_radio_or_an_address_of_another_kind(air, uri, why, capsys):
    """It is said, and tried again after pauses that grow: a connection that fails is none."""
    tally, now = Tally(), [0.0]
    guard = Guard(open_sink(f"crazyflie:{uri}", surroundings()), tally, lambda: now[0])
    for pause in (1, 2, 4):
        guard.write(make_fix(1.0))
        assert eventually(lambda: guard.sink._why)
        guard.write(make_fix(1.1))
        flush()
        said = capsys.readouterr().err
        assert why in said and f"again in {pause} s" in said
        now[0] += pause
    assert tally["output"] == 3


def test_a_radio_that_takes_its_time_holds_nothing_up(air, monkeypatch):
    """Nor does it pass on what it has held back for so long that the vehicle is elsewhere."""
    connect, go_on = Air.connect, threading.Event()
    monkeypatch.setattr(Air, "connect", lambda *words: (go_on.wait(60), connect(*words)))
    monkeypatch.setattr("trexton.onboard.sinks.crazyflie.STALE_AFTER", 0.05)
    sink = open_sink("crazyflie:air://1", surroundings())
    sink.open()
    sink.write(make_fix(1.0, (1.0, 2.0)))
    time.sleep(0.1)
    go_on.set()
    assert eventually(lambda: air.opened == 1)
    monkeypatch.setattr("trexton.onboard.sinks.crazyflie.STALE_AFTER", 60.0)
    sink.write(make_fix(1.1, (1.0, 3.0)))
    assert eventually(lambda: len(air.sent) == 2)
    assert struct.pack("<f", 3.0) in air.sent[-1]
    sink.close()


def test_an_address_without_uri_and_a_package_that_is_missing(monkeypatch):
    with pytest.raises(ParameterError, match="give crazyflie:URI"):
        open_sink("crazyflie:7", surroundings())
    monkeypatch.setitem(sys.modules, "cflib", None)
    with pytest.raises(ModuleNotFoundError, match="cflib"):
        open_sink("crazyflie:radio://0/80", surroundings())
