"""MAVLink: a thread that keeps the conversation with the autopilot going, whatever the loop is busy with."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable

from trexton.errors import ParameterError
from trexton.onboard.fix import Fix
from trexton.onboard.mavlink.link import Link, make_link
from trexton.onboard.sinks.base import Sink, SinkOptions
from trexton.onboard.tally import Tally

__all__ = ["MavlinkSink", "make"]

FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0
LONGEST_WAIT = 0.05


def make(address: str, options: SinkOptions) -> Sink:
    link = make_link(address)
    try:
        from trexton.onboard.mavlink.profiles import profile_named
        from trexton.onboard.mavlink.speaker import Speaker
    except ImportError:
        raise ParameterError(
            "MAVLink needs the package pymavlink: pip install 'trexton[mavlink]'"
        ) from None
    profile = profile_named(options.autopilot, options.local, options.area)
    return MavlinkSink(
        address, link, Speaker(profile, options.motion_rate, options.origin), options.tally
    )


class MavlinkSink(Sink):
    """A link and the conversation over it.

    Parameters
    ----------
    address : str
    link : Link
    speaker : Speaker
    tally : Tally
    clock : callable
        Seconds, the clock that stamps live frames.
    """

    def __init__(
        self,
        address: str,
        link: Link,
        speaker,
        tally: Tally,
        clock: Callable[[], float] = time.monotonic,
    ):
        from trexton.onboard.mavlink.messages import COMPONENT, mavlink

        self.name = address
        self._link, self._speaker, self._tally, self._clock = link, speaker, tally, clock
        self._codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=COMPONENT)
        self._codec.robust_parsing = True  # garbage on the wire is skipped, not raised
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._alarm, self._bell = socket.socketpair()  # a new fix ends the thread's wait
        self._alarm.setblocking(False)
        self._bell.setblocking(False)
        self._thread: threading.Thread | None = None
        self._shift = (
            0.0  # from our clock to the one that stamps the frames; zero for a live camera
        )
        self.connected = self._was_present = False

    def open(self) -> None:
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"mavlink {self.name}", daemon=True)
        self._thread.start()

    def write(self, fix: Fix) -> None:
        with self._lock:
            # A replay has its own time: the fix was captured `latency` ago by either clock.
            shift = fix.time + fix.latency - self._clock()
            self._shift = shift if abs(shift) > 0.5 else 0.0
            self._speaker.tell(fix, self._now())
        self._wake()

    def land(self, confirmation: int) -> bool:
        """Command a landing; False while no autopilot is there to obey it."""
        with self._lock:
            heard = (
                self.connected
                and self._speaker.present(self._now())
                and self._speaker.land(confirmation)
            )
        self._wake()
        return heard

    def answers(self) -> list:
        """The autopilot's answers to commands since this was last asked."""
        return self._drain("answers")

    def news(self) -> list[dict]:
        """What the autopilot said since this was last asked, for the log."""
        return self._drain("news")

    def _drain(self, what: str) -> list:
        with self._lock:
            queue = getattr(self._speaker, what)
            drained = list(queue)
            queue.clear()
            return drained

    def status(self) -> str:
        with self._lock:
            if not self.connected:
                return "no link"
            if self._speaker.target is None:
                return "no autopilot heard"
            if not self._speaker.present(self._now()):
                return "autopilot silent"
            words = {None: "", True: ", has a position", False: ", HAS NO POSITION"}[
                self._speaker.fused
            ]
            held = (
                f", {self._speaker.withheld} withheld for want of attitude"
                if self._speaker.withheld
                else ""
            )
            return f"autopilot {self._speaker.target[0]} heard{words}{held}"

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

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._stop.is_set():
            try:
                self._link.open()
                self.connected = True
                while not self._stop.is_set():
                    self._exchange()
                    pause = FIRST_PAUSE
            except OSError:
                self._tally.fault("link")
            finally:
                self.connected = False
                self._link.close()
            self._stop.wait(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _exchange(self) -> None:
        """Say what is due, then listen until the next may be."""
        with self._lock:
            now = self._now()
            due = self._speaker.due(now)
            wait = min(self._speaker.next_due(now), LONGEST_WAIT)
        for message in due:
            self._link.send(message.pack(self._codec))
            self._tally.count(f"sent {message.get_type()}")
        ready, _, _ = select.select([self._link, self._alarm], [], [], wait)
        if self._alarm in ready:
            self._alarm.recv(4096)
        messages = self._codec.parse_buffer(self._link.receive()) or []
        with self._lock:
            now = self._now()
            for message in messages:
                self._speaker.hear(message, now)
            present, target = self._speaker.present(now), self._speaker.target
        if target is not None:
            self._codec.srcSystem = target[0]  # a companion shares the system of its vehicle
        if self._was_present and not present:
            self._tally.fault("silent")
        self._was_present = present
