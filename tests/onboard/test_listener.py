"""Which of the voices on the wire counts: an autopilot among gimbals, stations, other vehicles."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from onboard_autopilot import ATTITUDE, AUTOPILOT_HEARTBEAT, IN_AIR  # noqa: E402
from onboard_autopilot import from_autopilot as said_by  # noqa: E402
from onboard_tools import make_fix  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from trexton.onboard.fix import LocalFrame  # noqa: E402
from trexton.onboard.mavlink.link import UdpIn  # noqa: E402
from trexton.onboard.mavlink.listener import Listener  # noqa: E402
from trexton.onboard.mavlink.messages import PROFILES  # noqa: E402
from trexton.onboard.mavlink.speaker import Speaker  # noqa: E402
from trexton.vision.camera import rotation_matrix  # noqa: E402

GIMBAL = mavlink.MAVLink_heartbeat_message(26, 0, 0, 0, 4, 3)


def listener(*systems, **options) -> Listener:
    made = Listener(**options)
    for system in systems:
        made.hear(said_by(AUTOPILOT_HEARTBEAT, system), 0.0)
        made.hear(said_by(IN_AIR, system), 0.0)
    return made


def speaker(ear: Listener, name="px4") -> Speaker:
    profile = PROFILES[name](LocalFrame(), (0.0, 5.0, 0.0, 5.0))
    return Speaker(profile, 0.01 * np.eye(2), ear)


def test_a_gimbal_is_no_autopilot():
    ear = Listener()
    ear.hear(said_by(GIMBAL, component=154), 0.0)
    assert ear.target is None
    ear.hear(said_by(AUTOPILOT_HEARTBEAT), 1.0)
    ear.hear(said_by(GIMBAL, component=154), 9.0)
    assert ear.target == (1, 1) and not ear.present(9.0)  # its life is not the autopilot's


@pytest.mark.parametrize("kind", [18, 26, 27])  # onboard controller, gimbal, ADS-B
def test_what_names_an_autopilot_and_is_none_is_no_target(kind):
    """A gimbal that is heard first, and names ArduPilot, was commanded to land."""
    ear = Listener()
    ear.hear(said_by(mavlink.MAVLink_heartbeat_message(kind, 3, 0, 0, 4, 3), component=154), 0.0)
    assert ear.target is None and not speaker(ear).land(0, 0.0)
    ear.hear(said_by(AUTOPILOT_HEARTBEAT), 1.0)
    assert ear.target == (1, 1)


@pytest.mark.parametrize("kind", [1, 2, 10, 11, 13, 20, 29])  # what flies, drives or swims
def test_a_vehicle_is_one_whatever_its_component(kind):
    """A flight controller whose MAV_COMP_ID had been changed was never heard."""
    ear = Listener()
    ear.hear(said_by(mavlink.MAVLink_heartbeat_message(kind, 12, 128, 0, 4, 3), component=7), 0.0)
    ear.hear(said_by(IN_AIR, component=7), 0.0)
    assert ear.target == (1, 7) and speaker(ear).land(0, 0.0)


def test_two_autopilots_of_one_system_are_told_of_and_neither_is_landed():
    for named in ((None, None), (1, None)):
        ear = listener(1, named=named)
        assert ear.certain
        ear.hear(said_by(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3), component=7), 0.0)
        assert not ear.certain and not speaker(ear).land(0, 0.0)
        assert {"event": "several vehicles", "heard": "1/1, 1/7"}.items() <= ear.news[-1].items()


def test_a_component_that_is_named_is_the_target_whatever_it_says_it_is():
    ear = Listener((1, 5))
    ear.hear(said_by(AUTOPILOT_HEARTBEAT), 0.0)
    ear.hear(said_by(AUTOPILOT_HEARTBEAT, 2, 5), 0.0)
    assert ear.target is None
    ear.hear(said_by(GIMBAL, component=5), 1.0)
    assert ear.target == (1, 5) and ear.certain


def test_who_never_says_whether_he_stands_is_landed_after_a_while():
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 128, 0, 4, 3)
    ear = Listener()
    talk, lands = speaker(ear), []
    for now in range(12):
        ear.hear(said_by(beat), float(now))
        lands += [now] * talk.land(0, float(now))
    assert lands == [*range(6, 12)]


def test_a_vehicle_that_comes_later_takes_no_attitude_away():
    """ArduPilot takes no position without it: the one in flight would lose its own."""
    ear = listener(7)
    other = Listener(heard=ear.heard)  # of a second link
    for each in (other, ear):
        each.hear(said_by(AUTOPILOT_HEARTBEAT, 1), 80.0)
    ear.hear(said_by(mavlink.MAVLink_attitude_message(5000, *ATTITUDE, 0, 0, 0), 7), 80.0)
    assert not ear.certain and not ear.doubted and not other.doubted
    assert ear.attitude(80.0) is not None and ear.aiding(80.0).roll is not None


@pytest.mark.parametrize("armed", [True, False])
def test_nobody_is_landed_who_may_stand(armed):
    """Just heard, disarmed, or silent since it stood: the command went out on the ground."""
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 128 * armed, 0, 4, 3)
    stands = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_ON_GROUND)
    ear = Listener()
    talk, lands = speaker(ear), []
    for now in range(30):
        if not 8 <= now < 14:
            ear.hear(said_by(beat), float(now))
        if now in (6, 7):
            ear.hear(said_by(stands), float(now))
        if now == 25:
            ear.hear(said_by(IN_AIR), float(now))
        if talk.land(0, float(now)):
            lands.append(now)
    assert lands == [*range(25, 30)] * armed
    assert (ear.on_ground(29.0) is True) is not armed


def test_nobody_s_attitude_is_used_while_it_is_in_doubt_who_is_ours():
    ear = listener(7)
    heard = mavlink.MAVLink_attitude_message(5000, *ATTITUDE, 0, 0, 0)
    ear.hear(said_by(heard, 7), 1.0)
    assert ear.attitude(1.0) is not None and ear.aiding(1.0).roll is not None
    ear.hear(said_by(AUTOPILOT_HEARTBEAT, 1), 1.0)
    assert ear.attitude(1.0) is None and ear.aiding(1.0).roll is None


def test_only_the_target_is_told_the_time():
    ear = listener(1)
    request = mavlink.MAVLink_timesync_message(0, 5)
    ear.hear(said_by(request, component=154), 0.0)
    ear.hear(said_by(request, system=9), 0.0)
    assert not ear.timesyncs
    ear.hear(said_by(request), 0.0)
    assert len(ear.timesyncs) == 1


def test_two_vehicles_are_told_of_and_neither_is_landed():
    ear = listener(7, 1)
    assert not ear.certain and any(news["event"] == "several vehicles" for news in ear.news)
    assert not speaker(ear).land(0, 0.0)
    named = listener(7, 1, named=(1, None))
    talk = speaker(named)
    assert named.target == (1, 1) and talk.land(0, 0.0)
    assert [m.target_system for m in talk.due(0.0) if m.get_type() == "COMMAND_LONG"][0] == 1


def test_the_first_that_is_heard_stays_the_target():
    ear = listener(7)
    ear.hear(said_by(AUTOPILOT_HEARTBEAT, 1), 60.0)
    assert ear.target == (7, 1) and not ear.present(60.0) and not ear.certain


def test_what_was_said_of_position_and_ground_grows_old():
    ear = listener(1)
    ear.hear(said_by(mavlink.MAVLink_estimator_status_message(0, 8, *[0.0] * 8)), 1.0)
    ear.hear(said_by(mavlink.MAVLink_extended_sys_state_message(0, 1)), 1.0)
    assert ear.fused(2.0) is True and ear.on_ground(2.0) is True
    assert ear.fused(60.0) is None and ear.on_ground(60.0) is None


@pytest.mark.parametrize(
    ("target", "ours"), [((0, 0), True), ((1, 191), True), ((255, 191), False), ((1, 190), False)]
)
def test_an_answer_counts_only_if_it_is_for_us(target, ours):
    ear = listener(1)
    ear.hear(said_by(mavlink.MAVLink_command_ack_message(21, 0, 0, 0, *target)), 0.0)
    assert bool(ear.answers) == ours
    ear.hear(said_by(mavlink.MAVLink_command_ack_message(511, 0, 0, 0, *target)), 0.0)
    assert len(ear.answers) == ours  # to another command than a landing


def test_a_refusal_to_another_companion_of_the_vehicle_is_none_to_us():
    ear = listener(1, component=192)
    ear.hear(said_by(mavlink.MAVLink_command_ack_message(21, 2, 0, 0, 1, 191)), 0.0)
    assert not ear.answers
    ear.hear(said_by(mavlink.MAVLink_command_ack_message(21, 0, 0, 0, 1, 192)), 0.0)
    assert ear.answers


def test_aiding_is_in_the_maps_axes_and_of_the_moment():
    ear = listener(1, local=LocalFrame(math.pi / 2))  # the map's +y points east
    ear.hear(said_by(mavlink.MAVLink_attitude_message(0, 0.1, -0.2, math.pi / 2, 0, 0, 0)), 10.0)
    ear.hear(said_by(mavlink.MAVLink_distance_sensor_message(0, 10, 900, 150, 0, 0, 25, 0)), 10.0)
    ear.hear(said_by(mavlink.MAVLink_local_position_ned_message(0, 0, 0, 0, 0, 0.5, 0)), 10.0)
    known = ear.aiding(10.1)
    above = 1.5 * math.cos(0.1) * math.cos(0.2)  # the sensor looks along the tilted axis
    assert (known.roll, known.pitch, known.height) == pytest.approx((0.1, -0.2, above))
    assert known.yaw == pytest.approx(0.0, abs=1e-6)  # the nose points along +y
    assert known.velocity == pytest.approx([0.0, 0.5])
    late = ear.aiding(12.0)
    assert late.roll is None and late.height is None and late.velocity is None


@pytest.mark.parametrize(("quality", "told"), [(0, 1.5), (1, None), (2, 1.5), (100, 1.5)])
def test_a_distance_of_which_the_sensor_says_that_it_is_none(quality, told):
    ear = listener(1)
    distance = mavlink.MAVLink_distance_sensor_message(
        0, 10, 900, 150, 0, 0, 25, 0, signal_quality=quality
    )
    ear.hear(said_by(distance), 10.0)
    assert ear.aiding(10.0).height == told


@pytest.mark.parametrize("heading", [0.0, 0.6, -2.0])
@pytest.mark.parametrize("compass", [0.0, 1.0, -2.5])
def test_the_yaw_of_an_autopilot_is_that_of_a_camera(heading, compass):
    local = LocalFrame(heading)
    ear = listener(1, local=local)
    ear.hear(said_by(mavlink.MAVLink_attitude_message(0, 0, 0, compass, 0, 0, 0)), 10.0)
    nose = rotation_matrix(0.0, 0.0, ear.aiding(10.0).yaw) @ (0, 1, 0)
    assert local.ned_from_map @ nose[:2] == pytest.approx([math.cos(compass), math.sin(compass)])


@pytest.mark.parametrize(
    ("aiding", "wanted"), [("none", set()), ("tilt", {132}), ("all", {132, 32})]
)
def test_it_asks_for_what_helps(aiding, wanted):
    ear = listener(1)
    profile = PROFILES["px4"](LocalFrame(), (0.0, 5.0, 0.0, 5.0))
    talk = Speaker(profile, np.eye(2), ear, aiding=aiding)
    asked = {m.param1 for m in talk.due(0.0) if m.get_type() == "COMMAND_LONG"}
    assert asked & {132, 32} == wanted  # DISTANCE_SENSOR, LOCAL_POSITION_NED
    ear.hear(said_by(mavlink.MAVLink_distance_sensor_message(0, 10, 900, 150, 0, 0, 25, 0)), 3.0)
    asked = {m.param1 for m in talk.due(3.0) if m.get_type() == "COMMAND_LONG"}
    assert asked & {132, 32} == wanted - {132}


def test_a_landing_is_not_pushed_out_by_requests():
    talk = speaker(listener(1))
    assert talk.land(0, 0.0)
    for number in range(100):
        talk.listener.hear(said_by(mavlink.MAVLink_timesync_message(0, number + 1)), 0.0)
    kinds = [message.get_type() for message in talk.due(0.0)]
    assert "COMMAND_LONG" in kinds and kinds.count("TIMESYNC") == 16


def test_a_slow_step_is_not_sent_as_fresh():
    talk = speaker(listener(1))
    talk.tell(make_fix(10.0), 11.2)  # captured 1.2 s ago
    assert not [m for m in talk.due(11.2) if m.get_type() == "VISION_POSITION_ESTIMATE"]


def test_a_stray_byte_takes_nobodys_place():
    link = UdpIn("127.0.0.1", 1)
    sent = []
    link._wire = type(  # a socket on paper
        "Wire", (), {"recvfrom": lambda self, size: (b"x", self.sender),
                     "sendto": lambda self, data, peer: sent.append(peer)}
    )()  # fmt: skip
    link._wire.sender = ("10.0.0.1", 5)
    link.receive()
    link.understood()
    link._wire.sender = ("10.0.0.9", 9)
    link.receive()  # not understood
    link.send(b"position")
    assert sent == [("10.0.0.1", 5)]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=8))
def test_no_bytes_harm_the_conversation(pieces):
    ear = listener(1)
    talk, codec = speaker(ear), mavlink.MAVLink(None)
    codec.robust_parsing = True
    for piece in pieces:
        for message in codec.parse_buffer(piece) or []:
            ear.hear(message, 1.0)
    assert all(message.pack(mavlink.MAVLink(None)) for message in talk.due(1.0))


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_no_message_harms_the_conversation(data):
    """Every kind that is listened to, with any values in its fields."""
    kinds = {
        mavlink.MAVLink_attitude_message: (mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)),
        mavlink.MAVLink_heartbeat_message: AUTOPILOT_HEARTBEAT,
        mavlink.MAVLink_command_ack_message: mavlink.MAVLink_command_ack_message(21, 0),
        mavlink.MAVLink_gps_global_origin_message: mavlink.MAVLink_gps_global_origin_message(
            1, 2, 3, 0
        ),
        mavlink.MAVLink_statustext_message: mavlink.MAVLink_statustext_message(3, b"text"),
        mavlink.MAVLink_timesync_message: mavlink.MAVLink_timesync_message(0, 5),
        mavlink.MAVLink_distance_sensor_message: mavlink.MAVLink_distance_sensor_message(
            0, 10, 900, 150, 0, 0, 25, 0
        ),
    }
    ear = listener(1)
    talk = speaker(ear, data.draw(st.sampled_from(["px4", "ardupilot"])))
    for _ in range(5):
        base = data.draw(st.sampled_from(list(kinds.values())))
        packet = bytearray(base.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))
        message = mavlink.MAVLink(None).parse_buffer(bytes(packet))[0]
        for name in message.fieldnames:
            value = getattr(message, name)
            if isinstance(value, float):
                setattr(message, name, data.draw(st.floats(width=32)))
            elif isinstance(value, int):
                setattr(message, name, data.draw(st.integers(0, 255)))
        ear.hear(message, 1.0)
    talk.tell(make_fix(1.0), 1.0)
    for message in talk.due(1.0):
        message.pack(mavlink.MAVLink(None))


def test_an_attitude_in_degrees_is_said_and_not_used():
    ear = listener(1)
    for stamp, angles in enumerate([(5.0, -8.0, 84.0), (0.0, 2.0, 0.0), (math.nan, 0, 0)], 1):
        ear.hear(said_by(mavlink.MAVLink_attitude_message(0, *angles, 0, 0, 0)), stamp)
        assert ear.attitude(stamp) is None
    odd = [each for each in ear.news if "attitude" in each["event"]]
    assert len(odd) == 1 and odd[0]["angles"] == (5.0, -8.0, 84.0)
    ear.hear(said_by(mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)), 9.0)
    assert ear.attitude(9.0) == pytest.approx(ATTITUDE)
