# SPDX-License-Identifier: Apache-2.0
"""What was recorded becomes the same bytes again, whatever the message was."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundlink.core.clock import TICK_NANOS
from groundlink.episode.fault_messages import Faults
from groundlink.messages import imagery, navigation
from groundlink.messages.base import (
    POINT,
    BadBusMessage,
    BusMessage,
    Clock,
    Command,
    Imu,
    PointCloud,
    WheelEncoders,
)
from groundlink.messages.ground_truth import (
    LABELED_POINT,
    TRUE_POINT,
    Bodies,
    Contact,
    Detections2D,
    Detections3D,
    LabeledPoints,
    LabelTable,
    TruePoints,
    Vitals,
)
from groundlink.messages.missing_readings import CAUSES, MissingReadings, MissingSpan
from groundlink.ros.cdr import CODECS, from_cdr, to_cdr
from groundlink.ros.codec import Moment
from groundlink.scenario.faults import Bias, Stuck

STAMP = st.integers(0, (2**31 - 1) * 10**9)
FRAME = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
NUMBER = st.floats(allow_nan=False)
SMALL = st.floats(width=32, allow_nan=False) | st.floats(-1e3, 1e3)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
QUATERNION = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER)
SIZE = st.integers(0, 2**32 - 1)


def numbers(count: int, size: int = 8) -> st.SearchStrategy[memoryview]:
    return st.binary(min_size=count * size, max_size=count * size).map(memoryview)


@st.composite
def image(draw: Any) -> imagery.Image:
    height, row = draw(st.integers(0, 4)), draw(st.integers(0, 9))
    return imagery.Image(
        draw(STAMP),
        draw(FRAME),
        height,
        draw(SIZE),
        draw(FRAME),
        row,
        draw(numbers(height * row, 1)),
    )


@st.composite
def scan(draw: Any) -> imagery.LaserScan:
    count = draw(st.integers(0, 700))
    ranges = draw(numbers(count, 4))
    intensities = draw(st.sampled_from([ranges, memoryview(b"")]))
    angles = [draw(st.floats(-10, 10)), draw(st.floats(-0.1, 0.1))]
    return imagery.LaserScan(
        draw(STAMP), draw(FRAME), *angles, *(draw(SMALL) for _ in range(4)), ranges, intensities
    )


@st.composite
def grid(draw: Any) -> navigation.OccupancyGrid:
    width, height = draw(st.integers(0, 5)), draw(st.integers(0, 5))
    return navigation.OccupancyGrid(
        draw(STAMP),
        draw(FRAME),
        draw(STAMP),
        draw(SMALL),
        width,
        height,
        draw(VECTOR),
        draw(QUATERNION),
        draw(numbers(width * height, 1)),
    )


@st.composite
def joints(draw: Any) -> navigation.JointState:
    names = tuple(draw(st.lists(FRAME, max_size=4)))
    full = numbers(len(names)) | st.just(memoryview(b""))
    return navigation.JointState(
        draw(STAMP), draw(FRAME), names, draw(full), draw(full), draw(full)
    )


@st.composite
def encoders(draw: Any) -> WheelEncoders:
    wheels = draw(st.lists(st.tuples(FRAME, st.integers(-(2**63), 2**63 - 1)), max_size=5))
    names, ticks = zip(*wheels, strict=True) if wheels else ((), ())
    return WheelEncoders(draw(STAMP), draw(FRAME), names, ticks)


@st.composite
def bodies(draw: Any) -> Bodies:
    names = draw(st.lists(FRAME, min_size=1, max_size=4))
    return Bodies(draw(STAMP), tuple(names), draw(numbers(7 * len(names))))


@st.composite
def detections(draw: Any, message: type[Detections2D | Detections3D], columns: int) -> Any:
    names = tuple(draw(st.lists(FRAME, max_size=3)))
    count = len(names)
    arrays = draw(numbers(count, 2)), draw(numbers(count)), draw(numbers(columns * count))
    return message(draw(STAMP), draw(FRAME), names, *arrays)


@st.composite
def tables(draw: Any) -> LabelTable:
    names = tuple(draw(st.lists(FRAME, max_size=4)))
    return LabelTable(draw(STAMP), draw(FRAME), names, draw(numbers(len(names), 2)))


TICK = st.integers(0, 10**9)
CONTACT = st.builds(Contact, FRAME, st.floats(0, 1e6), TICK, TICK)
MISSING_SPAN = st.builds(
    MissingSpan,
    *(st.sampled_from(sorted(CAUSES)), STAMP, STAMP, st.integers(1, 9)),
    st.lists(FRAME, max_size=3).map(tuple),
)
FAULT = st.builds(Stuck, at_s=st.floats(0, 1e4)) | st.builds(Bias, value=st.floats(-9, 9))
TRANSFORM = st.builds(navigation.Transform, STAMP, FRAME, FRAME, VECTOR, QUATERNION)

ANY: dict[type[BusMessage], st.SearchStrategy[Any]] = {
    Clock: st.builds(Clock, STAMP, st.just(0), st.just(0)),
    Command: st.builds(Command, STAMP, VECTOR, VECTOR),
    Imu: st.builds(Imu, STAMP, FRAME, QUATERNION, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER),
    PointCloud: st.builds(
        PointCloud, STAMP, FRAME, st.integers(0, 9).flatmap(lambda n: numbers(n, POINT.itemsize))
    ),
    TruePoints: st.builds(
        TruePoints,
        *(STAMP, FRAME, st.integers(0, 9).flatmap(lambda n: numbers(n, TRUE_POINT.itemsize))),
    ),
    LabeledPoints: st.builds(
        LabeledPoints,
        *(STAMP, FRAME, st.integers(0, 9).flatmap(lambda n: numbers(n, LABELED_POINT.itemsize))),
    ),
    imagery.RadarDetections: st.builds(
        imagery.RadarDetections,
        *(STAMP, FRAME, st.integers(0, 9).flatmap(lambda n: numbers(n, 24))),
    ),
    LabelTable: tables(),
    Detections2D: detections(Detections2D, 4),
    Detections3D: detections(Detections3D, 10),
    WheelEncoders: encoders(),
    imagery.Image: image(),
    imagery.CompressedImage: st.builds(
        imagery.CompressedImage, STAMP, FRAME, FRAME, st.binary(max_size=50).map(memoryview)
    ),
    imagery.CameraInfo: st.builds(
        imagery.CameraInfo,
        *(STAMP, FRAME, SIZE, SIZE, FRAME),
        st.integers(0, 8).flatmap(numbers),
        *(numbers(9), numbers(9), numbers(12)),
    ),
    imagery.LaserScan: scan(),
    imagery.Range: st.builds(
        imagery.Range,
        *(STAMP, FRAME, st.sampled_from(["ultrasound", "infrared"])),
        *(SMALL, SMALL, SMALL, SMALL, SMALL),
    ),
    navigation.PoseStamped: st.builds(navigation.PoseStamped, STAMP, FRAME, VECTOR, QUATERNION),
    navigation.Odometry: st.builds(
        navigation.Odometry,
        *(STAMP, FRAME, FRAME, VECTOR, QUATERNION, VECTOR, VECTOR, numbers(36), numbers(36)),
    ),
    navigation.OccupancyGrid: grid(),
    navigation.Transforms: st.lists(TRANSFORM, min_size=1, max_size=3).map(
        lambda rows: navigation.Transforms(tuple(rows))
    ),
    navigation.JointState: joints(),
    navigation.Text: st.builds(navigation.Text, STAMP, FRAME),
    navigation.NavSatFix: st.builds(
        navigation.NavSatFix,
        *(STAMP, FRAME, st.integers(-2, 2), st.integers(0, 2**16 - 1), NUMBER, NUMBER, NUMBER),
        *(numbers(9), st.integers(0, 3)),
    ),
    Bodies: bodies(),
    Faults: st.builds(Faults, STAMP, FRAME, TICK, st.lists(FAULT, max_size=3).map(tuple)),
    MissingReadings: st.builds(
        MissingReadings, STAMP, FRAME, st.lists(MISSING_SPAN, max_size=3).map(tuple)
    ),
    Vitals: st.builds(
        Vitals,
        *(STAMP, FRAME, TICK, NUMBER, NUMBER),
        st.lists(CONTACT, max_size=3, unique_by=lambda contact: contact.name).map(tuple),
    ),
}


def test_every_message_that_is_recorded_is_here() -> None:
    assert ANY.keys() == CODECS.keys()


@pytest.mark.parametrize("message_type", ANY, ids=lambda kind: kind.__name__)
def test_what_was_recorded_becomes_the_same_bytes(message_type: type[BusMessage]) -> None:
    @settings(max_examples=60)
    @given(ANY[message_type])
    def holds(message: BusMessage) -> None:
        cdr = to_cdr(message)
        assert to_cdr(from_cdr(cdr, message_type, Moment(0, 0))) == cdr

    holds()


def test_a_clock_has_its_tick_again() -> None:
    clock = Clock(5_000_000_123 + 77 * TICK_NANOS, 5_000_000_123, 77, 5_000_000_123)
    moment = Moment(clock.stamp_nanos, clock.epoch_nanos)
    assert from_cdr(to_cdr(clock), Clock, moment) == clock


def test_a_command_is_of_the_time_when_it_was_recorded() -> None:
    command = Command(17, (1.0, 0.0, 0.0), (0.0, 0.0, -0.5))
    assert from_cdr(to_cdr(command), Command, Moment(17, 0)) == command


@pytest.mark.parametrize("cut", [0, 3, 40])
def test_invalid_message_is_refused(cut: int) -> None:
    cdr = to_cdr(PointCloud(1, "f", memoryview(bytes(POINT.itemsize))))
    with pytest.raises(BadBusMessage, match="no PointCloud in this"):
        from_cdr(cdr[:cut], PointCloud, Moment(0, 0))
