"""MAVLink: a thread that keeps the conversation with the autopilot going, whatever the loop is busy
with."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options, option
from trexton.flights.aiding import Aiding
from trexton.onboard.fix import Fix
from trexton.onboard.mavlink.link import Link, make_link
from trexton.onboard.sinks.base import Sink, Surroundings
from trexton.onboard.tally import Tally

if TYPE_CHECKING:
    from trexton.onboard.mavlink.speaker import Speaker

__all__ = ["MavlinkOptions", "MavlinkSink"]

FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0
MAX_WAIT = 0.05
KEY_BYTES = 32
MIN_MESSAGE_BYTES = 8  # bytes; what the parser waits for before it knows more
ORIGIN_LIMITS = ((-90.0, 90.0), (-180.0, 180.0), (-1000.0, 10_000.0))  # degrees, degrees, metres


@dataclass(frozen=True)
class MavlinkOptions(Options):
    """Autopilot over MAVLink"""

    autopilot: str = option("px4", "whose messages are sent", choices=("px4", "ardupilot"))
    system_id: int | None = option(
        None, "our vehicle's number; needed where more than one is heard", low=1, high=255
    )
    origin: str | None = option(
        None, "LAT,LON,ALT in degrees and metres: set as the autopilot's global origin"
    )
    sign_key: str | None = option(
        None, "file of 32 bytes: sign every message, and believe only what is signed with it"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.place  # checked now, not in the air

    @property
    def place(self) -> tuple[float, float, float] | None:
        """The origin as numbers; raises `ParameterError`."""
        if self.origin is None:
            return None
        try:
            latitude, longitude, altitude = map(float, self.origin.split(","))
        except ValueError:
            raise ParameterError(
                f"origin {self.origin!r}: expected LAT,LON,ALT, as in 51.9906,4.3768,0"
            ) from None
        for value, (low, high) in zip((latitude, longitude, altitude), ORIGIN_LIMITS, strict=True):
            if not low <= value <= high:
                raise ParameterError(
                    f"origin {self.origin}: {value:g} is not within {low:g} to {high:g}: "
                    "give latitude and longitude in degrees, altitude in metres"
                )
        return latitude, longitude, altitude

    def key(self) -> bytes | None:
        """The key to sign with; raises `ParameterError`."""
        if self.sign_key is None:
            return None
        try:
            key = Path(self.sign_key).read_bytes()
        except OSError as error:
            raise ParameterError(
                f"{self.sign_key}: the key cannot be read ({error.strerror})"
            ) from None
        if len(key) != KEY_BYTES:
            raise ParameterError(f"{self.sign_key}: {len(key)} bytes: a key has {KEY_BYTES}")
        return key


class MavlinkSink(Sink):
    """A link and the conversation over it.

    Parameters
    ----------
    address : str
    link : Link
    speaker : Speaker
    tally : Tally
    key : bytes, optional
        To sign messages with.
    clock : callable
        Seconds, the clock that stamps live frames.
    """

    addresses = {
        "udpout:HOST:PORT": "MAVLink to one address",
        "udpin:HOST:PORT": "MAVLink on a port of ours, to whoever speaks MAVLink there",
        "tcp:HOST:PORT": "MAVLink to a server",
        "serial:DEVICE:BAUD": "MAVLink on a serial line",
    }
    options = MavlinkOptions
    autopilot = True

    def __init__(
        self,
        address: str,
        link: Link,
        speaker: Speaker,
        tally: Tally,
        key: bytes | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.name = address
        self._link, self.speaker, self._tally, self._clock = link, speaker, tally, clock
        self._key = key
        self._options = MavlinkOptions()
        self._codec = self._new_codec()
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._alarm, self._bell = socket.socketpair()  # a new fix ends the thread's wait
        self._alarm.setblocking(False)
        self._bell.setblocking(False)
        self._thread: threading.Thread | None = None
        self._shift = 0.0  # from our clock to the one that stamps the frames
        self.connected = self._was_present = False
        self._why = ""  # the link failed last, as it was said

    @classmethod
    def make(cls, address: str, options: MavlinkOptions, around: Surroundings) -> MavlinkSink:
        address = f"{around.kind}:{address}"
        link = make_link(address)
        try:
            from trexton.onboard.mavlink.listener import Listener
            from trexton.onboard.mavlink.speaker import PROFILES, Speaker
        except ImportError:
            raise ParameterError(
                "MAVLink needs the package pymavlink: pip install 'trexton[mavlink]'"
            ) from None
        profile = PROFILES[options.autopilot](around.local, around.area)
        listener = Listener(options.system_id, around.local)
        speaker = Speaker(
            profile, around.motion_rate, listener, options.place, aiding=around.aiding
        )
        sink = cls(address, link, speaker, around.tally, options.key(), around.clock)
        sink._options = options
        return sink

    @property
    def lander(self) -> MavlinkSink:
        """Itself: it commands the landing, and hears the answer."""
        return self

    def checks(self, now: float) -> Iterator[tuple[str, bool, str]]:
        listener, options = self.speaker.listener, self._options
        heard = listener.present(now) and listener.certain
        words = f"autopilot {listener.target[0]} heard" if listener.target else "no autopilot heard"
        words += ", silent since" if listener.target and not listener.present(now) else ""
        words += "" if listener.certain or not listener.target else ": several, give --system-id"
        yield "link", heard, f"{self.name}: {words}"
        place = listener.origin or options.place
        words = f"{place[0]:.7f}, {place[1]:.7f}" if place else "not given: add --origin"
        needed = options.autopilot == "ardupilot"
        words += "" if place or needed else " for modes that need a global position"
        yield "origin", bool(place) or not needed, words
        fused = listener.fused(now)
        words = {
            True: "the autopilot has a position",
            False: "the autopilot HAS NO POSITION",
            None: "the autopilot does not say whether it has a position",
        }[fused]
        yield "fused", fused is True, words

    def open(self) -> None:
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"mavlink {self.name}", daemon=True)
        self._thread.start()

    def write(self, fix: Fix) -> None:
        with self._lock:
            self._shift = fix.clock_ahead  # a replay has its own time
            self.speaker.tell(fix, self._now())
        self._wake()

    def land(self, confirmation: int) -> bool:
        """Command a landing; False while no autopilot is there to obey it, or it is in doubt which
        one would."""
        with self._lock:
            queued = self.connected and self.speaker.land(confirmation, self._now())
        self._wake()
        return queued

    def answers(self) -> list[Any]:
        """The autopilot's answers to commands since this was last asked."""
        with self._lock:
            return _drained(self.speaker.listener.answers)

    def news(self) -> list[dict[str, Any]]:
        with self._lock:
            return _drained(self.speaker.listener.news)

    def on_ground(self) -> bool | None:
        """Whether the autopilot says that the vehicle stands; None where it does not say."""
        with self._lock:
            return self.speaker.listener.on_ground(self._now())

    def aiding(self, time: float) -> Aiding | None:
        with self._lock:
            return self.speaker.listener.aiding(time)

    def status(self) -> str:
        with self._lock:
            listener, now = self.speaker.listener, self._now()
            if not self.connected:
                return "no link"
            if listener.target is None:
                return "no autopilot heard"
            if not listener.present(now):
                return "autopilot silent"
            words = {None: "", True: ", has a position", False: ", HAS NO POSITION"}
            held = self.speaker.withheld
            return (
                f"autopilot {listener.target[0]} heard"
                + words[listener.fused(now)]
                + ("" if listener.certain else ", SEVERAL VEHICLES: give --system-id")
                + (f", {held} withheld for want of attitude" if held else "")
            )

    def close(self) -> None:
        self._stop.set()
        self._wake()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
            self._thread = None

    def _wake(self) -> None:
        try:
            self._bell.send(b"!")
        except BlockingIOError:
            pass  # it has been rung often enough

    def _now(self) -> float:
        return self._clock() + self._shift

    def _new_codec(self) -> Any:
        from trexton.onboard.mavlink.messages import COMPONENT, mavlink

        codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=COMPONENT)
        codec.robust_parsing = True  # garbage on the wire is skipped, not raised
        if self._key is not None:
            codec.signing.secret_key = self._key
            codec.signing.sign_outgoing = True
            # Tens of microseconds since 2015, as the protocol counts; it must only ever grow.
            codec.signing.timestamp = int((time.time() - 1420070400) * 1e5)
        return codec

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._stop.is_set():
            try:
                self._link.open()
                self.connected = True
                while not self._stop.is_set():
                    self._exchange()
                    pause = FIRST_PAUSE
            except OSError as error:
                self._failed(error.strerror or str(error))
            except Exception as error:  # a bug must not end the conversation, nor go unsaid
                self._failed(f"{type(error).__name__}: {error}")
            finally:
                with self._lock:
                    self.connected = False
                    self.speaker.forget_commands()
                self._link.close()
            self._stop.wait(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _failed(self, why: str) -> None:
        """Count it, and say why: once until somebody is heard again, not at every attempt."""
        self._tally.fault("link")
        if why != self._why:
            self._why = why
            with self._lock:
                self.speaker.listener.news.append({"event": "link failed", "why": why})

    def _exchange(self) -> None:
        """Say what is due, then listen until the next may be."""
        with self._lock:
            now = self._now()
            due = self.speaker.due(now)
            wait = min(self.speaker.next_due(now), MAX_WAIT)
        for message in due:
            self._link.send(message.pack(self._codec))
            self._tally.count(f"sent {message.get_type()}")
        ready, _, _ = select.select([self._link.fileno(), self._alarm.fileno()], [], [], wait)
        if self._alarm.fileno() in ready:
            self._alarm.recv(4096)
        messages = self._parsed(self._link.receive())
        with self._lock:
            now, listener = self._now(), self.speaker.listener
            for message in messages:
                listener.hear(message, now)
            present, target = listener.present(now), listener.target
        if messages:
            self._why = ""
        if target is not None:
            self._codec.srcSystem = target[0]  # a companion shares the system of its vehicle
        if self._was_present and not present:
            self._tally.fault("silent")
        self._was_present = present

    def _parsed(self, data: bytes) -> list[Any]:
        if not data:
            return []
        if self._link.datagrams:  # half a message in one must not swallow the next
            self._codec.buf, self._codec.buf_index = bytearray(), 0
            self._codec.expected_length = MIN_MESSAGE_BYTES
        parsed = self._codec.parse_buffer(data) or []
        messages = [message for message in parsed if message.get_type() != "BAD_DATA"]
        if messages:
            self._link.understood()
        return messages


def _drained(queue: Any) -> list[Any]:
    drained = list(queue)
    queue.clear()
    return drained
