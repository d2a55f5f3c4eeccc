"""MAVLink 2 signing: what is signed with our key counts, and nothing else does."""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress

import pytest
from onboard_tools import make_fix, surroundings
from onboard_tools import mavlink as mavlink_options
from patience import eventually

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import AUTOPILOT_HEARTBEAT, IN_AIR, Peer  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from trexton.base.errors import ParameterError  # noqa: E402
from trexton.onboard.sinks import open_sink  # noqa: E402

KEY, OTHER = bytes(range(32)), bytes(32)


def sign_with(codec: mavlink.MAVLink, key: bytes) -> mavlink.MAVLink:
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp = int((time.time() - 1420070400) * 1e5)
    return codec


@pytest.fixture
def peer():
    peer = Peer()
    yield peer
    peer.close()


@pytest.fixture
def sink(peer, tmp_path):
    (tmp_path / "key").write_bytes(KEY)
    options = mavlink_options(sign_key=str(tmp_path / "key"))
    sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(), options)
    sink.open()
    assert eventually(lambda: peer.address is not None)
    yield sink
    sink.close()


def test_the_key_is_known_to_both(peer, sink):
    sign_with(peer.codec, KEY)  # from now on what is not signed with it is not understood
    peer.received.clear()
    assert eventually(lambda: peer.of("HEARTBEAT"))
    assert all(message.get_signed() for message in peer.of("HEARTBEAT"))
    peer.send(AUTOPILOT_HEARTBEAT, IN_AIR)
    assert eventually(lambda: "autopilot 1 heard" in sink.status())
    sink.write(make_fix(time.monotonic(), (1.0, 2.0)))
    assert eventually(lambda: peer.of("VISION_POSITION_ESTIMATE"))
    assert sink.land(0) and eventually(
        lambda: any(message.command == 21 for message in peer.of("COMMAND_LONG"))
    )


@pytest.mark.parametrize("key", [None, OTHER])
def test_a_stranger_is_not_believed(peer, sink, key):
    stranger = mavlink.MAVLink(None, 1, 1)
    if key is not None:
        sign_with(stranger, key)
    own = sign_with(mavlink.MAVLink(None, 7, 1), KEY)
    for _ in range(3):
        peer.send(AUTOPILOT_HEARTBEAT.pack(stranger))
    peer.send(AUTOPILOT_HEARTBEAT.pack(own))  # comes last: the others were read before it
    assert eventually(lambda: "autopilot" in sink.status() and "heard" in sink.status())
    assert eventually(lambda: "autopilot 7 heard" in sink.status())
    assert "SEVERAL" not in sink.status()


def test_what_another_key_signs_does_not_make_our_own_old(peer, sink):
    """One forged stamp, an hour ahead, silenced the autopilot for that hour."""
    forger = sign_with(mavlink.MAVLink(None, 1, 1), OTHER)
    forger.signing.timestamp += 3600 * 10**5
    peer.send(AUTOPILOT_HEARTBEAT.pack(forger))
    time.sleep(0.1)
    peer.send(AUTOPILOT_HEARTBEAT.pack(sign_with(mavlink.MAVLink(None, 1, 1), KEY)))
    assert eventually(lambda: "autopilot 1 heard" in sink.status())


@pytest.mark.parametrize(("key", "answered"), [(KEY, True), (OTHER, False)])
def test_an_autopilot_whose_clock_is_behind_is_answered_until_it_has_ours(tmp_path, key, answered):
    (tmp_path / "key").write_bytes(KEY)
    options = mavlink_options(sign_key=str(tmp_path / "key"))
    autopilot = sign_with(mavlink.MAVLink(None, 1, 1), key)
    autopilot.signing.timestamp -= 3600 * 10**5
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        port = wire.getsockname()[1]
    sink = open_sink(f"udpin:127.0.0.1:{port}", surroundings(), options)
    sink.open()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            wire.settimeout(0.2)

            def heard() -> bool:
                wire.sendto(AUTOPILOT_HEARTBEAT.pack(autopilot), ("127.0.0.1", port))
                with suppress(TimeoutError, ConnectionError):
                    autopilot.parse_buffer(wire.recv(4096))  # which sets its clock
                return "autopilot 1 heard" in sink.status()

            assert (eventually(heard) if answered else any(heard() for _ in range(10))) is answered
    finally:
        sink.close()


def test_each_link_signs_as_a_link_of_its_own(tmp_path):
    (tmp_path / "key").write_bytes(KEY)
    around, options = surroundings(), mavlink_options(sign_key=str(tmp_path / "key"))
    sinks = [open_sink(f"udpout:127.0.0.1:{port}", around, options) for port in (14550, 14551)]
    assert len({sink._codec.signing.link_id for sink in sinks}) == 2


def test_an_autopilot_that_signs_and_gets_nothing_signed_is_told(peer):
    """It passed over all positions, and all that was said was that it had none."""
    sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings())
    sink.open()
    try:
        assert eventually(lambda: peer.of("HEARTBEAT"))
        peer.send(AUTOPILOT_HEARTBEAT.pack(sign_with(mavlink.MAVLink(None, 1, 1), KEY)))
        words = "autopilot 1 heard, SIGNS ITS MESSAGES: give --sign-key"
        assert eventually(lambda: sink.status() == words)
        peer.send(AUTOPILOT_HEARTBEAT)
        assert eventually(lambda: sink.status() == "autopilot 1 heard")
    finally:
        sink.close()


def test_a_computer_whose_clock_was_never_set_signs_all_the_same(peer, tmp_path, monkeypatch):
    sign_with(peer.codec, KEY).signing.timestamp = 0  # an autopilot that has no clock either
    monkeypatch.setattr("trexton.onboard.sinks.mavlink.time.time", lambda: 60.0)
    (tmp_path / "key").write_bytes(KEY)
    sink = open_sink(
        f"udpout:127.0.0.1:{peer.port}",
        surroundings(),
        mavlink_options(sign_key=str(tmp_path / "key")),
    )
    sink.open()
    try:
        assert eventually(lambda: peer.of("HEARTBEAT"))
        assert all(message.get_signed() for message in peer.of("HEARTBEAT"))
    finally:
        sink.close()


def test_a_pipe_is_no_key_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "key")
    (one,) = mavlink_options(sign_key=str(tmp_path / "key")).values()
    with pytest.raises(ParameterError, match="key: not a regular file: expected the key"):
        one.key()


def test_a_key_that_others_can_read_is_warned_of(tmp_path, capsys):
    (path := tmp_path / "key").write_bytes(KEY)
    for mode, warned in ((0o600, False), (0o640, True), (0o602, True)):
        path.chmod(mode)
        options = mavlink_options(sign_key=str(path))
        (one,) = options.values()
        assert one.key() == KEY
        assert ("others can read or write this key" in capsys.readouterr().err) is warned
