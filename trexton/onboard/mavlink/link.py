"""The wire under MAVLink: UDP or a serial line, neither of which ever blocks or prints.

pymavlink's own connections retry with sleeps, print to standard output, and hide that a peer has
gone; its coding and parsing of messages is used as it is.
"""

from __future__ import annotations

import fcntl
import os
import socket
import termios
import tty
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Any

from trexton.base.errors import ParameterError

MAX_PEERS = 4


def make_link(address: str) -> Link:
    """The link, not yet open, at ``udpout:HOST:PORT``, ``udpin:`` or ``serial:DEVICE:BAUD``."""
    kind, _, rest = address.partition(":")
    if kind == "serial":
        # A device may have colons of its own, as those by path have.
        device, _, baud = (rest if ":" in rest else f"{rest}:921600").rpartition(":")
        speed = getattr(termios, f"B{baud}", 0) if baud.isdecimal() else 0
        if not device or not speed:
            raise ParameterError(
                f"output {address!r}: give serial:DEVICE:BAUD with a usual rate, "
                "as in serial:/dev/ttyAMA0:921600"
            )
        return SerialLink(device, speed)
    host, _, port = rest.rpartition(":")
    if not host or not (port.isascii() and port.isdecimal()) or not 0 < int(port) < 65536:
        raise ParameterError(
            f"output {address!r}: give {kind}:HOST:PORT, as in {kind}:127.0.0.1:14540"
        )
    return (UdpOut if kind == "udpout" else UdpIn)(host, int(port))


class Link(ABC):
    """Bytes out, bytes in; where a method raises `OSError`, the link is to be closed and opened
    again."""

    datagrams = True  # whether each piece received is whole in itself
    _wire: Any = None  # a socket or a file, while it is open

    @abstractmethod
    def open(self) -> None: ...

    @abstractmethod
    def send(self, data: bytes) -> None: ...

    @abstractmethod
    def receive(self) -> bytes:
        """What has come, at most a few kilobytes; empty if nothing has."""

    def understood(self) -> None:  # noqa: B027 - only who has several peers cares
        """What `receive` gave last was said by our autopilot: its sender is a peer."""

    def fileno(self) -> int:
        """For `select`."""
        return self._wire.fileno()

    def close(self) -> None:
        """Let go of it; it may be opened again."""
        if self._wire is not None:
            self._wire.close()
            self._wire = None


class UdpOut(Link):
    """Datagrams to one address; connected, so that a peer that has gone is heard of.

    Our port stays the same when the link is opened again: PX4 goes on answering the first it has
    seen.
    """

    def __init__(self, host: str, port: int):
        self.address, self._port = (host, port), 0
        self._sender: tuple[str, int] | None = None

    def open(self) -> None:
        self._wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._wire.setblocking(False)
        self._wire.bind(("", self._port))
        self._wire.connect(self.address)
        self._port = self._wire.getsockname()[1]

    def send(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # the buffer is full: the next position is the better one
            self._wire.send(data)

    def receive(self) -> bytes:
        try:
            data, self._sender = self._wire.recvfrom(65536)
            return bytes(data)
        except BlockingIOError:
            return b""


class UdpIn(UdpOut):
    """Datagrams on a port of ours, answered to the latest few who brought our autopilot's."""

    _peers: list[tuple[str, int]] = []

    def open(self) -> None:
        self._peers = []
        self._wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._wire.setblocking(False)
        self._wire.bind(self.address)

    def send(self, data: bytes) -> None:
        for peer in self._peers:
            with suppress(OSError):  # one that has gone must not keep the others from hearing
                self._wire.sendto(data, peer)

    def understood(self) -> None:
        others = [peer for peer in self._peers if peer != self._sender]
        if self._sender is not None:
            self._peers = [*others, self._sender][-MAX_PEERS:]


class SerialLink(Link):
    """A serial line, 8 bits, no parity, no flow control."""

    datagrams = False

    def __init__(self, device: str, speed: int):
        self.device, self._speed = device, speed

    def open(self) -> None:
        line = os.open(self.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._wire = os.fdopen(line, "r+b", buffering=0)
        try:
            fcntl.flock(line, fcntl.LOCK_EX | fcntl.LOCK_NB)  # of two readers each gets half
            tty.setraw(line)
            settings = termios.tcgetattr(line)
            settings[2] = (settings[2] | termios.CLOCAL | termios.CREAD) & ~termios.CRTSCTS
            settings[4] = settings[5] = self._speed
            termios.tcsetattr(line, termios.TCSANOW, settings)
        except (OSError, termios.error) as error:
            self.close()
            why = "locked by another" if isinstance(error, BlockingIOError) else error.args[-1]
            raise OSError(f"{self.device}: {why}") from None

    def send(self, data: bytes) -> None:
        # Half a message would garble the next.
        if (self._wire.write(data) or 0) < len(data):
            raise OSError(f"{self.device}: takes no more: lower the rate or raise the baud rate")

    def receive(self) -> bytes:
        return self._wire.read(65536) or b""
