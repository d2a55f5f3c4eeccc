"""``trexton play FLIGHT --map MAP``: a flight frame by frame in a browser."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import partial
from http.server import BaseHTTPRequestHandler, HTTPServer, ThreadingHTTPServer

from trexton.base.arguments import add_options, chosen_options
from trexton.base.defaults import SAMPLES
from trexton.base.errors import ParameterError
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.localization.map_files import load_map

__all__ = ["add_arguments", "run"]


@dataclass(frozen=True)
class PlayOptions(Options):
    """How the flight is replayed and served."""

    samples: int = option(SAMPLES, "patches of a frame, 0 for all", low=0)
    frames: int = option(180, "to show", low=1)
    seed: int = option(1, "of the samples and the particles", low=0)
    port: int = option(
        0, "to serve on, of this machine only; 0 takes a free one", low=0, high=65535
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", help="flight folder; its test split is played where it has one")
    parser.add_argument("--map", required=True, metavar="MAP", help="the texton map (.npz)")
    parser.add_argument(
        "--method", action="append", metavar="NAME",
        help="a method that the map was trained for, repeatable; the first is shown in detail "
        "(default: the map's own)",
    )  # fmt: skip
    add_options(parser, PlayOptions)
    parser.add_argument(
        "--out", metavar="FILE", help="write the page to this file instead of serving it"
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.files import atomic_file, check_not_read, check_writable
    from trexton.base.streams import stream
    from trexton.companion.player.page import player_html
    from trexton.companion.player.playback import record_replay
    from trexton.flights import read_flight
    from trexton.localization.localizer import Localizer

    asked = chosen_options(arguments, PlayOptions)
    if arguments.out:
        check_not_read(arguments.out, arguments.map, arguments.flight)
        check_writable(arguments.out)
    else:
        serve("", asked.port).server_close()  # before the flight is replayed
    texton_map = load_map(arguments.map)
    flight = read_flight(arguments.flight).part_or_all("test")
    localizers = {
        name or texton_map.method: Localizer(
            texton_map,
            method=name,
            samples=asked.samples or None,
            rng=stream(asked.seed, "flight", 0),
        )
        for name in arguments.method or [None]
    }
    say(f"replaying {len(flight)} frames of {flight.name}")
    page = player_html(record_replay(localizers, flight, most_frames=asked.frames))
    if arguments.out:
        with atomic_file(arguments.out) as out:
            out.write(page)
        say(f"the player is {arguments.out}: open it in a browser")
        return 0
    with serve(page, asked.port) as server:
        print(f"http://127.0.0.1:{server.server_port}/ (Ctrl-C ends)", flush=True)
        server.serve_forever()
    return 0


def serve(page: str, port: int = 0) -> HTTPServer:
    """A server of one page on this machine, to be started with ``serve_forever``; raises
    `ParameterError` where the port is not to be had."""
    try:
        return _Server(("127.0.0.1", port), partial(_Handler, page.encode()))
    except OSError as error:
        raise ParameterError(
            f"--port {port}: {error.strerror}: give another, or leave it out for a free one"
        ) from None


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: object, client_address: object) -> None:
        """A tab that was closed while it loaded is no fault to tell of."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


class _Handler(BaseHTTPRequestHandler):
    def __init__(self, page: bytes, *arguments: object):
        self._page = page
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        exists = self.path.split("?")[0] == "/"
        answer = self._page if exists else b"no such page"
        self.send_response(200 if exists else 404)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, format: str, *arguments: object) -> None:
        """The terminal belongs to the person."""
