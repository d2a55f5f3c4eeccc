"""MAVLink: fields against the message's definition, bytes against a plain encoder, and the
conversation.
"""

from __future__ import annotations

import math
import os
import pty
import socket
import struct
import time
from functools import partial

import numpy as np
import pytest
from onboard_tools import Clock, make_fix, surroundings
from onboard_tools import mavlink as mavlink_options
from patience import eventually

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import ATTITUDE, AUTOPILOT_HEARTBEAT, Peer  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from trexton.errors import ParameterError  # noqa: E402
from trexton.estimate import ignorance  # noqa: E402
from trexton.onboard.local import LocalFrame  # noqa: E402
from trexton.onboard.mavlink import messages  # noqa: E402
from trexton.onboard.mavlink.link import make_link  # noqa: E402
from trexton.onboard.mavlink.listener import Answer, Listener  # noqa: E402
from trexton.onboard.mavlink.profiles import profile_named  # noqa: E402
from trexton.onboard.mavlink.speaker import ORIGIN_ATTEMPTS, PATIENCE, Speaker  # noqa: E402
from trexton.onboard.sinks import open_sink  # noqa: E402
from trexton.onboard.tally import Tally  # noqa: E402

AREA = (0.0, 5.0, 0.0, 5.0)
NORTH_UP = LocalFrame(0.0, 1.0)
NAN = math.nan


def crc(data: bytes) -> int:
    """The checksum of MAVLink: CRC-16/MCRF4XX, bit by bit."""
    total = 0xFFFF
    for byte in data:
        total ^= byte
        for _ in range(8):
            total = total >> 1 ^ (0x8408 if total & 1 else 0)
    return total


def plain_packet(message_id: int, extra: int, layout: str, *values, sequence: int = 0) -> bytes:
    """A MAVLink 2 packet from system 1, component 191, after the serialization chapter of the
    protocol.
    """
    payload = struct.pack("<" + layout, *values).rstrip(b"\0") or b"\0"
    head = struct.pack("<BBBBBB", len(payload), 0, 0, sequence, 1, 191) + message_id.to_bytes(
        3, "little"
    )
    return b"\xfd" + head + payload + struct.pack("<H", crc(head + payload + bytes([extra])))


def packed(message) -> bytes:
    return message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=191))


COVARIANCE = np.array([[0.04, 0.01], [0.01, 0.09]])


def upper_triangle(diagonal, north_east: float, rest: float) -> list[float]:
    """The 21 numbers, by walking through the 6x6 matrix."""
    numbers = []
    for row in range(6):
        for column in range(row, 6):
            numbers.append(
                diagonal[row] if row == column else north_east if (row, column) == (0, 1) else rest
            )
    return numbers


class TestFields:
    def test_vision_position_for_px4(self):
        message = messages.vision_position(
            1_234_567, np.array([1.0, 2.0]), COVARIANCE, ATTITUDE, NORTH_UP, 258
        )
        assert (message.usec, message.x, message.y, message.z) == (1_234_567, 2.0, 1.0, -1.0)
        assert (message.roll, message.pitch, message.yaw) == ATTITUDE
        assert message.reset_counter == 2
        # North is the map's y; the correlation is added to both variances.
        np.testing.assert_allclose(
            message.covariance,
            upper_triangle([0.10, 0.05, 100.0, NAN, NAN, NAN], 0.01, NAN),
            rtol=1e-6,
        )

    def test_no_attitude_is_no_zero(self):
        message = messages.vision_position(0, np.zeros(2), COVARIANCE, None, NORTH_UP, 0)
        assert all(math.isnan(angle) for angle in (message.roll, message.pitch, message.yaw))

    def test_odometry_for_ardupilot(self):
        message = messages.odometry(99, np.array([1.0, 2.0]), COVARIANCE, ATTITUDE, NORTH_UP, 3, 77)
        assert (message.time_usec, message.x, message.y, message.z) == (99, 2.0, 1.0, -1.0)
        assert (message.frame_id, message.child_frame_id) == (
            20,
            12,
        )  # LOCAL_FRD and BODY_FRD; all else is dropped
        assert (message.reset_counter, message.estimator_type, message.quality) == (3, 2, 77)
        assert all(
            math.isnan(value)
            for value in (message.vx, message.vy, message.vz, message.rollspeed, message.yawspeed)
        )
        numbers = np.array(message.pose_covariance)
        assert np.isfinite(numbers).all()
        assert (numbers[0], numbers[1], numbers[6]) == pytest.approx((0.10, 0.01, 0.05))
        assert all(math.isnan(value) for value in message.velocity_covariance)

    @pytest.mark.parametrize("std", [0.05, 0.2, 0.3, 0.6, 1.0, 3.0])
    def test_ardupilots_position_error_is_never_less_than_ours(self, std):
        """Both ways in which its versions make one number of the three variances."""
        for ratio in (0.1, 0.7, 1.0):
            covariance = np.diag([std**2, (ratio * std) ** 2])
            x, y, z = np.array(
                messages.odometry(
                    0, np.zeros(2), covariance, ATTITUDE, NORTH_UP, 0, 50
                ).pose_covariance
            )[[0, 6, 11]]
            assert math.sqrt(x + y + z) >= std - 1e-6
            assert math.cbrt(x**2 + y**2 + z**2) >= std - 1e-6

    def test_quaternion_is_the_rotation(self):
        """Against the product of three plain rotations, yaw after pitch after roll."""

        def product(a, b):
            return (
                a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
            )

        roll, pitch, yaw = (math.cos(a / 2) for a in ATTITUDE)
        sines = [math.sin(a / 2) for a in ATTITUDE]
        expected = product(
            (yaw, 0, 0, sines[2]), product((pitch, 0, sines[1], 0), (roll, sines[0], 0, 0))
        )
        assert messages.quaternion(*ATTITUDE) == pytest.approx(expected)

    def test_quality_from_knowing_nothing_to_knowing_all(self):
        assert messages.quality(ignorance(AREA), AREA) == 1
        assert messages.quality(2 * ignorance(AREA), AREA) == 1
        assert messages.quality(np.array([1e-9, 1e-9]), AREA) == 100
        assert messages.quality(ignorance(AREA) * [0.2, 0.5], AREA) == 50

    def test_variances_never_shrink_on_the_wire(self, rng):
        for value in rng.uniform(1e-6, 10, 200):
            assert np.float32(messages.rounded_up(value)) >= value

    def test_heading_turns_position_and_covariance(self):
        east_up = LocalFrame(math.pi / 2, 2.0)
        message = messages.vision_position(
            0, np.array([1.0, 2.0]), np.diag([0.01, 0.09]), None, east_up, 0
        )
        assert (message.x, message.y, message.z) == pytest.approx((-1.0, 2.0, -2.0))
        assert (message.covariance[0], message.covariance[6]) == pytest.approx((0.01, 0.09))

    def test_land_and_origin(self):
        message = messages.land((1, 1), 3, NAN)
        assert (
            message.target_system,
            message.target_component,
            message.command,
            message.confirmation,
        ) == (
            1,
            1,
            21,
            3,
        )
        assert (message.param1, message.param2) == (0, 0) and math.isnan(message.param5)
        assert messages.land((1, 1), 0, 0.0).param5 == 0
        message = messages.origin(1, 51.9906, 4.3768, -2.5, 7)
        assert (message.latitude, message.longitude, message.altitude, message.time_usec) == (
            519_906_000,
            43_768_000,
            -2500,
            7,
        )


class TestGoldenBytes:
    """One packet of each kind: as recorded, and as a plain encoder makes it from the definition."""

    def check(self, message, plain: bytes, golden: str) -> None:
        assert packed(message).hex() == plain.hex() == golden

    def test_heartbeat(self):
        self.check(
            messages.heartbeat(),
            plain_packet(0, 50, "IBBBBB", 0, 18, 8, 0, 4, 3),
            "fd0900000001bf000000000000001208000403aec6",
        )

    def test_vision_position_estimate(self):
        message = messages.vision_position(
            1_234_567, np.array([1.0, 2.0]), COVARIANCE, ATTITUDE, NORTH_UP, 2
        )
        numbers = upper_triangle([0.10, 0.05, 100.0, NAN, NAN, NAN], 0.01, NAN)
        numbers[0], numbers[6] = messages.rounded_up(0.09 + 0.01), messages.rounded_up(0.04 + 0.01)
        plain = plain_packet(102, 158, "Q6f21fB", 1_234_567, 2.0, 1.0, -1.0, *ATTITUDE, *numbers, 2)
        self.check(
            message,
            plain,
            (
                "fd7500000001bf66000087d6120000000000000000400000803f000080bfcdcccc3dcdcc4cbe0000c03fcdcccc3d0ad7233c"
                "0000c07f0000c07f0000c07f0000c07fcdcc4c3d0000c07f0000c07f0000c07f0000c07f0000c8420000c07f0000c07f0000"
                "c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f023454"
            ),
        )

    def test_odometry(self):
        message = messages.odometry(
            99, np.array([1.0, 2.0]), np.diag([0.25, 0.25]), (0.0, 0.0, 0.0), NORTH_UP, 3, 77
        )
        numbers = upper_triangle([0.25, 0.25, 0.0, math.pi**2, math.pi**2, math.pi**2], 0.0, 0.0)
        plain = plain_packet(
            331,
            91,
            "Q3f4f6f21f21fBBBBb",
            99,
            2.0,
            1.0,
            -1.0,
            1.0,
            0.0,
            0.0,
            0.0,
            *[NAN] * 6,
            *numbers,
            *[NAN] * 21,
            20,
            12,
            3,
            2,
            77,
        )
        self.check(
            message,
            plain,
            (
                "fde900000001bf4b01006300000000000000000000400000803f000080bf0000803f0000000000000000000000000000c07f"
                "0000c07f0000c07f0000c07f0000c07f0000c07f0000803e00000000000000000000000000000000000000000000803e0000"
                "000000000000000000000000000000000000000000000000000000000000e6e91d410000000000000000e6e91d4100000000"
                "e6e91d410000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000"
                "c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000c07f140c03024d247e"
            ),
        )

    def test_set_gps_global_origin(self):
        plain = plain_packet(48, 41, "iiiBQ", 519_906_000, 43_768_000, -2500, 1, 7)
        self.check(
            messages.origin(1, 51.9906, 4.3768, -2.5, 7),
            plain,
            "fd0e00000001bf300000d022fd1ec0d89b023cf6ffff0107563a",
        )

    def test_command_long(self):
        plain = plain_packet(76, 152, "7fHBBB", 0, 0, 0, NAN, NAN, NAN, NAN, 21, 1, 1, 2)
        self.check(
            messages.land((1, 1), 2, NAN),
            plain,
            (
                "fd2100000001bf4c00000000000000000000000000000000c07f0000c07f0000c07f0000c07f150001010266d8"
            ),
        )
        plain = plain_packet(76, 152, "7fHBBB", 30, 50_000, 0, 0, 0, 0, 0, 511, 1, 1, 0)
        self.check(
            messages.interval_request((1, 1), messages.ATTITUDE, 20.0),
            plain,
            (
                "fd2000000001bf4c00000000f041005043470000000000000000000000000000000000000000ff0101010075"
            ),
        )

    def test_timesync(self):
        request = mavlink.MAVLink_timesync_message(0, 123_456_789)
        plain = plain_packet(111, 34, "qq", 5_000_000_000, 123_456_789)
        self.check(
            messages.timesync_reply(request, 5_000_000_000),
            plain,
            "fd0c00000001bf6f000000f2052a0100000015cd5b07884a",
        )


def from_autopilot(message, system=1, component=1):
    """The message as if it had come from there."""
    decoder = mavlink.MAVLink(None)
    return decoder.parse_buffer(
        message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component))
    )[0]


def speaker(name="px4", *, heard_at=0.0, attitude_at=None, **options) -> Speaker:
    listener = Listener(options.pop("system_id", None), NORTH_UP)
    result = Speaker(profile_named(name, NORTH_UP, AREA), 0.01 * np.eye(2), listener, **options)
    if heard_at is not None:
        listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), heard_at)
    if attitude_at is not None:
        listener.hear(
            from_autopilot(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)), attitude_at
        )
    return result


def due(speaker: Speaker, now: float, kind: str) -> list:
    return [message for message in speaker.due(now) if message.get_type() == kind]


POSITIONS = {"px4": "VISION_POSITION_ESTIMATE", "ardupilot": "ODOMETRY"}


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

    def test_px4_gets_thirty_a_second_from_twelve_and_a_half(self):
        talk, stamps = speaker(), []
        for tick in range(1000):  # a second in milliseconds
            now = 1 + tick / 1000
            if tick % 80 == 0:
                talk.tell(make_fix(now - 0.005, (now, 0)), now)
            stamps += [message.usec for message in due(talk, now, "VISION_POSITION_ESTIMATE")]
        assert (
            29 <= len(stamps) <= 39
        )  # never less than documented: each new position goes out at once
        assert np.diff(stamps).min() >= 1000
        assert np.diff(stamps).max() < 200_000

    def test_repetitions_hold_the_position_and_lose_certainty(self):
        talk = speaker()
        talk.tell(make_fix(10.0, (1, 2)), 10.02)
        sent = [
            message
            for tick in range(300)
            for message in due(talk, 10.02 + tick / 1000, "VISION_POSITION_ESTIMATE")
        ]
        assert len(sent) == 9
        assert sent[0].usec == 10_000_000  # the capture, not the sending
        assert {(message.x, message.y) for message in sent} == {(2.0, 1.0)}
        north = np.array([message.covariance[0] for message in sent])
        assert (np.diff(north) > 0).all()
        assert (1 / north).sum() <= 1 / 0.09  # together they never weigh more than the one image

    def test_no_repetition_claims_less_than_the_filter_and_the_motion_model(self):
        talk = speaker()
        talk.tell(make_fix(10.0), 10.0)
        for tick in range(400):
            for message in due(talk, 10.0 + tick / 1000, "VISION_POSITION_ESTIMATE"):
                age = message.usec / 1e6 - 10.0
                assert message.covariance[0] >= 0.09 + 0.01 * age
                assert message.covariance[6] >= 0.04 + 0.01 * age

    def test_repeating_ends_when_nothing_new_is_told(self):
        talk = speaker()
        talk.tell(make_fix(10.0), 10.0)
        assert due(talk, 10.0 + PATIENCE - 0.01, "VISION_POSITION_ESTIMATE")
        assert not due(talk, 10.0 + PATIENCE + 0.01, "VISION_POSITION_ESTIMATE")

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
        assert due(talk, 13.0, "COMMAND_LONG")[0].param1 == 30  # asks for ATTITUDE
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)), 13.9
        )
        talk.tell(make_fix(14.0), 14.0)
        (message,) = due(talk, 14.0, "ODOMETRY")
        assert message.q == pytest.approx(messages.quaternion(*ATTITUDE), abs=1e-6)

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
        assert len(due(talk, 1.0, "SET_GPS_GLOBAL_ORIGIN")) == 0
        assert len(due(talk, 2.0, "SET_GPS_GLOBAL_ORIGIN")) == 1
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

    def test_origin_is_not_asked_for_for_ever_nor_unasked(self):
        talk = speaker(origin=(51.99, 4.37, 1.0))
        asked = sum(len(due(talk, float(now), "SET_GPS_GLOBAL_ORIGIN")) for now in range(100))
        assert asked == ORIGIN_ATTEMPTS
        assert any(news["event"] == "origin not confirmed" for news in talk.listener.news)
        assert not [
            m for now in range(100) for m in due(speaker(), float(now), "SET_GPS_GLOBAL_ORIGIN")
        ]

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
        talk.listener.hear(
            from_autopilot(mavlink.MAVLink_command_ack_message(21, 0), system=9), 0.0
        )
        assert not talk.listener.answers
        talk.listener.hear(from_autopilot(mavlink.MAVLink_command_ack_message(21, 2)), 0.0)
        assert list(talk.listener.answers) == [Answer(21, 2)]
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
        assert list(talk.listener.answers) == [Answer(21, 0)]

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

    def test_unknown_profile(self):
        with pytest.raises(ParameterError, match="px4, ardupilot"):
            profile_named("inav", NORTH_UP, AREA)


def heard(peer: Peer, kind: str, count: int) -> bool:
    return len(peer.of(kind)) >= count


@pytest.fixture
def peer():
    made = Peer()
    yield made
    made.close()


class TestOverUdp:
    """End to end over loopback: what a sink is told, and what a receiver of its own makes of the
    bytes.
    """

    def test_px4(self, peer):
        tally, clock = Tally(), Clock()
        sink = open_sink(
            f"udpout:127.0.0.1:{peer.port}",
            surroundings(tally, clock=clock),
            mavlink_options(origin="51.99,4.37,1"),
        )
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            beat = peer.of("HEARTBEAT")[0]
            assert (beat.type, beat.autopilot, beat.get_srcSystem(), beat.get_srcComponent()) == (
                18,
                8,
                1,
                191,
            )
            peer.send(
                AUTOPILOT_HEARTBEAT,
                mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0),
                mavlink.MAVLink_timesync_message(0, 5),
            )
            assert eventually(lambda: peer.of("SET_GPS_GLOBAL_ORIGIN") and peer.of("TIMESYNC"))
            sink.write(make_fix(clock.now, (1.5, 2.5), resets=4))
            for count in (1, 2, 3):
                assert eventually(partial(heard, peer, "VISION_POSITION_ESTIMATE", count))
                clock.now += 0.04
            first, *more = peer.of("VISION_POSITION_ESTIMATE")
            assert first.usec == 100_000_000
            assert [message.usec for message in more[:2]] == [100_040_000, 100_080_000]
            assert (first.x, first.y, first.z, first.reset_counter) == (2.5, 1.5, -1.0, 4)
            assert (first.roll, first.pitch, first.yaw) == pytest.approx(ATTITUDE)
            assert first.covariance[0] == pytest.approx(2 * 0.09) and first.covariance[
                6
            ] == pytest.approx(2 * 0.04)
            assert math.isnan(first.covariance[20]) and first.covariance[11] == 100
            assert eventually(lambda: tally["sent VISION_POSITION_ESTIMATE"] == 3)
            assert "autopilot 1 heard" in sink.status()
        finally:
            sink.close()

    def test_ardupilot(self, peer):
        clock = Clock()
        around, options = surroundings(clock=clock), mavlink_options(autopilot="ardupilot")
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", around, options)
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            peer.send(AUTOPILOT_HEARTBEAT)
            assert eventually(lambda: [m for m in peer.of("COMMAND_LONG") if m.command == 511])
            peer.send(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0))
            assert eventually(lambda: sink.aiding(clock.now).roll is not None)
            sink.write(make_fix(clock.now, (1.5, 2.5)))
            assert eventually(lambda: peer.of("ODOMETRY"))
            message = peer.of("ODOMETRY")[0]
            assert message.time_usec == 100_000_000
            assert (message.x, message.y, message.z) == (2.5, 1.5, -1.0)
            assert message.q == pytest.approx(messages.quaternion(*ATTITUDE), abs=1e-6)
            assert message.quality == messages.quality(np.array([0.2, 0.3]), AREA)
        finally:
            sink.close()

    def test_a_companion_shares_the_system_of_its_vehicle(self, peer):
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(clock=Clock()))
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            peer.codec.srcSystem = 7
            peer.send(AUTOPILOT_HEARTBEAT)
            assert eventually(lambda: sink.land(0) and peer.of("COMMAND_LONG"))
            command = peer.of("COMMAND_LONG")[-1]
            assert (command.target_system, command.get_srcSystem(), command.get_srcComponent()) == (
                7,
                7,
                191,
            )
        finally:
            sink.close()

    def test_garbage_on_the_wire_is_skipped(self, peer, rng):
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings())
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            for _ in range(50):
                peer.send(rng.integers(0, 256, rng.integers(1, 300), dtype=np.uint8).tobytes())
            packet = AUTOPILOT_HEARTBEAT.pack(peer.codec)
            peer.send(packet[:9], packet[:-1] + bytes([packet[-1] ^ 1]))
            assert eventually(
                lambda: peer.send(AUTOPILOT_HEARTBEAT) or "autopilot 1 heard" in sink.status()
            )
        finally:
            sink.close()

    def test_the_peer_gone_and_back(self):
        """On the same port, heard of again; the sink never raises, and counts the silence."""
        tally, first = Tally(), Peer()
        sink = open_sink(f"udpout:127.0.0.1:{first.port}", surroundings(tally))
        sink.open()
        try:
            assert eventually(lambda: first.of("HEARTBEAT"))
            port_of_ours = first.address
            first.close()
            assert eventually(lambda: sink.write(make_fix(time.monotonic())) or tally["link"] >= 1)
            second = Peer(first.port)
            try:
                assert eventually(
                    lambda: (
                        sink.write(make_fix(time.monotonic()))
                        or second.of("VISION_POSITION_ESTIMATE")
                    )
                )
                assert second.address == port_of_ours  # PX4 answers the first it has seen
            finally:
                second.close()
        finally:
            sink.close()

    def test_a_silent_autopilot_is_counted(self, peer):
        tally, clock = Tally(), Clock(50.0)
        sink = open_sink(f"udpout:127.0.0.1:{peer.port}", surroundings(tally, clock=clock))
        sink.open()
        try:
            assert eventually(lambda: peer.of("HEARTBEAT"))
            peer.send(AUTOPILOT_HEARTBEAT)
            assert eventually(lambda: "heard" in sink.status() and "no" not in sink.status())
            assert sink.land(0)
            clock.now += 4
            assert eventually(lambda: tally["silent"] == 1)
            assert sink.status() == "autopilot silent" and not sink.land(1)
        finally:
            sink.close()


def test_tcp_peer_gone_and_back():
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(120)
    tally = Tally()
    sink = open_sink(f"tcp:127.0.0.1:{server.getsockname()[1]}", surroundings(tally))
    sink.open()
    try:
        for _ in range(2):
            connection, _ = server.accept()
            connection.settimeout(120)
            assert connection.recv(100)[0] == 0xFD
            connection.close()
        assert eventually(lambda: tally["link"] >= 1)
    finally:
        sink.close()
        server.close()


def test_tcp_without_a_server_is_counted_and_does_not_block():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    tally = Tally()
    sink = open_sink(f"tcp:127.0.0.1:{port}", surroundings(tally))
    sink.open()
    sink.write(make_fix(time.monotonic()))
    assert eventually(lambda: tally["link"] >= 2)
    assert sink.status() == "no link" and not sink.land(0)
    sink.close()


def test_serial_line():
    ours, theirs = pty.openpty()
    link = make_link(f"serial:{os.ttyname(theirs)}:115200")
    link.open()
    try:
        link.send(b"\xfd\x00\r\n\x11")
        assert os.read(ours, 100) == b"\xfd\x00\r\n\x11"  # raw: nothing translated
        os.write(ours, b"\x03\x04\xff")
        assert eventually(lambda: link.receive() == b"\x03\x04\xff")
        assert link.receive() == b""
    finally:
        link.close()
        os.close(ours)
        os.close(theirs)


def test_no_such_serial_line_is_an_os_error():
    with pytest.raises(OSError):
        make_link("serial:/dev/no-such-line").open()


def test_udpin_answers_whoever_speaks():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = make_link(f"udpin:127.0.0.1:{port}")
    link.open()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.settimeout(120)
        link.send(b"nobody is there")
        other.sendto(b"hello", ("127.0.0.1", port))
        assert eventually(lambda: link.receive() == b"hello")
        link.understood()
        link.send(b"answer")
        assert other.recv(100) == b"answer"
    link.close()
