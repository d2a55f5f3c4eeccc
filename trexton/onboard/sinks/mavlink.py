"""MAVLink as a sink. A thread keeps talking with the autopilot, whatever the loop is busy with."""

from __future__ import annotations

import select
import threading
import time
from collections.abc import Iterator
from itertools import count
from typing import Any

from trexton.base.errors import ParameterError
from trexton.flights.aiding import Aiding
from trexton.onboard.fix import Fix
from trexton.onboard.mavlink.link import make_link
from trexton.onboard.settings import MavlinkOptions
from trexton.onboard.sinks import Check, Sink, Surroundings

FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0
WAIT = 0.005  # seconds that a position may wait for the wire; its stamp does not change
MARKERS = b"\xfe\xfd"  # first byte of a message
MIN_MESSAGE_BYTES = 8  # bytes; what the parser waits for before it knows more
MOST_UNREAD = 500  # bytes in which no message is found, before it is said
_links = count()  # their numbers, in the order in which they are made
FUSED = {True: "has a position", False: "HAS NO POSITION", None: "does not say if it has one"}


class MavlinkSink(Sink):
    """A link and the conversation over it, by the clock that stamps live frames."""

    addresses = {
        "udpout:HOST:PORT": "MAVLink to one address",
        "udpin:HOST:PORT": "MAVLink on a port of ours, to the autopilot that speaks there",
        "serial:DEVICE:BAUD": "MAVLink on a serial line",
    }
    options = MavlinkOptions
    autopilot = True

    def __init__(self, address: str, options: MavlinkOptions, around: Surroundings):
        self.name, self._options = address, options
        self._tally, self._clock = around.tally, around.clock
        self._link = make_link(address)
        from trexton.onboard.mavlink.listener import Listener
        from trexton.onboard.mavlink.messages import PROFILES
        from trexton.onboard.mavlink.speaker import Speaker

        if options.landing_target and around.target is None:
            raise ParameterError("--landing-target sends the centre of a zone: add --land X,Y")
        target = around.target if options.landing_target else None
        profile = PROFILES[options.autopilot](around.local, around.area, options.place, target)
        listener = Listener(options.addressee, around.local, options.component_id, around.heard)
        self.speaker = Speaker(
            profile, around.motion_rate, listener, options.place,
            aiding=around.aiding, send_yaw=options.send_yaw,
        )  # fmt: skip
        self._codec = self._new_codec()
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None
        self.connected = False
        self._why = ""  # the link failed last, as it was said
        self._unread = 0  # bytes since the last message

    @classmethod
    def make(cls, address: str, options: MavlinkOptions, around: Surroundings) -> MavlinkSink:
        return cls(f"{around.kind}:{address}", options, around)

    def checks(self, now: float) -> Iterator[Check]:
        listener, options = self.speaker.listener, self._options
        heard = listener.present(now) and listener.certain
        yield Check("link", heard, f"{self.name}: {self._heard(now)}")
        place, wanted = listener.origin, options.place
        words = f"the autopilot has {place[0]:.7f}, {place[1]:.7f}" if place else "it has none"
        if wanted is not None:
            holds = listener.confirms(wanted)
            words = words if holds else f"given, and not confirmed: {words}"
        else:
            holds = place is not None or options.autopilot != "ardupilot"
            words = words if place else "not given: modes of a global position need --origin"
        yield Check("origin", holds, words)
        fused = listener.fused(now)
        yield Check("fused", fused is True, f"the autopilot {FUSED[fused]}")

    def open(self) -> None:
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"mavlink {self.name}", daemon=True)
        self._thread.start()

    def write(self, fix: Fix) -> None:
        with self._lock:
            self.speaker.tell(fix, self._clock())

    def land(self, confirmation: int) -> bool:
        """Command a landing; False while no autopilot obeys it, or it is in doubt which one."""
        with self._lock:
            return self.connected and self.speaker.land(confirmation, self._clock())

    def answers(self) -> list[int]:
        """The autopilot's answers to commands since this was last asked."""
        return self._drained(self.speaker.listener.answers)

    def news(self) -> list[dict[str, Any]]:
        return self._drained(self.speaker.listener.news)

    def _drained(self, queue: Any) -> list[Any]:
        with self._lock:
            drained = list(queue)
            queue.clear()
            return drained

    def phase(self) -> dict[str, object]:
        with self._lock:
            return self.speaker.listener.phase(self._clock())

    def aiding(self, time: float) -> Aiding | None:
        with self._lock:
            return self.speaker.listener.aiding(time)

    def status(self) -> str:
        with self._lock:
            listener, now = self.speaker.listener, self._clock()
            if not self.connected:
                return "no link"
            said = [self._heard(now)]
            if listener.present(now) and (fused := listener.fused(now)) is not None:
                said.append(FUSED[fused])
            if held := self.speaker.withheld:
                said.append(f"{held} withheld for want of attitude")
            return ", ".join(said)

    def _heard(self, now: float) -> str:
        listener = self.speaker.listener
        key = " or not signed by our key" * (self._options.sign_key is not None)
        why = f", but {self._unread} bytes that are no MAVLink{key}: look at wire, port, baud rate"
        why *= self._unread > MOST_UNREAD
        if listener.target is None:
            return "no autopilot heard" + why
        words = f"autopilot {listener.target[0]} "
        words += "heard" if listener.present(now) else "silent" + why
        if listener.signs and self._options.sign_key is None:
            words += ", SIGNS ITS MESSAGES: give --sign-key"
        doubt = "TWO OF ONE NUMBER" if listener.twins else "SEVERAL VEHICLES: give --target"
        return words + ("" if listener.certain else f", {doubt}")

    def close(self) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
            self._thread = None

    def _new_codec(self) -> Any:
        from trexton.onboard.mavlink.messages import Codec

        codec = Codec(None, srcSystem=1, srcComponent=self._options.component_id)
        codec.robust_parsing = True  # garbage on the wire is skipped, not raised
        if (key := self._options.key()) is not None:
            codec.signing.secret_key = key
            codec.signing.sign_outgoing = True
            codec.signing.link_id = next(_links) % 256  # an autopilot counts the stamps of each
            # Tens of microseconds since 2015, as the protocol counts; it must only ever grow. A
            # computer whose clock was never set begins there: it signs, and is refused if it did
            # so later before.
            codec.signing.timestamp = max(0, int((time.time() - 1420070400) * 1e5))
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
                    # What was commanded here and now must not go out there and then.
                    self.speaker.commands.clear()
                self._link.close()
            self._stop.wait(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _failed(self, why: str) -> None:
        """Count it, and say why: once until somebody is heard again, not at every attempt."""
        self._tally.count("link")
        if why != self._why:
            self._why = why
            with self._lock:
                self.speaker.listener.news.append({"event": "link failed", "why": why})

    def _exchange(self) -> None:
        """Say what is due, then listen until the next may be."""
        with self._lock:
            before, due = self.speaker.withheld, self.speaker.due(self._clock())
            self._tally.count("withheld", self.speaker.withheld - before)
        for message in due:
            self._link.send(message.pack(self._codec))
            self._codec.seq = (self._codec.seq + 1) % 256  # by whose gaps losses are counted
            self._tally.count(f"sent {message.get_type()}")
        select.select([self._link.fileno()], [], [], WAIT)
        messages = self._parsed(self._link.receive())
        with self._lock:
            now, listener = self._clock(), self.speaker.listener
            for message in messages:
                listener.hear(message, now)
            target = listener.target
        if messages:
            self._why = ""
        if self._codec.behind:  # our stamps set its clock, if it hears them
            self._codec.behind = False
            self._link.understood()
        if any((each.get_srcSystem(), each.get_srcComponent()) == target for each in messages):
            self._link.understood()  # another vehicle must not fly by what is ours
        if target is not None:
            self._codec.srcSystem = target[0]  # a companion shares the system of its vehicle

    def _parsed(self, data: bytes) -> list[Any]:
        if not data:
            return []
        # Half a message must not swallow the next; a bridge may cut one anywhere.
        if self._link.datagrams and data[0] in MARKERS:
            self._codec.buf, self._codec.buf_index = bytearray(), 0
            self._codec.expected_length = MIN_MESSAGE_BYTES
        parsed = self._codec.parse_buffer(data) or []
        foreign = ("BAD_DATA", "UNKNOWN_")
        messages = [each for each in parsed if not each.get_type().startswith(foreign)]
        self._unread = 0 if messages else self._unread + len(data)
        return messages
