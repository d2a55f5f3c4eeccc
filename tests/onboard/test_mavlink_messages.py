"""MAVLink messages: fields against their definition, bytes against a plain encoder."""

from __future__ import annotations

import math
import struct
import time

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import ATTITUDE, AUTOPILOT_HEARTBEAT, IN_AIR, from_autopilot  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from trexton.localization.estimate import ignorance  # noqa: E402
from trexton.onboard.fix import LocalFrame  # noqa: E402
from trexton.onboard.mavlink import messages  # noqa: E402
from trexton.onboard.mavlink.listener import Listener  # noqa: E402
from trexton.onboard.mavlink.speaker import Speaker  # noqa: E402

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


def report(time=1.234567, covariance=COVARIANCE, attitude=ATTITUDE, **more) -> messages.Report:
    return messages.Report(time, np.array([1.0, 2.0]), covariance, attitude, **more)


def px4(report, local=NORTH_UP):
    return messages.PROFILES["px4"](local, AREA).position(None, report)


def odometry(report, grade):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(messages, "quality", lambda *_: grade)
        return messages.PROFILES["ardupilot"](NORTH_UP, AREA).position(report, report)


def gps_input(report, unix, fixed=True):
    gps = messages.PROFILES["ardupilot-gps"](NORTH_UP, AREA, (52.0, 4.0, 10.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(messages, "UNIX_OFFSET", unix - report.time)
        return gps.position(None, report, not fixed)


def landing_target(name, report, local=NORTH_UP):
    return messages.PROFILES[name](local, AREA, None, np.array([3.0, 1.0])).zone(report)


def said(now: float, kind: str, name="px4", land: int | None = None, **options) -> list:
    """What is said to an autopilot that was heard."""
    listener = Listener()
    listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), now)
    listener.hear(from_autopilot(IN_AIR), now)
    speaker = Speaker(messages.PROFILES[name](NORTH_UP, AREA), np.eye(2), listener, **options)
    if land is not None:
        assert speaker.land(land, now)
    return [each for each in speaker.due(now) if each.get_type() == kind]


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
        message = px4(report(resets=258))
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
        message = px4(report(attitude=None))
        assert all(math.isnan(angle) for angle in (message.roll, message.pitch, message.yaw))

    def test_odometry_for_ardupilot(self):
        message = odometry(report(99e-6, resets=3), 77)
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
            x, y, z = np.array(odometry(report(covariance=covariance), 50).pose_covariance)[
                [0, 6, 11]
            ]
            assert math.sqrt(x + y + z) >= std - 1e-6
            assert math.cbrt(x**2 + y**2 + z**2) >= std - 1e-6

    def test_our_own_yaw_goes_out_with_a_variance_that_is_fused(self):
        message = px4(report(yaw=2.0, yaw_sigma=0.01))
        assert (message.roll, message.pitch, message.yaw) == (*ATTITUDE[:2], 2.0)
        assert message.covariance[20] == pytest.approx(1e-4)
        assert all(math.isfinite(message.covariance[place]) for place in (15, 18))
        message = odometry(report(yaw=2.0, yaw_sigma=0.01), 50)
        assert message.q == pytest.approx(messages.quaternion(*ATTITUDE[:2], 2.0))
        roll, pitch, yaw = np.array(message.pose_covariance)[[15, 18, 20]]
        assert 0.01 <= math.sqrt(roll + pitch + yaw) < 0.04  # as ArduPilot makes one of the three
        assert math.cbrt(roll**2 + pitch**2 + yaw**2) >= 0.01 - 1e-6
        # Without the autopilot's roll and pitch there is no attitude, and none is made up.
        message = px4(report(attitude=None, yaw=2.0))
        assert all(math.isnan(angle) for angle in (message.roll, message.pitch, message.yaw))

    def test_gps_input_is_a_place_on_earth(self):
        unix = 1_700_000_000.25
        message = gps_input(report(), unix)
        assert (message.fix_type, message.ignore_flags, message.yaw) == (3, 8 | 16 | 32, 0)
        assert 1e-7 * message.lat - 52 == pytest.approx(2.0 / 111_195, abs=2e-7)  # m in a degree
        along = 1.0 / (111_195 * math.cos(math.radians(52)))
        assert 1e-7 * message.lon - 4 == pytest.approx(along, abs=2e-7)
        assert (message.alt, message.vert_accuracy) == (11.0, 10.0)
        assert message.horiz_accuracy == message.hdop == pytest.approx(math.sqrt(0.10))
        # Of 6 January 1980, 18 leap seconds since: 2023-11-14T22:13:20.25Z.
        assert (message.time_week, message.time_week_ms) == (2288, 252_818_250)
        lost = gps_input(report(), unix, False)
        assert (lost.fix_type, lost.satellites_visible) == (1, 0)
        for yaw, sent in ((0.0, 36000), (math.pi / 2, 9000), (-math.pi / 2, 27000)):
            turned = report(yaw=yaw, yaw_sigma=0.01)
            assert gps_input(turned, unix).yaw == sent

    def test_gps_input_goes_on_beyond_the_date_line(self):
        gps = messages.PROFILES["ardupilot-gps"](NORTH_UP, AREA, (-16.8, 180.0, 10.0))
        sent = gps.position(None, report())
        # One metre east of it; ArduPilot takes no longitude of more than 180 degrees.
        along = 1.0 / (111_195 * math.cos(math.radians(16.8)))
        assert 1e-7 * sent.lon + 180 == pytest.approx(along, abs=2e-7)

    def test_a_clock_that_is_set_in_flight_moves_no_receivers_time(self, monkeypatch):
        gps = messages.PROFILES["ardupilot-gps"](NORTH_UP, AREA, (52.0, 4.0, 10.0))
        before = gps.position(None, report())
        set_clock = time.time() + 3600.0
        monkeypatch.setattr(time, "time", lambda: set_clock)
        after = gps.position(None, report())
        assert (after.time_week, after.time_week_ms) == (before.time_week, before.time_week_ms)

    def test_landing_target_is_the_place_for_px4_and_the_way_there_for_ardupilot(self):
        east_up = LocalFrame(math.pi / 2, 2.0)
        message = landing_target("px4", report(), east_up)
        assert (message.frame, message.position_valid) == (1, 1)
        assert (message.x, message.y, message.z) == pytest.approx((-3.0, 1.0, 0.0))
        # From (1, 2): two metres south, one west, two down; the nose points west and down.
        way = np.array([-2.0, -1.0, 2.0])
        level = landing_target("ardupilot", report(attitude=(0.0, 0.0, -math.pi / 2)), east_up)
        assert level.frame == 12
        assert (level.x, level.y, level.z) == pytest.approx((1.0, -2.0, 2.0))
        assert level.distance == pytest.approx(3.0)
        tilted = landing_target("ardupilot", report(attitude=(0.0, -0.3, -math.pi / 2)), east_up)
        nose = np.array([0.0, -math.cos(0.3), math.sin(0.3)])
        assert tilted.x == pytest.approx(way @ nose)

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
        message = px4(report(covariance=np.diag([0.01, 0.09]), attitude=None), east_up)
        assert (message.x, message.y, message.z) == pytest.approx((-1.0, 2.0, -2.0))
        assert (message.covariance[0], message.covariance[6]) == pytest.approx((0.01, 0.09))

    def test_land_and_origin(self):
        (message,) = said(0.0, "COMMAND_LONG", land=3)[:1]
        assert (message.target_system, message.target_component) == (1, 1)
        assert (message.command, message.confirmation) == (21, 3)
        assert (message.param1, message.param2) == (0, 0) and math.isnan(message.param5)
        assert said(0.0, "COMMAND_LONG", "ardupilot", land=0)[0].param5 == 0
        (message,) = said(7e-6, "SET_GPS_GLOBAL_ORIGIN", origin=(51.9906, 4.3768, -2.5))
        assert (message.latitude, message.longitude) == (519_906_000, 43_768_000)
        assert (message.altitude, message.time_usec) == (-2500, 7)


class TestGoldenBytes:
    """One packet of each kind: as recorded, and as a plain encoder makes it from the definition."""

    def check(self, message, plain: bytes, golden: str) -> None:
        assert packed(message).hex() == plain.hex() == golden

    def test_heartbeat(self):
        self.check(
            said(0.0, "HEARTBEAT")[0],
            plain_packet(0, 50, "IBBBBB", 0, 18, 8, 0, 4, 3),
            "fd0900000001bf000000000000001208000403aec6",
        )

    def test_vision_position_estimate(self):
        message = px4(report(resets=2))
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
        message = odometry(
            report(99e-6, covariance=np.diag([0.25, 0.25]), attitude=(0.0, 0.0, 0.0), resets=3), 77
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

    def test_gps_input(self):
        message = gps_input(report(), 1_700_000_000)
        accuracy = math.sqrt(0.10)
        plain = plain_packet(
            232, 151, "QIii9fHHBBBH", 1_234_567, 252_818_000, 520_000_180, 40_000_146, 11.0,
            accuracy, 100.0, 0.0, 0.0, 0.0, 0.0, accuracy, 10.0, 56, 2288, 0, 3, 10, 0,
        )  # fmt: skip
        assert packed(message).hex() == plain.hex()

    def test_landing_target(self):
        message = landing_target("px4", report())
        distance = math.sqrt(6.0)
        plain = plain_packet(
            149, 200, "Q5fBB3f4fBB", 1_234_567, 0.0, 0.0, distance, 0.0, 0.0, 0, 1,
            1.0, 3.0, 0.0, 1.0, 0.0, 0.0, 0.0, 3, 1,
        )  # fmt: skip
        assert packed(message).hex() == plain.hex()

    def test_set_gps_global_origin(self):
        plain = plain_packet(48, 41, "iiiBQ", 519_906_000, 43_768_000, -2500, 1, 7)
        self.check(
            said(7e-6, "SET_GPS_GLOBAL_ORIGIN", origin=(51.9906, 4.3768, -2.5))[0],
            plain,
            "fd0e00000001bf300000d022fd1ec0d89b023cf6ffff0107563a",
        )

    def test_command_long(self):
        plain = plain_packet(76, 152, "7fHBBB", 0, 0, 0, NAN, NAN, NAN, NAN, 21, 1, 1, 2)
        self.check(
            said(0.0, "COMMAND_LONG", land=2)[0],
            plain,
            (
                "fd2100000001bf4c00000000000000000000000000000000c07f0000c07f0000c07f0000c07f150001010266d8"
            ),
        )
        plain = plain_packet(76, 152, "7fHBBB", 30, 50_000, 0, 0, 0, 0, 0, 511, 1, 1, 0)
        self.check(
            said(0.0, "COMMAND_LONG")[0],
            plain,
            (
                "fd2000000001bf4c00000000f041005043470000000000000000000000000000000000000000ff0101010075"
            ),
        )
