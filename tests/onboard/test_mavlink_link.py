"""Links: serial lines and UDP, with nothing of MAVLink."""

from __future__ import annotations

import os
import pty
import socket

import pytest
from patience import eventually

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")


from trexton.base.errors import ParameterError  # noqa: E402
from trexton.onboard.mavlink.link import make_link  # noqa: E402


def test_serial_line():
    ours, theirs = pty.openpty()
    link = make_link(f"serial:{os.ttyname(theirs)}:115200")
    link.open()
    try:
        link.send(b"\xfd\x00\r\n\x11")
        assert os.read(ours, 100) == b"\xfd\x00\r\n\x11"  # raw: nothing translated
        os.write(ours, b"\x03\x04\xff")
        assert eventually(lambda: link.receive() == b"\x03\x04\xff")
        assert link.receive() == b""
    finally:
        link.close()
        os.close(ours)
        os.close(theirs)


def test_a_serial_device_may_have_colons_and_a_rate_is_a_number():
    link = make_link("serial:/dev/serial/by-path/pci-0000:01:00.0-usb-0:1.1:1.0-port0:57600")
    assert link.device == "/dev/serial/by-path/pci-0000:01:00.0-usb-0:1.1:1.0-port0"
    assert make_link("serial:/dev/ttyAMA0").device == "/dev/ttyAMA0"
    for rate in ("0", "RKINT", "1.0-port0", "57601", ""):
        with pytest.raises(ParameterError, match="a usual rate"):
            make_link(f"serial:/dev/ttyAMA0:{rate}")
    with pytest.raises(ParameterError, match="HOST:PORT"):
        make_link("udpout:127.0.0.1:\u0663")


def test_of_two_readers_of_a_serial_line_the_second_is_told():
    ours, theirs = pty.openpty()
    first, second = (make_link(f"serial:{os.ttyname(theirs)}") for _ in range(2))
    first.open()
    with pytest.raises(OSError, match="locked by another"):
        second.open()
    first.close()
    second.open()
    second.close()
    os.close(ours)
    os.close(theirs)


def test_no_such_serial_line_is_an_os_error():
    with pytest.raises(OSError):
        make_link("serial:/dev/no-such-line").open()


def test_udpin_answers_whoever_speaks():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = make_link(f"udpin:127.0.0.1:{port}")
    link.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.settimeout(120)
        link.send(b"nobody is there")
        other.sendto(b"hello", ("127.0.0.1", port))
        assert eventually(lambda: link.receive() == b"hello")
        link.understood()
        link.send(b"answer")
        assert other.recv(100) == b"answer"
    link.close()
