"""What is said to an autopilot, and when; what is heard of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from onboard_tools import make_fix

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import (  # noqa: E402
    ATTITUDE,
    AUTOPILOT_HEARTBEAT,
    IN_AIR,
    attitude,
    from_autopilot,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from trexton.base.errors import ParameterError  # noqa: E402
from trexton.onboard.fix import LocalFrame  # noqa: E402
from trexton.onboard.mavlink import messages  # noqa: E402
from trexton.onboard.mavlink.listener import Listener  # noqa: E402
from trexton.onboard.mavlink.messages import PROFILES  # noqa: E402
from trexton.onboard.mavlink.speaker import (  # noqa: E402
    REPEAT_TIMEOUT,
    Speaker,
)
from trexton.onboard.settings import MavlinkOptions  # noqa: E402

AREA = (0.0, 5.0, 0.0, 5.0)

NORTH_UP = LocalFrame(0.0, 1.0)

NAN = math.nan


def speaker(name="px4", *, heard_at=0.0, attitude_at=None, target=None, **options) -> Speaker:
    listener = Listener((None, None), NORTH_UP)
    result = Speaker(
        PROFILES[name](NORTH_UP, AREA, (52.0, 4.0, 0.0), target),
        0.01 * np.eye(2),
        listener,
        **options,
    )
    if heard_at is not None:
        listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), heard_at)
    if attitude_at is not None:
        listener.hear(
            from_autopilot(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)), attitude_at
        )
    return result


def due(speaker: Speaker, now: float, kind: str) -> list:
    return [message for message in speaker.due(now) if message.get_type() == kind]


class TestSpeaker:
    def test_heartbeat_once_a_second_even_to_nobody(self):
        alone = speaker(heard_at=None)
        assert [len(due(alone, now, "HEARTBEAT")) for now in (0, 0.5, 1.0, 1.5, 2.0)] == [
            1,
            0,
            1,
            0,
            1,
        ]

    @pytest.mark.parametrize("profile", PROFILES)
    @pytest.mark.parametrize("delay", [0.0, 0.06, 0.15])
    def test_each_image_goes_out_once_at_its_capture(self, profile, delay):
        captured = 10 + 0.08 * np.arange(20)
        sent = self.sent(profile, captured, captured + delay)
        assert sent[:20] == [round(1e6 * stamp) for stamp in captured]

    @pytest.mark.parametrize("delay", [0.0, 0.06, 0.15])
    @pytest.mark.parametrize("period", [0.033, 0.05, 0.08, 0.2, 0.3])
    def test_repetitions_keep_off_the_images(self, delay, period):
        """Images are missing here and there, one comes late after a gap."""
        number = np.array([n for n in range(100) if n % 17 not in (3, 4, 5, 6, 7)])
        captured = 10 + period * number
        late = min(0.06, 0.8 * period) * (number % 17 == 8)
        sent = np.array(self.sent("px4", captured, captured + delay + late)) / 1e6
        images = np.isin(sent.round(6), captured.round(6))
        assert images.sum() == len(captured) and (~images).sum() >= 4
        apart = np.abs(sent[~images, None] - captured[None]).min(axis=1)
        assert apart.min() >= 0.02 and (np.diff(sent) > 0.02).all()

    @pytest.mark.parametrize("profile", PROFILES)
    def test_an_image_older_than_a_repetition_follows_it(self, profile):
        """Held up by more than the lag: an estimator takes no stamp that runs backwards."""
        captured = np.array([10.0, 10.05, 10.13, 10.21])
        sent = self.sent(profile, captured, captured + [0.02, 0.16, 0.09, 0.09])
        assert (np.diff(sent) >= 20_000).all()
        assert [round(1e6 * stamp) in sent for stamp in captured] == [True, False, True, True]
        assert sent[2] - sent[1] == 20_000

    def test_stamps_do_not_run_ahead_of_a_quick_camera(self):
        captured = 10 + np.arange(120) / 60
        sent = self.sent("px4", captured, captured + np.where(captured < 10.5, 0.02, 0.2))
        assert (np.diff(sent) > 0).all() and sent[-2] <= 1e6 * captured[-1] + 1

    @staticmethod
    def sent(profile, captured, arrived) -> list[int]:
        """The stamps in microseconds of what is sent of images that arrive so, in its order."""
        talk, stamps, waiting = speaker(profile), [], list(zip(captured, arrived, strict=True))
        for now in np.arange(captured[0], arrived[-1] + 0.4, 0.001):
            if round(1000 * now) % 50 == 0:
                talk.listener.hear(from_autopilot(attitude(now)), now)
            while waiting and waiting[0][1] <= now:
                talk.tell(make_fix(waiting.pop(0)[0]), now)
            stamps += [
                getattr(each, "usec", None) or each.time_usec
                for each in talk.due(now)
                if each.get_type() in ("VISION_POSITION_ESTIMATE", "ODOMETRY", "GPS_INPUT")
            ]
        return stamps

    def test_repetitions_hold_the_position_and_are_no_news(self):
        talk = speaker()
        talk.tell(make_fix(10.0, (1, 2)), 10.02)
        sent = [
            (tick, message)
            for tick in range(600)
            for message in due(talk, 10.02 + tick / 1000, "VISION_POSITION_ESTIMATE")
        ]
        assert [tick for tick, _ in sent] == pytest.approx([0, 150, 300, 450], abs=1)
        assert {(message.x, message.y) for _, message in sent} == {(2.0, 1.0)}
        north = np.array([message.covariance[0] for _, message in sent])
        assert north[0] == pytest.approx(0.09) and (np.diff(north) > 0).all()
        assert (1 / north[1:]).sum() <= 0.05 / 0.09  # of the weight of the image

    def test_repeating_ends_when_nothing_new_is_told(self):
        talk = speaker()
        talk.tell(make_fix(10.0), 10.0)
        assert due(talk, 10.0 + REPEAT_TIMEOUT - 0.01, "VISION_POSITION_ESTIMATE")
        assert not due(talk, 10.0 + REPEAT_TIMEOUT + 0.01, "VISION_POSITION_ESTIMATE")

    @pytest.mark.parametrize(
        "bad",
        [
            {"lost": True},
            {"stale": True},
            {"position": (NAN, 0)},
            {"covariance": ((NAN, 0), (0, 1))},
        ],
    )
    def test_px4_hears_nothing_of_what_is_not_usable(self, bad):
        talk = speaker()
        talk.tell(make_fix(10.0), 10.0)
        assert due(talk, 10.0, "VISION_POSITION_ESTIMATE")
        talk.tell(make_fix(10.08, **bad), 10.08)
        assert not [
            message
            for tick in range(200)
            for message in due(talk, 10.08 + tick / 1000, "VISION_POSITION_ESTIMATE")
        ]

    def test_a_prediction_is_no_measurement(self):
        talk = speaker("ardupilot", attitude_at=9.9)
        talk.tell(make_fix(10.0, observed=False), 10.0)
        assert not due(talk, 10.0, "ODOMETRY")

    def test_ardupilot_once_with_quality_then_failed_when_lost(self):
        talk = speaker("ardupilot", attitude_at=9.9)
        talk.tell(make_fix(10.0), 10.0)
        (message,) = due(talk, 10.0, "ODOMETRY")
        assert message.quality == messages.quality(np.array([0.2, 0.3]), AREA)
        assert message.pose_covariance[0] == pytest.approx(0.09)
        assert not due(talk, 10.05, "ODOMETRY")
        talk.tell(make_fix(10.08, lost=True), 10.08)
        (message,) = due(talk, 10.08, "ODOMETRY")
        assert message.quality == -1 and math.isfinite(message.x)
        talk.tell(make_fix(10.16, (NAN, 0)), 10.16)
        assert not due(talk, 10.16, "ODOMETRY")

    def test_ardupilot_is_told_nothing_without_its_real_attitude(self):
        talk = speaker("ardupilot")
        talk.tell(make_fix(10.0), 10.0)
        assert not due(talk, 10.0, "ODOMETRY") and talk.withheld == 1
        assert talk.listener.news[-1] == {"event": "positions withheld for want of attitude"}
        assert due(talk, 13.0, "COMMAND_LONG")[0].param1 == 30  # asks for ATTITUDE
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)), 13.9
        )
        talk.tell(make_fix(14.0), 14.0)
        (message,) = due(talk, 14.0, "ODOMETRY")
        assert message.q == pytest.approx(messages.quaternion(*ATTITUDE), abs=1e-6)

    def test_a_yaw_is_sent_where_a_frame_shows_it_and_never_the_autopilots_own(self):
        talk = speaker(attitude_at=9.9, send_yaw=True)
        talk.tell(make_fix(10.0, heading=0.3, heading_sigma=0.01), 10.0)
        (message,) = due(talk, 10.0, "VISION_POSITION_ESTIMATE")
        assert (message.pitch, message.yaw) == pytest.approx((ATTITUDE[1], -0.3))
        assert message.covariance[20] == pytest.approx(1e-4)
        (again,) = due(talk, 10.16, "VISION_POSITION_ESTIMATE")
        talk.tell(make_fix(10.2), 10.2)
        (unknown,) = due(talk, 10.2, "VISION_POSITION_ESTIMATE")
        for message in (again, unknown):
            assert math.isnan(message.yaw) and math.isnan(message.covariance[20])
        usual = speaker(attitude_at=9.9)
        usual.tell(make_fix(10.0, heading=0.3, heading_sigma=0.01), 10.0)
        (message,) = due(usual, 10.0, "VISION_POSITION_ESTIMATE")
        assert message.yaw == pytest.approx(ATTITUDE[2]) and math.isnan(message.covariance[20])

    def test_ardupilot_takes_no_position_without_the_yaw_that_it_fuses(self):
        talk = speaker("ardupilot", attitude_at=9.9, send_yaw=True)
        talk.tell(make_fix(10.0, heading=0.3, heading_sigma=0.01), 10.0)
        (message,) = due(talk, 10.0, "ODOMETRY")
        assert message.q == pytest.approx(messages.quaternion(*ATTITUDE[:2], -0.3), abs=1e-6)
        assert message.quality > 0 and not due(talk, 10.16, "ODOMETRY")
        talk.tell(make_fix(10.2), 10.2)
        (message,) = due(talk, 10.2, "ODOMETRY")
        assert message.quality == -1

    def test_a_receiver_of_satellites_has_a_fix_until_the_vehicle_is_lost(self):
        talk = speaker("ardupilot-gps")
        talk.tell(make_fix(10.0, (1, 2)), 10.0)
        (message,) = due(talk, 10.0, "GPS_INPUT")
        assert (message.fix_type, message.yaw) == (3, 0)
        assert message.lat > 520_000_000 and message.lon > 40_000_000
        talk.tell(make_fix(10.08, lost=True), 10.08)
        (message,) = due(talk, 10.08, "GPS_INPUT")
        assert message.fix_type == 1

    def test_a_receiver_on_a_computer_whose_clock_was_never_set(self, monkeypatch):
        """In 1970 there were no weeks to count: no position could be packed."""
        monkeypatch.setattr(messages, "UNIX_OFFSET", 12.0)
        talk = speaker("ardupilot-gps", attitude_at=10.0)
        talk.tell(make_fix(10.0), 10.0)
        message = from_autopilot(*due(talk, 10.0, "GPS_INPUT"))
        assert (message.time_week, message.time_week_ms, message.fix_type) == (0, 0, 3)

    @pytest.mark.parametrize(("profile", "frame"), [("px4", 1), ("ardupilot", 12)])
    def test_the_landing_zone_goes_with_each_image_and_no_repetition(self, profile, frame):
        talk = speaker(profile, attitude_at=9.9, target=np.array([3.0, 1.0]))
        talk.tell(make_fix(10.0), 10.0)
        (message,) = due(talk, 10.0, "LANDING_TARGET")
        assert (message.frame, message.position_valid) == (frame, 1)
        assert not due(talk, 10.16, "LANDING_TARGET")
        talk.tell(make_fix(10.2, lost=True), 10.2)
        assert not due(talk, 10.2, "LANDING_TARGET")

    def test_px4_gets_the_attitude_nearest_to_the_capture(self):
        talk = speaker()
        for when, yaw in ((9.8, 0.5), (10.0, 1.0), (10.2, 1.5)):
            talk.listener.hear(
                from_autopilot(mavlink.MAVLink_attitude_message(0, 0, 0, yaw, 0, 0, 0)), when
            )
        talk.tell(make_fix(10.05), 10.2)
        assert due(talk, 10.2, "VISION_POSITION_ESTIMATE")[0].yaw == pytest.approx(1.0)

    def test_origin_is_set_until_it_is_confirmed(self):
        talk = speaker(origin=(51.99, 4.37, 1.0))
        assert len(due(talk, 0.0, "SET_GPS_GLOBAL_ORIGIN")) == 1
        assert len(due(talk, 0.9, "SET_GPS_GLOBAL_ORIGIN")) == 0
        assert len(due(talk, 1.0, "SET_GPS_GLOBAL_ORIGIN")) == 1
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_gps_global_origin_message(0, 0, 0, 0)), 3.0
        )
        assert (
            len(due(talk, 4.0, "SET_GPS_GLOBAL_ORIGIN")) == 1
        )  # another's origin confirms nothing
        talk.listener.hear(
            from_autopilot(
                mavlink.MAVLink_gps_global_origin_message(519_900_000, 43_700_000, 1000, 0)
            ),
            5.0,
        )
        assert len(due(talk, 6.0, "SET_GPS_GLOBAL_ORIGIN")) == 0
        # Once it was confirmed, whoever changes it in flight has a reason.
        other = mavlink.MAVLink_gps_global_origin_message(520_000_000, 50_000_000, 1000, 0)
        talk.listener.hear(from_autopilot(other), 7.0)
        assert not any(due(talk, 7.0 + now, "SET_GPS_GLOBAL_ORIGIN") for now in range(30))

    def test_nothing_is_asked_or_set_while_it_is_in_doubt_whose_it_is(self):
        talk = speaker(origin=(51.99, 4.37, 1.0))
        talk.listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT, 2), 0.1)
        kinds = {message.get_type() for now in range(20) for message in talk.due(float(now))}
        assert kinds == {"HEARTBEAT"}

    def test_origin_is_asked_for_for_ever_and_never_unasked(self):
        """An autopilot that starts slowly takes it half a minute after it was first heard."""
        talk, unasked = speaker(origin=(51.99, 4.37, 1.0)), speaker()
        asked = [now for now in range(100) if due(talk, float(now), "SET_GPS_GLOBAL_ORIGIN")]
        assert asked == [*range(11), *range(20, 100, 10)]
        assert not any(due(unasked, float(now), "SET_GPS_GLOBAL_ORIGIN") for now in range(100))

    def test_an_origin_of_an_earlier_start_is_asked_for(self):
        """ArduPilot passes over an origin when it has one, and says nothing: the second preflight
        check found none."""
        talk = speaker("ardupilot", origin=(51.99, 4.37, 1.0))
        asked = [m for m in due(talk, 0.0, "COMMAND_LONG") if m.command == 512]
        assert [(m.param1, m.target_system, m.target_component) for m in asked] == [(49, 1, 1)]
        assert not [m for m in due(speaker(), 0.0, "COMMAND_LONG") if m.command == 512]

    @pytest.mark.parametrize(
        ("name", "number", "message"),
        [
            ("px4", 230, mavlink.MAVLink_estimator_status_message(0, 8, *[0.0] * 8)),
            ("ardupilot", 193, mavlink.MAVLink_ekf_status_report_message(16, *[0.0] * 6)),
            ("ardupilot-gps", 193, mavlink.MAVLink_ekf_status_report_message(8, *[0.0] * 6)),
        ],
    )
    def test_it_asks_whether_there_is_a_position(self, name, number, message):
        """Of a line on which nothing was asked for, ArduPilot says nothing of its own accord."""
        talk = speaker(name)

        def asked(now):
            wanted = [m for m in due(talk, now, "COMMAND_LONG") if m.command == 511]
            return number in [m.param1 for m in wanted]

        assert asked(0.0)
        talk.listener.hear(from_autopilot(message), 1.0)
        assert talk.listener.fused(3.0) and not asked(3.0) and asked(9.0)

    def test_timesync_is_answered_and_answers_are_not(self):
        talk = speaker()
        talk.listener.hear(from_autopilot(mavlink.MAVLink_timesync_message(0, 42)), 5.0)
        talk.listener.hear(from_autopilot(mavlink.MAVLink_timesync_message(7, 42)), 5.0)
        (answer,) = due(talk, 5.0, "TIMESYNC")
        assert (answer.tc1, answer.ts1) == (5_000_000_000, 42)

    def test_only_the_autopilot_is_obeyed_and_listened_to(self):
        talk = speaker(heard_at=None)
        talk.listener.hear(
            from_autopilot(
                mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), system=255, component=190
            ),
            0.0,
        )
        assert talk.listener.target is None and not talk.land(0, 0.0)
        talk.listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), 0.0)
        talk.listener.hear(from_autopilot(IN_AIR), 0.0)
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_command_ack_message(21, 0), system=9), 0.0
        )
        assert not talk.listener.answers
        talk.listener.hear(from_autopilot(mavlink.MAVLink_command_ack_message(21, 2)), 0.0)
        assert list(talk.listener.answers) == [2]
        assert talk.land(1, 0.0) and due(talk, 0.0, "COMMAND_LONG")[0].confirmation == 1

    def test_an_answer_to_somebody_else_is_none_to_us(self):
        talk = speaker()
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_command_ack_message(21, 0, 0, 0, 255, 190)), 0.0
        )
        assert not talk.listener.answers
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_command_ack_message(21, 0, 0, 0, 1, 191)), 0.0
        )
        assert list(talk.listener.answers) == [0]

    def test_what_the_autopilot_says_is_kept_for_the_log(self):
        talk = speaker()
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_statustext_message(3, b"EKF variance")), 1.0
        )
        assert talk.listener.news[-1]["text"] == "EKF variance"
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_estimator_status_message(0, 8, *[0.0] * 8)), 1.0
        )
        assert talk.listener.fused(1.0) is True and talk.listener.fused(9.0) is None
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_ekf_status_report_message(1, *[0.0] * 6)), 1.0
        )
        assert talk.listener.fused(1.0) is False

    def test_presence(self):
        talk = speaker(heard_at=5.0)
        assert talk.listener.present(7.9) and not talk.listener.present(8.1)

    def test_we_are_not_the_autopilot(self):
        with pytest.raises(ParameterError, match="component_id"):
            MavlinkOptions(component_id=1)

    def test_unknown_profile(self):
        with pytest.raises(ParameterError, match="px4, ardupilot"):
            MavlinkOptions(autopilot="inav")
