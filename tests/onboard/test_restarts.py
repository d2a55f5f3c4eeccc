"""A clock that jumps: an autopilot that starts anew, messages that come late, two of a number."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import from_autopilot as said_by  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402
from test_listener import listener, speaker  # noqa: E402

from trexton.onboard.fix import LocalFrame  # noqa: E402
from trexton.onboard.mavlink.messages import PROFILES  # noqa: E402
from trexton.onboard.mavlink.speaker import Speaker  # noqa: E402


def heard(ear, *moments):
    """Attitudes of these moments, each with the seconds for which the autopilot was awake."""
    for now, awake_s in moments:
        ear.hear(said_by(mavlink.MAVLink_attitude_message(round(1e3 * awake_s), *[0.0] * 6)), now)
    return ear


def test_a_clock_that_wraps_is_no_restart():
    """After 49 days, or on a bench; a restart is one still."""
    ear = listener(1)
    for awake, boots in (
        (2**32 - 9000, 0),
        (2**32 - 50, 0),
        (0, 0),
        (900, 0),
        (60_000, 0),
    ):
        ear.hear(said_by(mavlink.MAVLink_attitude_message(awake, 0, 0, 0, 0, 0, 0)), 1.0)
        assert ear.boots == boots
    assert heard(ear, (1.1, 0.8), (1.5, 1.2)).boots == 0  # late, as far as is known yet
    assert heard(ear, (2.2, 1.9)).boots == 1


def test_two_autopilots_of_one_number_are_told_from_restarts():
    """Two vehicles as they were delivered, on one network: both obeyed a landing."""
    ear, told = listener(1), []
    for number in range(12):
        now = 100 + 0.1 * number
        for offset in (0.0, 340.0):
            sent_s = now - 40 + offset
            ear.hear(
                said_by(mavlink.MAVLink_attitude_message(round(1e3 * sent_s), *[0.0] * 6)), now
            )
    assert not ear.certain and not speaker(ear).land(0, 101.0)
    told = [each["event"] for each in ear.news if "autopilot" != each["event"]]
    assert told == ["two autopilots of one number"]
    twice = listener(1)
    for now, awake_s in (
        (1.0, 60.0),
        (2.0, 1.0),
        (3.2, 2.2),
        (50.0, 49.0),
        (51.0, 1.0),
        (52.1, 2.1),
    ):
        twice.hear(said_by(mavlink.MAVLink_attitude_message(round(1e3 * awake_s), *[0.0] * 6)), now)
    assert twice.boots == 2 and twice.certain


def test_messages_that_come_late_are_no_restart_and_not_taken():
    """Two of them barred landing for the rest of the flight."""
    ear = listener(1)
    for now in np.arange(1, 30, 0.1):
        late = [(now, now + 56), (now, now + 56.02)] if now % 4 < 0.1 else []
        heard(ear, (now, now + 60), *late)
    assert ear.boots == 0 and ear.certain and len(ear._attitudes) == 290
    for now in np.arange(30, 33, 0.1):  # as many as two autopilots give
        heard(ear, (now, now + 60), (now, now + 56))
    assert not ear.certain and ear.news[-1]["event"] == "two autopilots of one number"


def test_a_restart_while_nobody_heard_it_is_one():
    ear = heard(listener(1), (1.0, 7.0), (2.0, 8.0), (11.0, 8.5), (12.1, 9.6))
    assert ear.boots == 1
    ear = heard(listener(1), (1.0, 7.0), (2.0, 8.0), (11.0, 17.0), (11.1, 17.1))
    assert ear.boots == 0


def test_a_restart_is_noticed_over_a_link_whose_delay_wanders():
    ear = heard(listener(1), (1.0, 1200.0))
    for row, now in enumerate(np.arange(5, 9, 0.2)):
        heard(ear, (now, now - 3 - 0.7 * (row % 3 == 1)))
    assert ear.boots == 1


def test_a_link_that_is_later_after_a_silence_is_no_restart():
    ear = heard(listener(1), *((now, now + 60) for now in range(20)))
    heard(ear, *((now, now + 57.5) for now in np.arange(24, 40, 0.2)))
    assert ear.boots == 0 and ear.attitude(39.9) is not None


def test_a_link_that_stalls_and_catches_up_is_no_restart():
    """Two of those barred landing for the rest of the flight."""
    ear = listener(1)
    for stalled in (4.0, 4.3, 9.0):
        began = 20 * stalled
        for sent in np.arange(began, began + stalled, 0.1):  # all of it at once
            heard(ear, (began + stalled + 0.001 * (sent - began), sent + 60))
        for now in np.arange(began + stalled + 0.1, began + 12, 0.1):
            heard(ear, (now, now + 60))
    assert ear.boots == 0 and ear.certain


def test_a_message_without_a_time_is_no_restart():
    """A range finder whose messages leave it out seemed to start the autopilot anew with each."""
    ear = listener(1)
    for awake in (60_000, 60_050, 60_100):
        ear.hear(said_by(mavlink.MAVLink_attitude_message(awake, 0, 0, 0.3, 0, 0, 0)), 1.0)
        ear.hear(said_by(mavlink.MAVLink_distance_sensor_message(0, 10, 900, 150, 0, 0, 25, 0)), 1)
    assert ear.boots == 0 and ear.attitude(1.0) == pytest.approx((0, 0, 0.3))


def test_an_autopilot_that_starts_anew_is_told_again():
    ear = listener(1)
    talk = Speaker(
        PROFILES["px4"](LocalFrame(), (0.0, 5.0, 0.0, 5.0)), np.eye(2), ear, (52.0, 4.0, 0.0)
    )
    told = lambda now: [m.get_type() for m in talk.due(now)]  # noqa: E731
    ear.hear(said_by(mavlink.MAVLink_attitude_message(60_000, 0, 0, 0, 0, 0, 0)), 1.0)
    assert "SET_GPS_GLOBAL_ORIGIN" in told(1.0)
    ear.hear(said_by(mavlink.MAVLink_gps_global_origin_message(520000000, 40000000, 0)), 1.1)
    assert "SET_GPS_GLOBAL_ORIGIN" not in told(4.0) + told(7.0)
    heard(ear, (8.0, 0.9), (9.1, 2.0))
    assert ear.boots == 1 and ear.origin is None and "SET_GPS_GLOBAL_ORIGIN" in told(9.1)
