"""Links: serial lines and UDP, with nothing of MAVLink."""

from __future__ import annotations

import os
import pty
import socket

import pytest
from patience import eventually

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")


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
