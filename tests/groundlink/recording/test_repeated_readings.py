# SPDX-License-Identifier: Apache-2.0
"""Messages of a repeated run come in order of log time, up to what its sensors have settled."""

from collections.abc import Iterator

import pytest

from groundlink.bus.core_topics import ACK, STATE
from groundlink.bus.pipe import PipedMessage
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.messages.base import Ack, BusMessage, Imu, State, WheelEncoders, encode
from groundlink.recording.repeated_readings import RepeatedReadings

RUN, EPOCH_NANOS = "again", 1000 * NANOS
LAB = load("indoor_lab")
SENSORS = ["rover/imu", "rover/encoders"]
END_NANOS = EPOCH_NANOS + 100 * TICK_NANOS


def imu(tick: int) -> PipedMessage:
    zero = (0.0, 0.0, 0.0)
    stamp = EPOCH_NANOS + tick * TICK_NANOS
    message = Imu(
        stamp_nanos=stamp,
        frame="imu_link",
        orientation=(0.0, 0.0, 0.0, 1.0),
        angular_velocity_radps=zero,
        linear_acceleration_mps2=zero,
        orientation_variance=0.0,
        angular_velocity_variance=0.0,
        linear_acceleration_variance=0.0,
    )
    return of_sensor("imu", message)


def encoders(tick: int) -> PipedMessage:
    names = tuple(shaft.name for shaft in LAB.vehicles[0].model.counted)
    stamp = EPOCH_NANOS + tick * TICK_NANOS
    ticks = tuple(tick for _ in names)
    return of_sensor(
        "encoders",
        WheelEncoders(stamp_nanos=stamp, frame="base_link", names=names, ticks=ticks),
    )


def of_sensor(kind: str, message: BusMessage) -> PipedMessage:
    key = SENSOR_TOPICS[kind].key_in(RUN, vehicle="rover", sensor=kind)
    return PipedMessage(key, encode(message))


def ack(sensor: str, settled_tick: int) -> PipedMessage:
    return PipedMessage(ACK.key_in(RUN, process=sensor), encode(Ack(1, settled_tick, settled_tick)))


def acks(settled_tick: int) -> list[PipedMessage]:
    return [ack(sensor, settled_tick) for sensor in SENSORS]


def state(tick: int) -> PipedMessage:
    sim_nanos = tick * TICK_NANOS
    message = State(RUN, 1, EPOCH_NANOS, tick, sim_nanos, "", {})
    return PipedMessage(STATE.key_in(RUN), encode(message))


def read(messages: list[PipedMessage], *topics: str) -> list[tuple[str, int]]:
    """Return topic and tick of each message."""
    readings = RepeatedReadings(LAB, RUN, EPOCH_NANOS)
    found = readings.read(messages, topics, SENSORS, END_NANOS)
    return [(each.topic, (each.nanos - EPOCH_NANOS) // TICK_NANOS) for each in found]


def test_messages_are_sorted_by_time_then_topic() -> None:
    messages = [imu(1), imu(2), imu(3), encoders(2), *acks(50), imu(60), encoders(55), *acks(100)]
    assert read(messages, "/imu", "/wheel_encoders") == [
        *(("/imu", 1), ("/imu", 2), ("/wheel_encoders", 2), ("/imu", 3)),
        *(("/wheel_encoders", 55), ("/imu", 60)),
    ]


def test_only_asked_topics_are_read_and_what_follows_from_readings_is_one() -> None:
    messages = [imu(1), encoders(2), state(3), *acks(130)]
    assert read(messages, "/joint_states") == [("/joint_states", 2)]
    assert read(messages, "/imu") == [("/imu", 1)]


def test_what_is_not_newer_or_after_the_end_is_left_out() -> None:
    messages = [imu(5), imu(5), imu(4), imu(100), *acks(100), imu(101)]
    assert read(messages, "/imu") == [("/imu", 5)]


def test_messages_are_yielded_before_the_run_ends() -> None:
    def messages() -> Iterator[PipedMessage]:
        yield from (imu(1), *acks(50))
        pytest.fail("the first message was complete")

    readings = RepeatedReadings(LAB, RUN, EPOCH_NANOS)
    assert next(readings.read(messages(), ["/imu"], SENSORS, END_NANOS)).topic == "/imu"


def test_a_sensor_that_never_settles_is_given_up() -> None:
    readings = RepeatedReadings(LAB, RUN, EPOCH_NANOS)
    last = (readings.given_up_nanos(END_NANOS) - EPOCH_NANOS) // TICK_NANOS
    assert read([imu(1), ack("rover/imu", 200), state(last)], "/imu") == [("/imu", 1)]
    with pytest.raises(UserError, match="ended before its sensors had measured all"):
        read([imu(1), ack("rover/imu", 200), state(last - 1)], "/imu")
