"""Paparazzi, the paper's own autopilot: REMOTE_GPS_LOCAL on its Ivy bus.

The fields are those of the datalink message in Paparazzi's message definitions: aircraft, padding,
east, north, up in metres, their speeds, time of week in milliseconds, course in degrees. Speeds and
course are zero: nothing measures them, and the message knows no "unknown", so the aircraft must not
be set to use them.
"""

from __future__ import annotations

import ipaddress
import logging
import socket
from contextlib import suppress
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.sinks.base import NewestSink, Surroundings, extra

__all__ = ["PaparazziSink", "remote_gps_local"]

BUS = "127.255.255.255:2010"  # Paparazzi's own default
WEEK_MS = 7 * 24 * 3600 * 1000


def remote_gps_local(fix: Fix, aircraft: int, local: LocalFrame) -> str:
    """The message as the bus carries it: class, name, fields."""
    east, north, up = local.enu(fix.position)
    tow = round(1000 * fix.time) % WEEK_MS
    place = f"{east:.4f} {north:.4f} {up:.4f}"
    return f"datalink REMOTE_GPS_LOCAL {aircraft} 0 {place} 0.0 0.0 0.0 {tow} 0.0"


class PaparazziSink(NewestSink):
    """The bus finds its readers itself, whenever they come; one that sleeps makes it wait.

    Raises
    ------
    ParameterError
        The extra is not installed, or the bus is none.
    """

    autopilot = True
    addresses = {
        "paparazzi:AIRCRAFT": f"Paparazzi's Ivy bus at {BUS}",
        "paparazzi:AIRCRAFT@BUS": "the same on another bus, as in `7@192.168.1.255:2010`",
    }

    def __init__(self, aircraft: int, local: LocalFrame, bus: str = BUS):
        with extra("Paparazzi", "ivy-python", "paparazzi"):
            from ivy.ivy import IvyServer
        logging.getLogger("Ivy").setLevel(logging.ERROR)
        self.name = f"paparazzi:{aircraft}"
        self._make_server = _bus_agent(IvyServer, _our_address(bus))
        self._aircraft, self._local, self._bus = aircraft, local, bus
        self._server: Any = None
        self._readers = 0

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> PaparazziSink:
        aircraft, _, bus = address.partition("@")
        if not aircraft.isdecimal() or int(aircraft) > 255:
            raise ParameterError(
                f"output 'paparazzi:{address}': give paparazzi:AIRCRAFT, a number from 0 to 255, "
                f"and @BUS where it is not {BUS}"
            )
        return cls(int(aircraft), around.local, bus or BUS)

    def connect(self) -> None:
        self._server = self._make_server("trexton", "trexton ready", usesDaemons=True)
        self._server.start(self._bus)

    def made(self, fix: Fix) -> str:
        return remote_gps_local(fix, self._aircraft, self._local)

    def deliver(self, item: str) -> None:
        self._readers = self._server.send_msg(item)

    def status(self) -> str:
        return f"{self._readers} on the bus listen"

    def disconnect(self) -> None:
        if self._server.isAlive():
            self._server.stop()
        self._server.server_close()


def _our_address(bus: str) -> str:
    """The address at which we are reached from a bus: connections are taken there and nowhere else.

    Raises
    ------
    ParameterError
        The bus is no address and port.
    """
    host, colon, port = bus.rpartition(":")
    try:
        ipaddress.IPv4Address(host)
        number = int(port)
    except ValueError:
        number = 0
    if not colon or not 0 < number < 65536:
        raise ParameterError(f"bus {bus!r}: give a broadcast address and a port, as in {BUS}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        try:
            probe.connect((host, number))
        except OSError as error:
            raise ParameterError(
                f"bus {bus}: no way there ({error.strerror}): check the network"
            ) from None
        ours: str = probe.getsockname()[0]
    return ours


def _bus_agent(server: type[Any], host: str) -> type[Any]:
    """Ivy's server, bound to one address, and with each other agent served once.

    Two agents that find each other at the same moment connect twice, once from either side. Every
    connection carries the subscriptions; a message must still arrive once, so of the connections of
    one agent, known by its address and the port it announces, only the first is written to.
    """
    from ivy.ivy import START_INIT, IvyHandler, IvyMalformedMessage, decode_msg

    class Handler(IvyHandler):  # type: ignore[misc]
        def process_ivymessage(self, msg: str, client: Any) -> bool:
            with suppress(IvyMalformedMessage):
                kind, number, _ = decode_msg(msg)
                if kind == START_INIT:
                    client.announced = number
            kept: bool = super().process_ivymessage(msg, client)
            return kept

    class Agent(server):  # type: ignore[misc]
        def __init__(self, *args: Any, **options: Any):
            super().__init__(*args, **options)
            self.RequestHandlerClass = Handler

        def server_bind(self) -> None:
            self.server_address: tuple[str, int] = (host, 0)
            super().server_bind()

        def send_msg(self, message: str, *, to: Any = None) -> int:
            served: dict[tuple[object, ...], Any] = {}
            with self._global_lock:
                bindings = list(self._clients_bindings.values())
            for binding in bindings:
                match = binding.pattern.match(message)
                for client, number in binding.clients if match else ():
                    if to not in (None, client):
                        continue
                    agent = (client.ip, getattr(client, "announced", client))
                    if served.setdefault(agent, client) is client:
                        client.send_message(number, match.groups(default=""))
            return len(served)

    return Agent
