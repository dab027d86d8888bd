# SPDX-License-Identifier: Apache-2.0
"""A sensor with faults that is started again in their midst goes on with the same bytes."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import BusMessage, Imu, PointCloud, State, WheelEncoders
from groundlink.messages.imagery import CameraInfo, CompressedImage
from groundlink.messages.reading_schedule import Events
from groundlink.scenario.faults import (
    Bias,
    Delay,
    Drift,
    Drop,
    Fault,
    NoiseBurst,
    Off,
    RateChange,
    Stuck,
    TimeJump,
)
from services.sensors.encoders.model import EncodersModel
from services.sensors.encoders.spec import Encoders
from services.sensors.faults.fault_wrapper import FaultWrapper
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import InertialUnit
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime.model import (
    LeftOut,
    RemovedSensor,
    SensorModel,
    StreamMessage,
    stream_and_message,
)
from tests.services.sensors.broken import READINGS, Counts, Line, Repeats, stamped, wrapped
from tests.services.sensors.states import WHEELS, scenario
from tests.services.sensors.states import states as moving_states

TICKS = 1200
SPAN = {"at_s": 0.5, "for_s": 1.5}

NUMERIC: list[Fault] = [
    Bias(value=3.0, **SPAN),
    Drift(per_s=5.0, **SPAN),
    NoiseBurst(stddev=4.0, **SPAN),
]
TIMED: list[Fault] = [
    Off(**SPAN),
    Stuck(**SPAN),
    TimeJump(offset_s=-2.0, **SPAN),
    Delay(delay_s=0.3, **SPAN),
    Drop(share=0.5, **SPAN),
    RateChange(rate_hz=7.0, **SPAN),
]
FAULTS: dict[str, tuple[Fault, ...]] = {
    **{fault.kind: (fault,) for fault in (*NUMERIC, *TIMED)},
    "late_and_stuck": (Stuck(at_s=1.2, for_s=0.4), Delay(delay_s=0.5, **SPAN)),
    "late_noise_in_a_jump": (NUMERIC[2], TimeJump(offset_s=0.7, **SPAN), Delay(delay_s=1.0)),
    "all": (*NUMERIC, *(fault for fault in TIMED if not isinstance(fault, Off))),
}


def run() -> list[State]:
    rng = np.random.default_rng(3)
    angles = np.cumsum(rng.normal(scale=0.05, size=(TICKS, len(WHEELS))), axis=0)
    places = np.cumsum(rng.normal(scale=1e-5, size=(TICKS, 3)), axis=0)
    return list(moving_states(places, joint_positions=angles))


STATES = run()


def imu() -> tuple[SensorModel, type[BusMessage]]:
    made = scenario()
    spec = InertialUnit(name="imu", topic="/imu", frame="imu", rate_hz=130.0)
    return ImuModel(made, made.vehicles[0], spec), Imu


def encoders() -> tuple[SensorModel, type[BusMessage]]:
    made = scenario()
    spec = Encoders(
        *("encoders", "/wheels", "base"), missed_ticks=0.2, resets_s=(1.0,), rate_hz=60.0
    )
    return EncodersModel(made, made.vehicles[0], spec), WheelEncoders


def lidar() -> tuple[SensorModel, type[BusMessage]]:
    return Counts(READINGS[PointCloud], 10.0, takes_ticks=40), PointCloud


KINDS = {"imu": imu, "encoders": encoders, "lidar": lidar}


def model(
    kind: Callable[[], tuple[SensorModel, type[BusMessage]]], faults: tuple[Fault, ...]
) -> FaultWrapper:
    inner, message = kind()
    return wrapped(inner, message, *faults)


def played(
    kind: Callable[[], tuple[SensorModel, type[BusMessage]]],
    faults: tuple[Fault, ...],
    crashes: tuple[int, ...] = (),
) -> list[tuple[int, bytes]]:
    """Return what arrives, in order, of a sensor that ends after the states of some ticks."""
    return list(line_of(kind, faults, crashes).bodies.items())


def line_of(
    kind: Callable[[], tuple[SensorModel, type[BusMessage]]],
    faults: tuple[Fault, ...],
    crashes: tuple[int, ...] = (),
    calendar: Events | None = None,
) -> Line:
    line = Line()
    process = line.process(model(kind, faults), world_hash="", calendar=calendar)
    for state in STATES:
        process.take(state)
        if state.tick in crashes:
            process = line.process(model(kind, faults), world_hash="", calendar=calendar)
            process.resume(line.acks[-1])
            for missed in STATES[: state.tick + 1]:
                process.take(missed)
    process.report_progress()
    return line


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", FAULTS)
def test_a_restart_goes_on_with_the_same_bytes(kind: str, name: str) -> None:
    whole = played(KINDS[kind], FAULTS[name])
    assert (whole != played(KINDS[kind], ())) == (name != "delay")  # which alters no byte
    for crashes in ((199, 437), (230, 301, 777), (555, 640, 1100), (801, 803, 870)):
        assert played(KINDS[kind], FAULTS[name], crashes) == whole, crashes


RATES_HZ = {"imu": 130.0, "encoders": 60.0, "lidar": 10.0}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", FAULTS)
def test_due_readings_are_published_or_reported_under_their_fault(kind: str, name: str) -> None:
    """Also where the sensor is started again in the midst of it, which is no gap of its own."""
    due = Events(RATES_HZ[kind], first=2 if kind == "imu" else 0)
    line = line_of(KINDS[kind], FAULTS[name], (301, 640), due)
    came = {due.at_or_after(nanos - STATES[0].epoch_nanos) for nanos in line.bodies}
    missing: set[int] = set()
    for gap in line.gaps:
        first, last = (
            due.at_or_after(nanos - STATES[0].epoch_nanos)
            for nanos in (gap.first_nanos, gap.last_nanos)
        )
        assert gap.readings == last - first + 1
        assert gap.cause in {fault.kind for fault in FAULTS[name]}
        missing |= {*range(first, last + 1)}
    assert not came & missing
    late_ticks = 0 if name != "late_noise_in_a_jump" else 400
    over = due.at_or_after((TICKS - late_ticks - 40) * TICK_NANOS)
    assert {*range(due.first, over)} <= came | missing
    assert bool(missing) == any(fault.kind in REMOVING for fault in FAULTS[name])


REMOVING = {"off", "drop", "rate_change"}


def test_a_live_fault_outlives_its_process_but_not_the_episode() -> None:
    faults = (Bias(value=1.0),)
    before = model(encoders, faults)
    before.faults = (*before.faults, Stuck(at_s=1.0))
    after = model(encoders, faults)
    after.remember(before.memory())
    assert after.faults == (Bias(value=1.0), Stuck(at_s=1.0))
    after.remember(b"")
    assert after.faults == faults


def test_a_gap_in_the_states_loses_nothing_that_is_on_its_way() -> None:
    late = wrapped(Repeats(READINGS[Imu]), Imu, Delay(delay_s=0.1))
    came = [m for s in STATES[:100] for m in late.readings(s)]
    late.restart()
    came += [m for s in STATES[110:200] for m in late.readings(s)]
    # Events at ticks 0, 4, ... 96, then 112 and so on; the last 40 ticks are on their way.
    assert len(came) == 25 + (200 - 40 - 112) // 4


def test_without_faults_nothing_is_touched() -> None:
    whole = [m for s in STATES for m in Repeats(READINGS[PointCloud]).readings(s)]
    none = wrapped(Repeats(READINGS[PointCloud]), PointCloud)
    assert [m for s in STATES for m in none.readings(s)] == whole


class Films(Counts):
    """Yields pictures, and beside each what a camera says of it."""

    def __init__(self) -> None:
        super().__init__(READINGS[CompressedImage], 40.0)

    def readings(self, state: State) -> Iterator[BusMessage | StreamMessage]:  # type: ignore[override]
        for picture in super().readings(state):
            stamp_nanos: int = picture.stamp_nanos  # type: ignore[attr-defined]
            yield StreamMessage("camera_info", stamped(READINGS[CameraInfo], stamp_nanos))
            yield picture


@pytest.mark.parametrize("fault", TIMED, ids=lambda fault: fault.kind)
def test_the_streams_of_a_sensor_fail_as_one(fault: Fault) -> None:
    def camera() -> FaultWrapper:
        return FaultWrapper(
            Films(),
            faults=(fault,),
            messages={"": CompressedImage, "camera_info": CameraInfo},
            streams=RandomStreams(1, "rover/camera"),
        )

    def said(model: FaultWrapper, states: list[State]) -> list[tuple[int, str, BusMessage]]:
        return [
            (s.tick, *stream_and_message(made))
            for s in states
            for made in model.readings(s)
            if not isinstance(made, LeftOut)
        ]

    first = camera()
    before, settled, memory = said(first, STATES[:501]), first.settled_tick(), first.memory()
    after = said(first, STATES[501:])
    whole = [*before, *after]
    pictures = [(tick, m.stamp_nanos) for tick, name, m in whole if not name]  # type: ignore[attr-defined]
    infos = [(tick, m.stamp_nanos) for tick, name, m in whole if name]  # type: ignore[attr-defined]
    assert pictures == infos != []
    assert [m for _, _, m in whole] != [m for _, _, m in said(faulty_free(), STATES)] or (
        fault.kind == "delay"
    )
    successor = camera()
    successor.remember(memory)
    again = said(successor, STATES[settled + 1 :])
    assert [row for row in again if row[0] > 500] == after


def faulty_free() -> FaultWrapper:
    return FaultWrapper(Films(), faults=(), messages={}, streams=RandomStreams(1, "rover/camera"))


def test_a_sensor_that_is_made_anew_keeps_its_faults_until_its_vehicle_has_gone() -> None:
    inner, message = lidar()
    it = wrapped(inner, message, Off(at_s=1.0, for_s=0.5))
    ticks = []
    for state in STATES:
        if state.tick == 410:
            it.renew(lidar()[0])
        made = it.readings(state)
        ticks += [state.tick for one in made if not isinstance(one, LeftOut)]
    assert min(ticks) < 400
    assert not [tick for tick in ticks if 450 < tick < 600]
    assert max(ticks) > 650
    assert not it.has_gone
    it.renew(RemovedSensor())
    assert it.has_gone
    assert not list(it.readings(STATES[7]))
    assert it.settled_tick() == 7
