"""A signal comes at any moment: it ends the flight, whatever the thread is at."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import pytest

from trexton.onboard.signals import Stop, stopped_by_signals


def interrupted(stop: threading.Event, moment: int, patience: float = 60.0) -> tuple[bool, bool]:
    """Whether a wait ends though the event is set at the `moment`-th step of it, and whether there
    were so many steps."""
    steps = 0

    def each(frame, kind, argument):
        nonlocal steps
        steps += 1
        if steps == moment:
            sys.settrace(None)
            stop.set()
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
        ended, reached = interrupted(Stop(), moment)
        assert ended, f"set at step {moment} the wait never ends"
        moment += 1
    assert moment > 5


def test_this_test_would_see_a_plain_event_hang():
    assert not all(interrupted(threading.Event(), moment, 1.0)[0] for moment in range(1, 12))


def test_it_is_an_event_like_others():
    stop = Stop()
    assert not stop.wait(0) and not stop.wait(-1.0) and not stop.is_set()
    waiting = [threading.Thread(target=stop.wait) for _ in range(3)]
    for thread in waiting:
        thread.start()
    stop.set()
    for thread in waiting:
        thread.join(30)
        assert not thread.is_alive()
    stop.set()
    assert stop.is_set() and stop.wait() and stop.wait(0.5)


def test_a_wait_ends_though_its_time_runs_out_before_it_begins():
    def wait():
        for _ in range(20_000):
            Stop().wait(1e-6)

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    thread.join(60)
    assert not thread.is_alive()


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
            stop = Stop()
            signal.signal(signal.SIGALRM, lambda *_, stop=stop: stop.set())
            signal.setitimer(signal.ITIMER_REAL, 1e-4)
            while not stop.is_set():
                stop.wait(1e-6)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
