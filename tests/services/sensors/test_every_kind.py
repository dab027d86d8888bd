# SPDX-License-Identifier: Apache-2.0
"""Of every kind of sensor: what is due is what its model makes, and what it misses is told.

What a model sends depends on the states, the seed and the name alone, not on when it began.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from groundlink.bus.topics import sensor_outputs
from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ
from groundlink.messages.base import (
    BadBusMessage,
    BusMessage,
    State,
    encode,
    measured_nanos,
    packed,
)
from groundlink.messages.imagery import CompressedImage
from groundlink.messages.missing_readings import MissingReadings
from groundlink.messages.reading_schedule import ReadingSchedule
from groundlink.scenario.cameras import Imager
from groundlink.scenario.every_sensor import Mount, SensorSpec
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import sensor_kinds
from services.sensors.camera.spec import Camera
from services.sensors.depth_camera.eyes import RayEye
from services.sensors.depth_camera.model import DepthCameraModel
from services.sensors.depth_camera.spec import DepthCamera
from services.sensors.encoders.model import EncodersModel
from services.sensors.encoders.spec import Encoders
from services.sensors.gnss.model import GnssModel
from services.sensors.gnss.spec import Gnss, PositionNoise
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import GyroscopeNoise, InertialNoise, InertialUnit, low_pass_ticks
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar
from services.sensors.lidar_2d.model import Lidar2dModel
from services.sensors.lidar_2d.spec import Lidar2d
from services.sensors.radar.model import RadarModel
from services.sensors.radar.spec import Radar
from services.sensors.range.model import RangeModel
from services.sensors.range.spec import RangeFinder
from services.sensors.runtime.model import (
    LeftOut,
    RememberingModel,
    SensorModel,
    SkippingModel,
    StreamMessage,
    stream_and_message,
)
from services.sensors.runtime.picture_times import PictureModel
from services.sensors.runtime.reading_ledger import ReadingLedger
from services.sensors.runtime.runner import SensorProcess
from services.sensors.stereo_camera.spec import StereoCamera
from services.sensors.wheel_odometry.model import WheelOdometryModel
from services.sensors.wheel_odometry.spec import WheelOdometry

from .states import EPOCH_NANOS, WHEELS
from .yards import box, moving, yard

TICKS = 240
RATES_HZ = st.sampled_from([7.5, 10.0, 29.97, 30.0, 50.0, 59.94, 100.0, 119.88, 399.6, 400.0])
TURNS_HZ = st.sampled_from([5.0, 9.99, 10.0, 12.5, 20.0, 29.97])
PLACE: dict[str, Any] = {"name": "it", "topic": "/it", "frame": "it_link"}
COUNTED = Encoders(name="wheels", topic="/wheels", frame="base_link")
WORN: dict[str, Any] = {
    **{"missed_ticks": 0.05, "resets_s": (0.1, 0.25, 0.5), "scale_stddev": 0.01},
    **{
        "slip_stddev": 0.05,
        "eccentricity_deg": 2.0,
        "reversed_wheels": (WHEELS[1],),
        "start_ticks": 2**62 - 100,
    },
}
"""Errors of wheels, by which counters depend on more than the states."""


def exposure_nanos(spec: SensorSpec) -> int:
    """Return the time that a picture of a camera takes; 0 for all other kinds."""
    return round(spec.imager.span_s * NANOS) if isinstance(spec, Camera) else 0


class Blank(PictureModel):
    """A camera that looks at nothing: all streams of a picture, when there is one."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Any) -> None:
        super().__init__(spec, self, span_nanos=exposure_nanos(spec))
        self._spec = spec

    def take(self, state: State) -> None:
        """Look away."""

    def restart(self) -> None:
        """Forget earlier states; called by the other, too."""
        if not hasattr(self, "_restarting"):
            self._restarting = True
            super().restart()
            del self._restarting

    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        picture = CompressedImage(stamp_nanos, "", "jpeg", memoryview(b""))
        return [StreamMessage(output.name, picture) for output in sensor_outputs(self._spec)]


def of_rate(kind: type[Any], **fields: Any) -> st.SearchStrategy[Any]:
    return st.builds(kind, **{n: st.just(v) for n, v in (PLACE | fields).items()}, rate_hz=RATES_HZ)


def turning(kind: type[Any], **fields: Any) -> st.SearchStrategy[Any]:
    blocks = st.sampled_from([0.0, 120.0, 36.0])
    just = {n: st.just(v) for n, v in (PLACE | fields).items()}
    return st.builds(
        kind,
        **just,
        firings_per_revolution=st.just(64),
        rotation_rate_hz=TURNS_HZ,
        range_stddev_m=st.just(0.03),
        laser_bias_m=st.just(0.02),
        range_resolution_m=st.just(0.002),
        dropout=st.just(0.1),
        block_deg=blocks,
    )


def exposing(camera: Camera) -> Camera:
    """Return one that takes its time, where its rate leaves some."""
    if camera.rate_hz > 100:
        return camera
    return replace(camera, imager=Imager(exposure_s=0.004, readout_s=0.003, poses=2))


LENS = {"width": 16, "height": 16}
IMU_NOISE = InertialNoise(
    noise_density=1.5e-3,
    bias_instability=4e-4,
    bias_time_constant_s=30,
    random_walk=1e-4,
    turn_on_bias=0.02,
    scale_factor=0.01,
    misalignment_deg=0.5,
    saturation=20,
    resolution=0.005,
)
WIDE: dict[str, Any] = {
    **{"divergence_mrad": (30.0, 15.0), "rays_per_beam": 4, "returns": "dual"},
    **{"azimuth_stddev_deg": 0.05, "elevation_stddev_deg": 0.05, "range_stddev_share": 0.001},
    "laser_times_us": (0.0, 4000.0),
}
"""Beams that meet several things, each with errors of its own; some leave late."""

KINDS: dict[type[Any], tuple[st.SearchStrategy[Any], Callable[..., SensorModel]]] = {
    Lidar: (turning(Lidar, **WIDE, elevations_deg=(-1.0, 1.0), truth=True), LidarModel),
    Lidar2d: (turning(Lidar2d), Lidar2dModel),
    InertialUnit: (
        st.builds(
            lambda imu, hz: replace(
                imu,
                accelerometer=replace(IMU_NOISE, bandwidth_hz=hz),
                gyroscope=replace(imu.gyroscope, bandwidth_hz=hz / 2),
            ),
            of_rate(
                InertialUnit,
                mount=Mount((0.1, 0.2, 0.3), (1, 2, 3)),
                gyroscope=GyroscopeNoise(
                    **{"noise_density": 2e-4, "bias_instability": 5e-5, "random_walk": 1e-5},
                    **{"turn_on_bias": 0.003, "scale_factor": 0.01, "misalignment_deg": 0.5},
                    **{"g_sensitivity": 1e-4, "saturation": 4, "resolution": 0.001},
                ),
                orientation_stddev_deg=0.25,
            ),
            st.sampled_from([0.0, 50.0, 200.0]),
        ),
        ImuModel,
    ),
    Encoders: (of_rate(Encoders), EncodersModel),
    WheelOdometry: (of_rate(WheelOdometry, encoders="wheels"), WheelOdometryModel),
    Gnss: (
        st.builds(
            lambda gnss, latency: replace(gnss, latency_s=latency),
            of_rate(
                Gnss,
                horizontal=PositionNoise(0.5, 1.0),
                vertical=PositionNoise(1.0, 2.0),
                drift_time_s=5.0,
                velocity_stddev_mps=0.05,
            ),
            st.sampled_from([0.0, 0.07, 0.35]),
        ),
        GnssModel,
    ),
    Radar: (
        of_rate(
            Radar,
            **{"horizontal_fov_deg": 20.0, "vertical_fov_deg": 4.0, "ray_step_deg": 2.0},
            **{"max_range_m": 60.0, "full_range_rcs_dbsm": -20.0, "range_resolution_m": 0.5},
            **{"azimuth_resolution_deg": 3.0, "velocity_resolution_mps": 0.2},
            **{"fluctuation": "swerling1", "false_alarms": 2.0},
        ),
        RadarModel,
    ),
    RangeFinder: (
        of_rate(
            RangeFinder,
            **{"radiation": "ultrasound", "field_of_view_deg": 10.0, "max_range_m": 4.0, "rays": 4},
            **{"range_stddev_m": 0.01, "turn_on_bias_m": 0.02, "dropout": 0.1},
        ),
        RangeModel,
    ),
    Camera: (of_rate(Camera, **LENS, publish="both").map(exposing), Blank),
    DepthCamera: (
        of_rate(
            DepthCamera,
            **LENS,
            **{"publish": "both", "points_topic": "/points"},
            **{"baseline_m": 0.05, "disparity_stddev_px": 0.01, "edge_holes_px": 2},
        ),
        lambda scenario, vehicle, spec: DepthCameraModel(
            scenario, vehicle, spec, eye=RayEye(scenario, vehicle, spec)
        ),
    ),
    StereoCamera: (
        of_rate(StereoCamera, **LENS, topic="/left/it", right_topic="/right/it", baseline_m=0.1),
        Blank,
    ),
}


def test_every_kind_of_sensor_is_tried() -> None:
    assert {kind.__struct_config__.tag for kind in KINDS} == set(sensor_kinds())


def run(ticks: int) -> list[State]:
    """Return states of a rover that drives by a wall and tumbles."""
    places = np.outer(np.arange(ticks), (0.002, 0.0, 0.0))
    turns = Rotation.from_rotvec(np.outer(np.arange(ticks), (0.0005, 0.0007, 0.002)))
    angles = np.cumsum(np.random.default_rng(6).normal(0.01, 0.1, (ticks, len(WHEELS))), axis=0)
    return [
        replace(
            state,
            vehicles={
                "rover": replace(
                    state.vehicles["rover"],
                    joint_positions=packed(angles[state.tick].copy()),
                    joint_velocities=packed(np.zeros(len(WHEELS))),
                )
            },
        )
        for state in moving(places, turns.as_quat())
    ]


STATES = run(1000)


def states_for(spec: SensorSpec) -> list[State]:
    """Return as many states as give two readings, and those of a run at least."""
    return STATES[: max(TICKS, math.ceil(2.4 * TICK_RATE_HZ / spec.message_rate_hz))]


MADE = yard(box("wall", (1, 40, 40), (3, 0, 0)))


def model(spec: SensorSpec, *, seed: int = 1, counted: Encoders = COUNTED) -> SensorModel:
    rover = replace(MADE.vehicles[0], sensors=(counted, spec), frame_prefix="one/")
    return KINDS[type(spec)][1](replace(MADE, vehicles=(rover,), seed=seed), rover, spec)


def remembers(made: SensorModel) -> bool:
    """Return whether readings depend on more than the states, such as on earlier readings."""
    return isinstance(made, RememberingModel) and bool(made.memory())


def sent(made: SensorModel, states: Iterable[State]) -> dict[tuple[str, int], bytes]:
    """Return the messages of a model by stream and sim time."""
    messages = {}
    for state in states:
        for reading in made.readings(state):
            assert not isinstance(reading, LeftOut)
            output, message = stream_and_message(reading)
            messages[output, measured_nanos(message) - EPOCH_NANOS] = encode(message)
    return messages


class Fed:
    """What came of a sensor and what it told, by stream and number of the reading."""

    def __init__(self, spec: SensorSpec, *, max_waiting_ticks: int | None = None) -> None:
        self.model = model(spec)
        self.due: ReadingSchedule = spec.schedule()
        self.came: dict[str, dict[int, bytes]] = {o.name: {} for o in sensor_outputs(spec)}
        self.missing: dict[str, dict[int, str]] = {name: {} for name in self.came}
        self.process = SensorProcess(
            self.model,
            expected_world_hash="",
            ack_ticks=50,
            publish=self._publish,
            acknowledge=lambda _: None,
            ledger=ReadingLedger("rover/it", self.due, self.came, self._tell),
            max_waiting_ticks=max_waiting_ticks,
        )

    def _publish(self, made: BusMessage | StreamMessage) -> None:
        output, message = stream_and_message(made)
        reading = self._reading(measured_nanos(message))
        assert reading not in self.came[output]
        self.came[output][reading] = encode(message)

    def _tell(self, told: MissingReadings) -> None:
        for gap in told.gaps:
            first, last = map(self._reading, (gap.first_nanos, gap.last_nanos))
            assert gap.readings == last - first + 1
            for output in gap.outputs:
                for reading in range(first, last + 1):
                    assert reading not in self.missing[output]
                    self.missing[output][reading] = gap.cause

    def _reading(self, stamp_nanos: int) -> int:
        """Return the number of the reading with a stamp; it is exactly one's."""
        nanos = stamp_nanos - EPOCH_NANOS
        reading = self.due.at_or_after(nanos)
        assert self.due.nanos(reading) == nanos
        return reading

    def check(self) -> None:
        """Each reading that is due, up to the last that came, came or was told, not both."""
        self.process.report_progress()
        over = self.due.at_or_after(self.model.settled_tick() * TICK_NANOS)
        for output, came in self.came.items():
            missing = self.missing[output]
            assert not came.keys() & missing.keys()
            whole = came.keys() | missing.keys()
            assert whole == set(range(self.due.first, max([*whole, over - 1], default=-1) + 1))


def at(kind: type[Any], rate_hz: float) -> st.SearchStrategy[Any]:
    return KINDS[kind][0].map(lambda spec: replace(spec, rate_hz=rate_hz))


STRATEGIES = [pytest.param(KINDS[kind][0], id=kind.__name__) for kind in KINDS] + [
    pytest.param(at(Encoders, 400.0), id="Encoders at 400 Hz"),
    pytest.param(at(Gnss, 3.0), id="Gnss at 3 Hz"),
    pytest.param(at(Gnss, 5.0), id="Gnss at 5 Hz"),
    pytest.param(at(InertialUnit, 1.0), id="InertialUnit at 1 Hz"),
    pytest.param(at(RangeFinder, 20.0), id="RangeFinder at 20 Hz"),
]
SKIPPING = [pytest.param(KINDS[k][0], id=k.__name__) for k in (Lidar, Lidar2d, Camera, DepthCamera)]

FEW = settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.parametrize("strategy", STRATEGIES)
@FEW
@given(data=st.data())
def test_complete_run_lacks_nothing(strategy: st.SearchStrategy[Any], data: st.DataObject) -> None:
    spec = data.draw(strategy)
    fed = Fed(spec)
    for state in states_for(spec):
        fed.process.take(state)
    fed.check()
    assert not any(fed.missing.values())
    assert all(fed.came.values())


@pytest.mark.parametrize("strategy", STRATEGIES)
@FEW
@given(data=st.data())
def test_what_is_missing_and_what_came_are_all_that_was_due(
    strategy: st.SearchStrategy[Any], data: st.DataObject
) -> None:
    spec = data.draw(strategy)
    whole, fed = Fed(spec), Fed(spec)
    begin = data.draw(st.integers(0, 100), label="joins at")
    lost = data.draw(st.integers(begin + 1, TICKS - 60), label="loses states from")
    back = data.draw(st.integers(lost + 1, TICKS - 50), label="gets them again from")
    for state in states_for(spec):
        whole.process.take(state)
        if begin <= state.tick < lost or state.tick >= back:
            fed.process.take(state)
    fed.check()
    for output, missing in fed.missing.items():
        assert set(missing.values()) <= {"not there", "states lost"}
        # What came has the very bytes that it has without a gap, but for what counts on.
        if not isinstance(spec, WheelOdometry):
            assert fed.came[output].items() <= whole.came[output].items()


@pytest.mark.parametrize("strategy", SKIPPING)
@FEW
@given(data=st.data())
def test_what_would_come_late_is_left_out_and_the_rest_is_the_same(
    strategy: st.SearchStrategy[Any], data: st.DataObject
) -> None:
    spec = data.draw(strategy)
    whole, late = Fed(spec), Fed(spec, max_waiting_ticks=400)
    assert isinstance(late.model, SkippingModel)
    behind = range(60, 180)
    for state in states_for(spec):
        whole.process.take(state)
        late.process.take(state, 100 if state.tick in behind else 0)
    late.check()
    for output, missing in late.missing.items():
        assert set(missing.values()) == {"overloaded"}
        assert late.came[output].items() <= whole.came[output].items()
        assert len(late.came[output]) + len(missing) == len(whole.came[output])


@pytest.mark.parametrize("strategy", STRATEGIES)
@FEW
@given(data=st.data())
def test_a_restart_goes_on_with_the_same_bytes(
    strategy: st.SearchStrategy[Any], data: st.DataObject
) -> None:
    spec = data.draw(strategy)
    if isinstance(spec, WheelOdometry):
        return  # it counts on from its memory
    states = states_for(spec)
    whole, same = sent(model(spec), states), model(spec)
    begin = data.draw(st.integers(1, TICKS - 80), label="begins at")
    sent(same, states[: data.draw(st.integers(0, TICKS), label="before")])
    same.restart()
    assert same.settled_tick() == -1
    first_nanos = begin * TICK_NANOS
    if isinstance(spec, InertialUnit):
        # It needs two states, those of its filter and then one whole window.
        ticks = 1 + low_pass_ticks(spec.gyroscope.bandwidth_hz)
        first_nanos += ticks * TICK_NANOS + round(1e9 / spec.rate_hz) + 1
    if isinstance(spec, Radar):
        first_nanos += 1  # It needs two states, for velocities.
    for made in (model(spec), same):
        later = sent(made, states[begin:])
        assert later.items() <= whole.items()
        assert later.keys() >= {key for key in whole if key[1] >= first_nanos}


@pytest.mark.parametrize("strategy", STRATEGIES)
@FEW
@given(data=st.data())
def test_a_successor_from_the_settled_tick_on_leaves_out_nothing(
    strategy: st.SearchStrategy[Any], data: st.DataObject
) -> None:
    """A successor has the memory; it repeats only readings of the tick that it begins with."""
    spec, counted = data.draw(strategy), replace(COUNTED, **WORN)
    if isinstance(spec, Encoders):
        spec = replace(spec, **WORN)
    states = states_for(spec)
    whole, first = sent(model(spec, counted=counted), states), model(spec, counted=counted)
    assert first.settled_tick() == -1
    last = data.draw(st.integers(0, len(states) - 1), label="ends with")
    before = sent(first, states[: last + 1])
    assert first.settled_tick() <= last
    successor = model(spec, counted=counted)
    if isinstance(first, RememberingModel):
        assert isinstance(successor, RememberingModel)
        successor.remember(first.memory())
    later = sent(successor, states[max(first.settled_tick(), 0) :])
    assert later | before == whole
    if not remembers(first):
        assert later.items() <= whole.items()
    if isinstance(spec, InertialUnit):
        assert not later.keys() & before.keys()
    missing_nanos = min((nanos for _, nanos in whole.keys() - before.keys()), default=math.inf)
    complete_ticks = last - math.ceil(exposure_nanos(spec) / TICK_NANOS)
    begin = min(complete_ticks, missing_nanos // TICK_NANOS)
    if isinstance(spec, Gnss) and spec.latency_s:
        begin -= 1  # A fix that waits lies between two states.
    assert all(nanos >= begin * TICK_NANOS for _, nanos in later), "it repeats earlier readings"


MODELED = [kind for kind in KINDS if KINDS[kind][1] is not Blank]


@pytest.mark.parametrize("kind", [k for k in MODELED if k not in (DepthCamera, WheelOdometry)])
@FEW
@given(data=st.data())
def test_seed_and_name_choose_the_noise(kind: type[Any], data: st.DataObject) -> None:
    spec, counted = data.draw(KINDS[kind][0]), replace(COUNTED, **WORN)
    if isinstance(spec, Encoders):
        spec = replace(spec, **WORN)
    named, own = replace(spec, name="other"), replace(spec, seed=2)
    one, same, other, named, own = (
        sent(model(chosen, seed=seed, counted=counted), STATES[:TICKS])
        for chosen, seed in ((spec, 1), (spec, 1), (spec, 2), (named, 1), (own, 1))
    )
    assert one == same
    assert own == other
    continuous = kind in (Lidar, Lidar2d, InertialUnit, Gnss)
    most = 0 if continuous else 1 + len(one) // 20  # the first counts and echoes that both lost
    for different in (other, named):
        assert sum(different[key] == one[key] for key in one) <= most


@pytest.mark.parametrize("kind", MODELED)
@FEW
@given(data=st.data())
def test_a_state_without_the_vehicle_is_refused(kind: type[Any], data: st.DataObject) -> None:
    spec = data.draw(KINDS[kind][0])
    made = model(spec)
    sent(made, STATES[:20])
    refusal = r"tick 20: .*(no|\d) (link poses|joint positions) of `rover`"
    with pytest.raises(BadBusMessage, match=refusal):
        list(made.readings(replace(STATES[20], vehicles={})))
    if not (remembers(made) or isinstance(made, ImuModel)):
        assert made.settled_tick() == -1
        assert sent(made, STATES[21:TICKS]) == sent(model(spec), STATES[21:TICKS])


@pytest.mark.parametrize("kind", MODELED)
@FEW
@given(data=st.data())
def test_frames_have_the_vehicles_prefix(kind: type[Any], data: st.DataObject) -> None:
    made = model(data.draw(KINDS[kind][0]))
    for state in STATES[:TICKS]:
        for reading in made.readings(state):
            assert not isinstance(reading, LeftOut)
            message: Any = stream_and_message(reading)[1]
            assert message.frame.startswith("one/")
            assert getattr(message, "child_frame", "one/").startswith("one/")
