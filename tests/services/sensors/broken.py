# SPDX-License-Identifier: Apache-2.0
"""Sensors that can have faults, for tests: readings of every kind, a model that yields them."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS, Schedule
from groundlink.messages.base import (
    POINT,
    Ack,
    BusMessage,
    Imu,
    PointCloud,
    Reading,
    State,
    WheelEncoders,
    encode,
    measured_nanos,
    packed,
)
from groundlink.messages.imagery import (
    RADAR_POINT,
    CameraInfo,
    CompressedImage,
    Image,
    LaserScan,
    RadarDetections,
    Range,
)
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.messages.navigation import NavSatFix, Odometry
from groundlink.messages.reading_schedule import ReadingSchedule
from groundlink.scenario.faults import Fault
from services.sensors.faults.fault_wrapper import FaultWrapper
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime.model import LeftOut, RememberingModel, SensorModel
from services.sensors.runtime.next_event import NextEvent
from services.sensors.runtime.reading_ledger import ReadingLedger
from services.sensors.runtime.runner import SensorProcess

EPOCH_NANOS = 1_700_000_000_000_000_000
HASH = "cd" * 32


def points(*xyz: Sequence[float]) -> np.ndarray:
    records = np.zeros(len(xyz), POINT)
    for axis, values in zip("xyz", zip(*xyz, strict=True), strict=True):
        records[axis] = values
    records["intensity"], records["ring"] = 50, np.arange(len(xyz))
    return records


RING = [(4 * np.cos(a), 4 * np.sin(a), 0.5) for a in np.radians(np.arange(0, 360, 10))]
COVARIANCE = packed(np.zeros(36))
SCAN_RANGES = np.array([1.0, 2.0, np.inf, 9.5, -np.inf, np.nan, 0.3, 5.0], np.float32)

READINGS: dict[type[Reading], Reading] = {
    PointCloud: PointCloud(0, "lidar", packed(points(*RING))),
    LaserScan: LaserScan(
        *(0, "laser", -np.pi, np.pi / 4, 0.0, 0.1, 0.25, 10.0),
        *(packed(SCAN_RANGES), packed(np.arange(1, 9, dtype=np.float32))),
    ),
    Imu: Imu(0, "imu", (0.0, 0.0, 0.0, 1.0), (0.1, 0.2, 0.3), (1.0, 2.0, 9.8), 0.0, 0.0, 0.0),
    WheelEncoders: WheelEncoders(0, "base", ("left", "right"), (100, 2**63 - 1)),
    Odometry: Odometry(
        *(0, "odom", "base", (1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8)),
        *((0.5, 0.0, 0.0), (0.0, 0.0, 0.1), COVARIANCE, COVARIANCE),
    ),
    NavSatFix: NavSatFix(0, "gps", 0, 1, 50.29, 18.68, 240.0, packed(np.eye(3)), 2),
    RadarDetections: RadarDetections(
        0, "radar", packed(np.array([(9, 1, 0, -3, 5, 20), (30, -4, 2, 7, 0, 15)], RADAR_POINT))
    ),
    Range: Range(0, "sonar", "ultrasound", 0.5, 0.25, 4.0, 1.5, 0.0),
    CompressedImage: CompressedImage(0, "camera", "jpeg", packed(np.arange(9, dtype=np.uint8))),
    Image: Image(0, "camera", 2, 3, "mono8", 3, packed(np.arange(6, dtype=np.uint8))),
    CameraInfo: CameraInfo(
        *(0, "camera", 2, 3, "plumb_bob", packed(np.zeros(5)), packed(np.eye(3))),
        *(packed(np.eye(3)), packed(np.eye(3, 4))),
    ),
}
"""One of each message that a sensor yields."""


class Repeats:
    """Yields a reading at a rate, so many ticks after its stamp as one takes to be measured."""

    def __init__(self, reading: Reading, rate_hz: float = 100.0, *, takes_ticks: int = 0) -> None:
        self._reading = reading
        self._due = NextEvent(Schedule.at(rate_hz))
        self._takes_ticks = takes_ticks
        self.restart()

    def restart(self) -> None:
        self._due.restart()
        self._first = self._tick = -1

    def settled_tick(self) -> int:
        return max(self._tick - self._takes_ticks, self._first)

    def readings(self, state: State) -> Iterator[BusMessage]:
        self._tick = state.tick
        self._first = state.tick if self._first < 0 else self._first
        begun = state.tick - self._takes_ticks
        if begun >= self._first and (event := self._due.by(begun)):
            yield stamped(self._reading, state.epoch_nanos + event.nanos)


class Counts(Repeats):
    """Says in its frame which reading it is."""

    def readings(self, state: State) -> Iterator[BusMessage]:
        for reading in super().readings(state):
            yield replace(reading, frame=str(round(100 * seconds(reading))))  # type: ignore[call-arg]


def stamped(reading: Reading, nanos: int) -> Reading:
    return replace(reading, stamp_nanos=nanos)


def wrapped(
    inner: SensorModel,
    message: type[BusMessage],
    *faults: Fault,
    seed: int = 1,
) -> FaultWrapper:
    return FaultWrapper(
        inner,
        faults=faults,
        messages={"": message},
        streams=RandomStreams(seed, "rover/it"),
    )


def states(ticks: Iterable[int]) -> Iterator[State]:
    for tick in ticks:
        yield State("run", EPOCH_NANOS, EPOCH_NANOS, tick, tick * TICK_NANOS, HASH, {})


def changed(model: RememberingModel, ticks: int) -> list[tuple[int, BusMessage]]:
    """Return what comes out, with the tick at which it does."""
    return [
        (state.tick, message)
        for state in states(range(ticks))
        for message in model.readings(state)
        if not isinstance(message, LeftOut)
    ]


def seconds(message: BusMessage) -> float:
    """Return when it was measured, in sim time."""
    return (measured_nanos(message) - EPOCH_NANOS) / NANOS


class Line:
    """What a receiver has of a sensor's process that may be started again."""

    def __init__(self) -> None:
        self.bodies: dict[int, bytes] = {}
        """By instant of measurement, in the order of arrival."""

        self.acks: list[Ack] = []
        self.gaps: list[MissingSpan] = []

    def process(
        self, model: SensorModel, world_hash: str = HASH, calendar: ReadingSchedule | None = None
    ) -> SensorProcess:
        """Return one; with a calendar it tells what of that is missing."""
        return SensorProcess(
            model,
            expected_world_hash=world_hash,
            ack_ticks=50,
            publish=self.take,
            acknowledge=self.acks.append,
            ledger=calendar and ReadingLedger("it", calendar, [""], self.miss),
        )

    def miss(self, told: MissingReadings) -> None:
        self.gaps += told.gaps

    def take(self, message: BusMessage) -> None:
        body = encode(message)
        assert self.bodies.setdefault(measured_nanos(message), body) == body
