"""A signal comes at any moment: it ends the flight, whatever the thread is at."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import pytest

from trexton.cli.onboard import set_elsewhere, stopped_by_signals


def interrupted(end, moment: int, patience: float = 60.0) -> tuple[bool, bool]:
    """Whether a wait ends though `end` sets its event at the `moment`-th step of it, and whether
    there were so many steps."""
    steps, stop = 0, threading.Event()

    def each(frame, kind, argument):
        nonlocal steps
        steps += 1
        if steps == moment:
            sys.settrace(None)
            end(stop)
            return None
        return each

    def wait():
        sys.settrace(each)
        stop.wait(0.01)
        sys.settrace(None)

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    thread.join(patience)
    return not thread.is_alive(), steps >= moment


def test_it_may_be_set_at_any_step_of_a_wait():
    moment, reached = 1, True
    while reached:
        ended, reached = interrupted(set_elsewhere, moment)
        assert ended, f"set at step {moment} the wait never ends"
        moment += 1
    assert moment > 5


def test_this_test_would_see_a_plain_event_hang():
    assert not all(interrupted(threading.Event.set, moment, 1.0)[0] for moment in range(1, 12))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_stops_and_the_handlers_come_back(number):
    before, hangup = signal.getsignal(number), signal.getsignal(signal.SIGHUP)
    with stopped_by_signals() as stop:
        assert signal.getsignal(number) is not before
        os.kill(os.getpid(), number)
        assert stop.wait(30)
        assert signal.getsignal(number) is before
    assert signal.getsignal(signal.SIGHUP) is hangup


def test_thousands_of_signals_hang_nothing():
    end = time.monotonic() + 1.0
    handler = signal.getsignal(signal.SIGALRM)
    try:
        while time.monotonic() < end:
            stop = threading.Event()
            signal.signal(signal.SIGALRM, lambda *_, stop=stop: set_elsewhere(stop))
            signal.setitimer(signal.ITIMER_REAL, 1e-4)
            while not stop.is_set():
                stop.wait(1e-6)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
