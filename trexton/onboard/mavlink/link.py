"""The wire under MAVLink: UDP, TCP or a serial line, none of which ever blocks or prints.

pymavlink's own connections retry with sleeps, print to standard output, and hide that a peer has
gone; its coding and parsing of messages is used as it is.
"""

from __future__ import annotations

import os
import socket
import termios
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress

from trexton.base.errors import ParameterError

__all__ = ["Link", "make_link"]

CONNECT_TIMEOUT = 1.0
PEER_TIMEOUT = 10.0  # seconds without a word after which a peer is forgotten
MAX_PEERS = 4


def make_link(address: str) -> Link:
    """The link, not yet open, at ``udpout:``, ``udpin:`` or ``tcp:`` HOST:PORT, or at
    ``serial:DEVICE:BAUD``."""
    kind, _, rest = address.partition(":")
    if kind == "serial":
        device, _, baud = rest.partition(":")
        speed = getattr(termios, f"B{baud or 921600}", None)
        if not device or speed is None:
            raise ParameterError(
                f"output {address!r}: give serial:DEVICE:BAUD with a usual rate, "
                "as in serial:/dev/ttyAMA0:921600"
            )
        return SerialLink(device, speed)
    host, _, port = rest.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ParameterError(
            f"output {address!r}: give {kind}:HOST:PORT, as in {kind}:127.0.0.1:14540"
        )
    links: dict[str, type[_SocketLink]] = {"udpout": UdpOut, "udpin": UdpIn, "tcp": TcpLink}
    return links[kind](host, int(port))


class Link(ABC):
    """Bytes out, bytes in; where a method raises `OSError`, the link is to be closed and opened
    again."""

    datagrams = False  # whether each piece received is whole in itself

    @abstractmethod
    def open(self) -> None: ...

    @abstractmethod
    def send(self, data: bytes) -> None: ...

    @abstractmethod
    def receive(self) -> bytes:
        """What has come, at most a few kilobytes; empty if nothing has."""

    def understood(self) -> None:  # noqa: B027 - only who has several peers cares
        """What `receive` gave last was MAVLink: its sender is a peer."""

    @abstractmethod
    def fileno(self) -> int: ...

    @abstractmethod
    def close(self) -> None: ...


class _SocketLink(Link):
    def __init__(self, host: str, port: int):
        self.address = (host, port)
        self._opened: socket.socket | None = None

    @property
    def _socket(self) -> socket.socket:
        if self._opened is None:
            raise OSError("the link is not open")
        return self._opened

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> bytes:
        try:
            return self._socket.recv(65536)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        if self._opened is not None:
            self._opened.close()
            self._opened = None


class UdpOut(_SocketLink):
    """Datagrams to one address; connected, so that a peer that has gone is heard of.

    Our port stays the same when the link is opened again: PX4 goes on answering the first it has
    seen.
    """

    datagrams = True
    _port = 0

    def open(self) -> None:
        self._opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("", self._port))
        self._socket.connect(self.address)
        self._port = self._socket.getsockname()[1]

    def send(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # the buffer is full: the next position is the better one
            self._socket.send(data)


class UdpIn(_SocketLink):
    """Datagrams on a port of ours, answered to everybody who lately spoke MAVLink there."""

    datagrams = True

    def __init__(self, host: str, port: int, clock: Callable[[], float] = time.monotonic):
        super().__init__(host, port)
        self._clock = clock
        self._peers: dict[tuple[str, int], float] = {}
        self._sender: tuple[str, int] | None = None

    def open(self) -> None:
        self._peers.clear()
        self._opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(self.address)

    def send(self, data: bytes) -> None:
        for peer in list(self._peers):
            with suppress(OSError):  # one that has gone must not keep the others from hearing
                self._socket.sendto(data, peer)

    def receive(self) -> bytes:
        try:
            data, self._sender = self._socket.recvfrom(65536)
            return data
        except BlockingIOError:
            return b""

    def understood(self) -> None:  # noqa: B027 - only who has several peers cares
        now = self._clock()
        if self._sender is not None:
            self._peers.pop(self._sender, None)
            self._peers[self._sender] = now
        fresh = [(peer, at) for peer, at in self._peers.items() if now - at <= PEER_TIMEOUT]
        self._peers = dict(fresh[-MAX_PEERS:])


class TcpLink(_SocketLink):
    """A stream to a server."""

    def open(self) -> None:
        self._opened = socket.create_connection(self.address, CONNECT_TIMEOUT)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        # Half a message would garble the next, and a peer that reads nothing is as good as gone.
        if self._socket.send(data) < len(data):
            raise ConnectionError("the peer reads too slowly")

    def receive(self) -> bytes:
        try:
            data = self._socket.recv(65536)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionError("the peer has closed the connection")
        return data


class SerialLink(Link):
    """A serial line, 8 bits, no parity, no flow control."""

    def __init__(self, device: str, speed: int):
        self.device, self._speed = device, speed
        self._opened: int | None = None

    @property
    def _descriptor(self) -> int:
        if self._opened is None:
            raise OSError("the link is not open")
        return self._opened

    def open(self) -> None:
        self._opened = os.open(self.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(self._descriptor)
            settings = termios.tcgetattr(self._descriptor)
            settings[2] = (settings[2] | termios.CLOCAL | termios.CREAD) & ~termios.CRTSCTS
            settings[4] = settings[5] = self._speed
            termios.tcsetattr(self._descriptor, termios.TCSANOW, settings)
        except termios.error as error:
            self.close()
            raise OSError(f"{self.device}: {error.args[-1]}") from None

    def fileno(self) -> int:
        return self._descriptor

    def send(self, data: bytes) -> None:
        if os.write(self._descriptor, data) < len(data):
            raise OSError(f"{self.device}: takes no more: lower the rate or raise the baud rate")

    def receive(self) -> bytes:
        try:
            return os.read(self._descriptor, 65536)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        if self._opened is not None:
            os.close(self._opened)
            self._opened = None
