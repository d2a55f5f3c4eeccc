"""The MAVLink sink over loopback: what it is told, and what a receiver of its own reads."""

from __future__ import annotations

import math
import os
import socket
import time
from functools import partial
from threading import Event

import numpy as np
import pytest
from onboard_tools import Clock, make_fix, surroundings
from onboard_tools import mavlink as mavlink_options
from patience import eventually

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import ATTITUDE, AUTOPILOT_HEARTBEAT, IN_AIR, Peer  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from trexton.onboard.mavlink import messages  # noqa: E402
from trexton.onboard.sinks import open_sink  # noqa: E402
from trexton.onboard.tally import Tally  # noqa: E402

AREA = (0.0, 5.0, 0.0, 5.0)


def heard(peer: Peer, kind: str, count: int) -> bool:
    return len(peer.of(kind)) >= count


@pytest.fixture
def peer():
    made = Peer()
    yield made
    made.close()


class TestOverUdp:
    """End to end over loopback: what a sink is told, and what a receiver of its own makes of the
    bytes.
    """

    def test_px4(self, peer):
        tally, clock = Tally(), Clock()
        sink = open_sink(
            f"udpout:127.0.0.1:{peer.port}",
            surroundings(tally, clock=clock),
            mavlink_options(origin="51.99,4.37,1"),
        )
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            beat = peer.of("HEARTBEAT")[0]
            assert (beat.type, beat.autopilot, beat.get_srcSystem(), beat.get_srcComponent()) == (
                18,
                8,
                1,
                191,
            )
            peer.send(
                AUTOPILOT_HEARTBEAT,
                IN_AIR,
                mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0),
                mavlink.MAVLink_timesync_message(0, 5),
            )
            assert eventually(lambda: peer.of("SET_GPS_GLOBAL_ORIGIN") and peer.of("TIMESYNC"))
            sink.write(make_fix(clock.now, (1.5, 2.5), resets=4))
            for count in (1, 2, 3):
                assert eventually(partial(heard, peer, "VISION_POSITION_ESTIMATE", count))
                clock.now += 0.16
            first, *more = peer.of("VISION_POSITION_ESTIMATE")
            assert first.usec == 100_000_000
            assert [message.usec for message in more[:2]] == [100_070_000, 100_230_000]
            assert (first.x, first.y, first.z, first.reset_counter) == (2.5, 1.5, -1.0, 4)
            assert (first.roll, first.pitch, first.yaw) == pytest.approx(ATTITUDE)
            assert first.covariance[0] == pytest.approx(0.09) and first.covariance[
                6
            ] == pytest.approx(0.04)
            assert math.isnan(first.covariance[20]) and first.covariance[11] == 100
            assert eventually(lambda: tally["sent VISION_POSITION_ESTIMATE"] == 3)
            assert "autopilot 1 heard" in sink.status()
        finally:
            sink.close()

    def test_ardupilot(self, peer):
        clock = Clock()
        around, options = surroundings(clock=clock), mavlink_options(autopilot="ardupilot")
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", around, options)
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            peer.send(AUTOPILOT_HEARTBEAT)
            assert eventually(lambda: [m for m in peer.of("COMMAND_LONG") if m.command == 511])
            peer.send(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0))
            assert eventually(lambda: sink.aiding(clock.now).roll is not None)
            sink.write(make_fix(clock.now, (1.5, 2.5)))
            assert eventually(lambda: peer.of("ODOMETRY"))
            message = peer.of("ODOMETRY")[0]
            assert message.time_usec == 100_000_000
            assert (message.x, message.y, message.z) == (2.5, 1.5, -1.0)
            assert message.q == pytest.approx(messages.quaternion(*ATTITUDE), abs=1e-6)
            assert message.quality == messages.quality(np.array([0.2, 0.3]), AREA)
        finally:
            sink.close()

    def test_a_companion_shares_the_system_of_its_vehicle(self, peer):
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(clock=Clock()))
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            peer.codec.srcSystem = 7
            peer.send(AUTOPILOT_HEARTBEAT, IN_AIR)
            assert eventually(lambda: sink.land(0) and peer.of("COMMAND_LONG"))
            command = peer.of("COMMAND_LONG")[-1]
            assert (command.target_system, command.get_srcSystem(), command.get_srcComponent()) == (
                7,
                7,
                191,
            )
        finally:
            sink.close()

    def test_messages_are_numbered(self, peer):
        """By their gaps an autopilot counts what was lost on the way: it counted nearly all."""
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings())
        sink.open()
        try:
            assert eventually(lambda: len(peer.of("HEARTBEAT")) > 1)
            numbers = [message.get_seq() for message in list(peer.received)]
            assert numbers == list(range(len(numbers)))
        finally:
            sink.close()

    def test_garbage_on_the_wire_is_skipped(self, peer, rng):
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings())
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            for _ in range(50):
                peer.send(rng.integers(0, 256, rng.integers(1, 300), dtype=np.uint8).tobytes())
            packet = AUTOPILOT_HEARTBEAT.pack(peer.codec)
            peer.send(packet[:9], packet[:-1] + bytes([packet[-1] ^ 1]))
            assert eventually(
                lambda: peer.send(AUTOPILOT_HEARTBEAT) or "autopilot 1 heard" in sink.status()
            )
        finally:
            sink.close()

    def test_the_peer_gone_and_back(self):
        """On the same port, heard of again; the sink never raises, and counts the silence."""
        tally, first = Tally(), Peer()
        sink = open_sink(f"udpout:127.0.0.1:{first.port}", surroundings(tally))
        sink.open()
        try:
            assert eventually(lambda: first.of("HEARTBEAT"))
            port_of_ours = first.address
            first.close()
            assert eventually(lambda: sink.write(make_fix(time.monotonic())) or tally["link"] >= 1)
            second = Peer(first.port)
            try:
                assert eventually(
                    lambda: (
                        sink.write(make_fix(time.monotonic()))
                        or second.of("VISION_POSITION_ESTIMATE")
                    )
                )
                assert second.address == port_of_ours  # PX4 answers the first it has seen
            finally:
                second.close()
        finally:
            sink.close()

    def test_a_silent_autopilot_is_said_and_not_landed(self, peer):
        clock = Clock(50.0)
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(clock=clock))
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            peer.send(AUTOPILOT_HEARTBEAT, IN_AIR)
            assert eventually(lambda: "heard" in sink.status() and "no" not in sink.status())
            assert sink.land(0)
            clock.now += 4
            assert sink.status() == "autopilot 1 silent" and not sink.land(1)
            garbled = bytearray(AUTOPILOT_HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
            garbled[-1] ^= 1
            assert eventually(
                lambda: (
                    peer.socket.sendto(garbled, peer.address)
                    and sink.status().startswith("autopilot 1 silent, but ")
                )
            )
            peer.send(AUTOPILOT_HEARTBEAT)
            assert eventually(lambda: sink.status() == "autopilot 1 heard")
        finally:
            sink.close()


def test_a_line_that_is_not_there_is_counted_and_does_not_block():
    tally = Tally()
    sink = open_sink("serial:/dev/no-such-line", surroundings(tally))
    sink.open()
    sink.write(make_fix(time.monotonic()))
    assert eventually(lambda: tally["link"] >= 2)
    assert sink.status() == "no link" and not sink.land(0)
    sink.close()
    assert [each["why"] for each in sink.news()] == ["No such file or directory"]  # once


def test_a_wrong_port_or_baud_rate_is_told_from_silence():
    """A receiver of satellites on the line, or the right line at another speed."""
    master, line = os.openpty()
    sink = open_sink(f"serial:{os.ttyname(line)}:57600", surroundings())
    sink.open()
    try:
        sentence = b"$GNGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,*76\r\n"
        assert "no MAVLink" not in sink.status()
        assert eventually(
            lambda: os.write(master, sentence) and "bytes that are no MAVLink" in sink.status()
        )
        os.write(master, AUTOPILOT_HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1)))
        assert eventually(lambda: sink.status() == "autopilot 1 heard")
    finally:
        sink.close()
        os.close(master)
        os.close(line)


@pytest.mark.parametrize("size", [7, 32])
def test_a_bridge_may_cut_messages_anywhere(peer, size):
    """What turns a serial line into datagrams knows of no messages: nobody was heard."""
    sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(clock=Clock()))
    sink.open()
    try:
        assert eventually(lambda: peer.of("HEARTBEAT"))
        said = mavlink.MAVLink_attitude_message(9, *ATTITUDE, 0, 0, 0).pack(peer.codec)
        line = (AUTOPILOT_HEARTBEAT.pack(peer.codec) + said) * 3
        peer.send(*(line[start : start + size] for start in range(0, len(line), size)))
        assert eventually(lambda: sink.status() == "autopilot 1 heard")
        assert eventually(lambda: sink.aiding(100.0).roll is not None)
    finally:
        sink.close()


def test_another_vehicle_on_the_port_gets_no_position_of_ours():
    """It would fly by it: messages with positions are addressed to nobody."""
    ours, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with ours, other:
        other.bind(("127.0.0.1", 0))
        port, clock = other.getsockname()[1], Clock()  # a free one, as long as it is ours
        other.close()
        other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        around, options = surroundings(clock=clock), mavlink_options(target="1")
        sink = open_sink(f"udpin:127.0.0.1:{port}", around, options)
        sink.open()
        try:
            for number, wire in ((2, other), (1, ours), (2, other)):
                beat = AUTOPILOT_HEARTBEAT.pack(mavlink.MAVLink(None, number, 1))
                assert eventually(partial(arrived, sink, wire, beat, port))
            sink.write(make_fix(clock.now))
            ours.settimeout(60)
            kinds = set()
            while "VISION_POSITION_ESTIMATE" not in kinds:
                (message,) = mavlink.MAVLink(None).parse_buffer(ours.recv(999))
                kinds.add(message.get_type())
            other.setblocking(False)
            with pytest.raises(BlockingIOError):
                other.recv(999)
        finally:
            sink.close()
            other.close()


def test_of_two_links_only_that_of_the_first_vehicle_is_ours():
    """Each link had a vehicle of its own, beyond doubt: both were sent positions, and landed."""
    clock = Clock()
    around, own, other = surroundings(clock=clock), Peer(), Peer()
    other.codec = mavlink.MAVLink(None, 2, 1)
    sinks = [open_sink(f"udpout:127.0.0.1:{each.port}", around, {}) for each in (own, other)]
    try:
        for sink, each in zip(sinks, (own, other), strict=True):
            sink.open()
            assert eventually(lambda each=each: each.of("HEARTBEAT"))
            each.send(AUTOPILOT_HEARTBEAT)
            assert eventually(lambda sink=sink, each=each: each.codec.srcSystem in
                              {system for system, _ in sink.speaker.listener.heard})  # fmt: skip
        assert [sink.speaker.listener.target for sink in sinks] == [(1, 1), None]
        assert [sink.land(0) for sink in sinks] == [False, False]
        assert "SEVERAL VEHICLES: give --target" in sinks[0].status()
        assert "several vehicles" in {each["event"] for each in sinks[1].news()}
    finally:
        for each in (*sinks, own, other):
            each.close()


def arrived(sink, wire: socket.socket, data: bytes, port: int) -> bool:
    """Sends it, until the sink's thread has read from its socket."""
    codec = sink._codec
    before = codec.total_packets_received
    wire.sendto(data, ("127.0.0.1", port))
    return bool(eventually(lambda: codec.total_packets_received > before, 0.2))


def test_a_wrong_key_is_told_from_a_wrong_port(peer, tmp_path):
    (tmp_path / "key").write_bytes(bytes(32))
    (tmp_path / "key").chmod(0o600)
    options = mavlink_options(sign_key=str(tmp_path / "key"))
    sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(), options)
    sink.open()
    try:
        assert eventually(lambda: peer.address is not None)
        words = "no MAVLink or not signed by our key"
        assert eventually(lambda: peer.send(AUTOPILOT_HEARTBEAT) or words in sink.status())
    finally:
        sink.close()


def test_a_landing_commanded_before_the_link_broke_goes_out_on_no_other(peer):
    """What was right there and then is not wherever the vehicle is once the link is back."""
    clock = Clock()
    sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(clock=clock))
    sink.open()
    try:
        assert eventually(lambda: peer.of("HEARTBEAT"))
        peer.send(AUTOPILOT_HEARTBEAT, IN_AIR)
        assert eventually(lambda: "heard" in sink.status() and "no" not in sink.status())
        receive, broken = sink._link.receive, Event()

        def breaks() -> bytes:
            if not broken.is_set():
                broken.set()
                assert sink.land(0)
                raise OSError("pulled out")
            return receive()

        sink._link.receive = breaks
        assert broken.wait(60)
        beats = len(peer.of("HEARTBEAT"))
        clock.now += 1.0
        assert eventually(lambda: len(peer.of("HEARTBEAT")) > beats)
        assert eventually(lambda: sink.land(1))
        assert eventually(lambda: [m.confirmation for m in _landings(peer)] == [1])
    finally:
        sink.close()


def _landings(peer: Peer) -> list:
    return [m for m in peer.of("COMMAND_LONG") if m.command == mavlink.MAV_CMD_NAV_LAND]
