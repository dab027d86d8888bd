# SPDX-License-Identifier: Apache-2.0
"""What of a run's messages becomes which record, without a bus."""

from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.fault_messages import Faults
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import (
    POINT,
    Clock,
    Command,
    Health,
    Imu,
    PointCloud,
    Relayed,
    StreamReport,
    packed,
)
from groundlink.messages.ground_truth import Bodies, Vitals
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.messages.navigation import JointState, Odometry, PoseStamped
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.diagnostics import from_missing_readings
from groundlink.ros.types import STORE, TYPES, header
from groundlink.scenario import Scenario
from groundlink.scenario.faults import Stuck
from groundlink.scenario.ros_side import FromRos, Stream
from services.recorder.recorder import Recorder

EPOCH = 1_700_000_000 * NANOS
RUN = "lab"
KEYS = {
    name: f"groundlink/{RUN}/rover/{name}"
    for name in (
        *("imu", "lidar", "ground_truth", "ground_truth/wheels"),
        *("command", "from_ros/pose", "vitals"),
    )
}
CLOCK = f"groundlink/{RUN}/clock"
BODIES = f"groundlink/{RUN}/bodies"
NO_BYTES = memoryview(b"")
NO_ERROR = packed(np.zeros(36))
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def lab() -> Scenario:
    return load(str(SHIPPED / "indoor_lab.yaml"))


class Rig:
    """A recorder, and what it has written so far."""

    def __init__(self, scenario: Scenario, path: Path, seconds: float | None = None) -> None:
        self.path = path
        self.scenario = scenario
        nanos = None if seconds is None else round(seconds * NANOS)
        self.recorder = Recorder(scenario, RUN, self._begin, duration_nanos=nanos)

    def _begin(self, epoch_nanos: int) -> RosFile:
        file = RosFile(self.path)
        file.mcap.add_metadata(
            RUN_RECORD, run_entries(describe_run(self.scenario, RUN, epoch_nanos))
        )
        return file

    def clock(self, tick: int, epoch: int = EPOCH) -> None:
        self.recorder.take(CLOCK, Clock(epoch + tick * TICK_NANOS, epoch, tick, epoch))

    def imu(self, tick: int) -> None:
        stamp = EPOCH + tick * TICK_NANOS
        self.recorder.take(KEYS["imu"], Imu(stamp, "imu_link", UPRIGHT, STILL, STILL, 0, 0, 0))

    def cloud(self, tick: int) -> None:
        points = packed(np.zeros(3, POINT).view(np.uint8))
        cloud = PointCloud(EPOCH + tick * TICK_NANOS, "lidar_link", points)
        self.recorder.take(KEYS["lidar"], cloud)

    def vitals(self, tick: int) -> None:
        message = Vitals(EPOCH + tick * TICK_NANOS, "rover", tick, 0.0, 0.0, ())
        self.recorder.take(KEYS["vitals"], message)

    def truth(self, tick: int, x_m: float) -> None:
        odometry = Odometry(
            EPOCH + tick * TICK_NANOS,
            *("world", "base_link", (x_m, 0.0, 0.0), UPRIGHT, STILL, STILL, NO_ERROR, NO_ERROR),
        )
        self.recorder.take(KEYS["ground_truth"], odometry)
        wheels = JointState(odometry.stamp_nanos, "base_link", (), NO_BYTES, NO_BYTES, NO_BYTES)
        self.recorder.take(KEYS["ground_truth/wheels"], wheels)

    def bodies(self, tick: int) -> None:
        message = Bodies(EPOCH + tick * TICK_NANOS, ("wall",), packed(np.zeros(7)))
        self.recorder.take(BODIES, message)

    def written(self) -> dict[str, list[tuple[int, Any]]]:
        """Return by topic the ticks and the decoded messages, in the order of time."""
        self.recorder.commit()
        found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        with self.path.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            for _, channel, message, ros in reader.iter_decoded_messages():
                found[channel.topic].append(((message.log_time - EPOCH) // TICK_NANOS, ros))
        return found


@pytest.fixture
def rig(lab: Scenario, tmp_path: Path) -> Rig:
    return Rig(lab, tmp_path / "run.mcap")


def test_a_recording_begins_with_a_clock(rig: Rig) -> None:
    rig.imu(8)
    assert not rig.path.exists()
    rig.clock(10)
    rig.imu(9)  # was measured before
    rig.imu(10)
    written = rig.written()
    assert [tick for tick, _ in written["/imu"]] == [10]
    assert [tick for tick, _ in written["/tf_static"]] == [10]
    with Recording(rig.path) as recording:
        assert recording.run.epoch_nanos == EPOCH
        assert recording.run.scenario == rig.scenario
        assert recording.types["/cmd_vel"] == "geometry_msgs/msg/Twist"  # nothing came, yet known


def test_repeated_readings_of_a_restarted_sensor_are_written_once(rig: Rig) -> None:
    rig.clock(0)
    for tick in (0, 1, 2, 1, 2, 3):
        rig.imu(tick)
    assert [tick for tick, _ in rig.written()["/imu"]] == [0, 1, 2, 3]
    assert rig.recorder.counts["repeated"] == 2


def test_readings_that_come_late_have_the_time_of_their_measurement(rig: Rig) -> None:
    rig.clock(0)
    rig.clock(60)
    rig.cloud(0)
    rig.cloud(40)
    assert [tick for tick, _ in rig.written()["/points"]] == [0, 40]


def test_times_of_messages_from_ros(rig: Rig) -> None:
    """A command has the run's time in its stamp; a pose is written when it came."""
    rig.clock(0)
    rig.clock(40)
    command = Command(EPOCH + 38 * TICK_NANOS, (0.5, 0.0, 0.0), STILL)
    rig.recorder.take(KEYS["command"], command)
    rig.recorder.take(KEYS["command"], command)  # asked for twice is no repetition
    rig.recorder.take(KEYS["from_ros/pose"], PoseStamped(17, "map", STILL, UPRIGHT))
    written = rig.written()
    assert [tick for tick, _ in written["/cmd_vel"]] == [38, 38]
    (tick, pose) = written["/pose"][0]
    assert tick == 40
    assert pose.header.stamp.nanosec == 17


def test_joints_stand_in_a_recording_when_they_were_commanded_and_where_they_were(
    tmp_path: Path,
) -> None:
    scenario = load(SHIPPED / "outdoor_paper.yaml")
    rig = Rig(scenario, tmp_path / "run.mcap")
    wheels = tuple(wheel.name for wheel in scenario.vehicles[0].model.wheels)
    still = packed(np.zeros(len(wheels)))
    of_wheels = JointState(EPOCH + 40 * TICK_NANOS, "", wheels, still, still, still)

    def joints(tick: int, turret: float) -> JointState:
        at = packed(np.array([turret, 0.0]))
        return JointState(EPOCH + tick * TICK_NANOS, "", ("turret", "gun"), at, at, NO_BYTES)

    rig.clock(0)
    rig.clock(40)
    rig.recorder.take(f"groundlink/{RUN}/tank/command/joints", joints(38, 0.5))
    rig.recorder.take(f"groundlink/{RUN}/tank/ground_truth/wheels", of_wheels)
    rig.recorder.take(f"groundlink/{RUN}/tank/ground_truth/joints", joints(40, 0.01))
    written = rig.written()
    for topic, tick, turret in (
        ("/joint_commands", 38, 0.5),
        ("/ground_truth/joints", 40, 0.01),
        ("/joint_states", 40, 0.01),
    ):
        ((found, message),) = written[topic]
        at = dict(zip(message.name, message.position, strict=True))
        assert (found, at["turret"], at["gun"]) == (tick, turret, 0.0), topic
    assert written["/joint_states"][0][1].name[:2] == ["left_track", "right_track"]


def test_nothing_is_logged_before_the_recording_begins(rig: Rig) -> None:
    """A command may still be under way whose stamp is before the first clock."""
    rig.clock(40)
    rig.recorder.take(KEYS["command"], Command(EPOCH + 38 * TICK_NANOS, (0.5, 0.0, 0.0), STILL))
    assert [tick for tick, _ in rig.written()["/cmd_vel"]] == [40]
    with Recording(rig.path) as recording:
        assert recording.first_nanos == EPOCH + 40 * TICK_NANOS


def test_relayed_message_keeps_topic_and_type(lab: Scenario, tmp_path: Path) -> None:
    (rover,) = lab.vehicles
    told = FromRos(topics={"/plan": "nav_msgs/Path"})
    rig = Rig(replace(lab, vehicles=(replace(rover, from_ros=told),)), tmp_path / "run.mcap")
    rig.clock(0)
    rig.clock(40)
    path = TYPES["nav_msgs/msg/Path"](header=header(17, "map"), poses=[])
    cdr = memoryview(bytes(STORE.serialize_cdr(path, "nav_msgs/msg/Path")))
    key = f"groundlink/{RUN}/rover/from_ros/topics/plan"
    rig.recorder.take(key, Relayed(EPOCH, "nav_msgs/msg/Path", cdr))
    written = rig.written()
    ((tick, plan),) = written["/plan"]
    assert (tick, plan.header.stamp.nanosec, plan.header.frame_id) == (40, 17, "map")


def test_diagnostics_once_a_second_of_sim_time(rig: Rig) -> None:
    stream = StreamReport("/imu", "Imu", 400.0, 399.0, None, 90, 10, sent=100, missing=10)
    rig.recorder.take_health(Health("physics", 7, 5, {"refused": 3}))
    rig.recorder.take_health(Health("gateway", 8, 5, {}, (stream,)))
    rig.clock(0)
    for tick in range(4, 1300, 4):
        rig.clock(tick)
    arrays = rig.written()["/diagnostics"]
    assert [tick for tick, _ in arrays] == [400, 800, 1200]
    by_name = {status.name: status for status in arrays[0][1].status}
    assert {p.key: p.value for p in by_name["physics"].values}["refused"] == "3"
    imu = by_name["gateway: /imu to ROS"]
    assert (int(imu.level), imu.message) == (1, "10 of 100 lost")
    assert {p.key: p.value for p in imu.values}["measured_hz"] == "399.0"


def test_recording_is_complete_when_every_stream_is(lab: Scenario, tmp_path: Path) -> None:
    """Sensors lag behind the clock: it is not the clock that ends a recording."""
    (rover,) = lab.vehicles
    only = tuple(sensor for sensor in rover.sensors if sensor.name in ("lidar", "imu"))
    extra = Stream(name="cam", kind="image", topic="/image", rate_hz=30.0)
    rover = replace(rover, sensors=only, streams=(extra,))  # of which nothing ever comes
    rig = Rig(replace(lab, vehicles=(rover,)), tmp_path / "run.mcap", seconds=0.2)
    rig.clock(0)
    for tick in range(0, 80, 8):
        rig.truth(tick, 0.0)
    for tick in range(0, 80, 40):
        rig.vitals(tick)
        rig.bodies(tick)
    for tick in range(0, 70):
        rig.imu(tick)
    rig.clock(80)
    assert not rig.recorder.is_complete
    for tick in range(70, 90):
        rig.imu(tick)
    assert not rig.recorder.is_complete  # the first cloud has not come
    rig.cloud(0)
    assert not rig.recorder.is_complete
    rig.cloud(40)
    assert rig.recorder.is_complete
    rig.cloud(80)
    written = rig.written()
    assert [tick for tick, _ in written["/points"]] == [0, 40]
    assert [tick for tick, _ in written["/imu"]] == list(range(80))
    assert [tick for tick, _ in written["/clock"]] == [0]


def test_a_sensor_that_is_not_there_is_not_awaited_for_ever(lab: Scenario, tmp_path: Path) -> None:
    rig = Rig(lab, tmp_path / "run.mcap", seconds=0.2)
    for tick in (0, 80, 2079):
        rig.clock(tick)
        assert not rig.recorder.is_complete
    rig.clock(2080)
    assert rig.recorder.is_complete


def test_messages_before_the_first_clock_are_kept(rig: Rig) -> None:
    for tick in range(9, 14):
        rig.imu(tick)
    rig.clock(10)
    rig.imu(14)
    assert [tick for tick, _ in rig.written()["/imu"]] == [10, 11, 12, 13, 14]


def test_another_episode_is_recognized_by_its_clock(rig: Rig) -> None:
    rig.clock(100)
    same = Clock(EPOCH + 104 * TICK_NANOS, EPOCH, 104, EPOCH)
    assert not rig.recorder.is_another_episode(same)
    assert rig.recorder.is_another_episode(Clock(EPOCH, EPOCH, 0, EPOCH))
    assert rig.recorder.is_another_episode(Clock(EPOCH + NANOS, EPOCH + NANOS, 0, EPOCH + NANOS))


def test_clocks_that_the_bus_has_lost_are_counted(rig: Rig) -> None:
    for tick in (0, 4, 8, 20, 24):  # at 100 Hz
        rig.clock(tick)
    assert rig.recorder.counts["clocks_missed"] == 2


def test_facts_of_topics_are_in_the_file_at_every_commit(rig: Rig) -> None:
    rig.clock(0)
    rig.clock(200)
    for tick in range(401):
        rig.imu(tick)
    rig.recorder.commit()
    with Recording(rig.path) as recording:
        imu = recording.topics["/imu"]
    assert (imu.messages, imu.declared_hz) == (401, 400.0)
    assert imu.measured_hz == pytest.approx(400.0)


def test_messages_before_the_first_clock_of_an_episode_belong_to_it(
    lab: Scenario, rig: Rig
) -> None:
    rig.clock(0)
    rig.imu(0)
    rig.imu(100)
    rig.imu(1000)  # of an episode whose clock has not come yet
    rig.clock(100)
    assert [tick for tick, _ in rig.written()["/imu"]] == [0, 100]
    assert [message.stamp_nanos for _, message in rig.recorder.early] == [  # type: ignore[attr-defined]
        EPOCH + 1000 * TICK_NANOS
    ]
    successor = Recorder(
        lab, RUN, lambda epoch: RosFile(rig.path.with_stem("next")), early=rig.recorder.early
    )
    epoch = EPOCH + 990 * TICK_NANOS
    successor.take(CLOCK, Clock(epoch, epoch, 0, epoch))
    assert successor.counts["messages"] == 4  # and /clock, /tf_static, /robot_description


def test_messages_before_the_first_clock_of_an_episode_of_the_same_epoch_belong_to_it(
    rig: Rig, lab: Scenario
) -> None:
    """They look as if they were repeated; what was repeated before the last clock is none."""
    for tick in (0, 8, 16):
        rig.clock(tick)
        rig.imu(tick)
    rig.imu(8)
    rig.clock(24)
    rig.truth(16, 0.0)
    rig.truth(0, 2.0)
    following = Recorder(
        lab, RUN, lambda epoch: RosFile(rig.path.with_stem("next")), early=rig.recorder.early
    )
    rig.recorder, rig.path = following, rig.path.with_stem("next")
    rig.clock(0)
    rig.truth(8, 3.0)
    written = rig.written()
    assert [tick for tick, _ in written["/ground_truth/wheels"]] == [0, 8]
    assert "/imu" not in written


def test_sensor_clock_offset_is_only_in_the_body(rig: Rig) -> None:
    rig.clock(0)
    for tick, ahead in ((1, 0), (2, -2 * NANOS), (3, 3 * NANOS), (4, 0)):
        stamp = EPOCH + tick * TICK_NANOS + ahead
        imu = Imu(stamp, "imu_link", UPRIGHT, STILL, STILL, 0, 0, 0, clock_error_nanos=ahead)
        rig.recorder.take(KEYS["imu"], imu)
        rig.recorder.take(KEYS["imu"], imu)
    written = rig.written()["/imu"]
    assert [tick for tick, _ in written] == [1, 2, 3, 4]
    seconds = [imu.header.stamp.sec - EPOCH // NANOS for _, imu in written]
    assert seconds == [0, -2, 3, 0]
    assert rig.recorder.counts["repeated"] == 4


def test_begin_and_end_of_a_fault_are_recorded(rig: Rig) -> None:
    rig.clock(0)
    key = f"groundlink/{RUN}/faults/rover/imu"
    for tick, active in ((40, (Stuck(at_s=0.1, for_s=0.1),)), (80, ()), (80, ())):
        faults = Faults(EPOCH + tick * TICK_NANOS, "rover/imu", tick, active)
        rig.recorder.take(key, faults)
    written = rig.written()["/faults/rover/imu"]
    assert [(tick, array.status[0].message) for tick, array in written] == [
        (40, "stuck"),
        (80, "none"),
    ]


def test_missing_readings_are_recorded(rig: Rig) -> None:
    rig.clock(0)
    gap = MissingSpan("overloaded", EPOCH, EPOCH + 3 * TICK_NANOS, 4, ("",))
    told = MissingReadings(EPOCH + 40 * TICK_NANOS, "rover/imu", (gap,))
    for _ in range(2):
        rig.recorder.take(f"groundlink/{RUN}/gaps/rover/imu", told)
    ((tick, array),) = rig.written()["/gaps/rover/imu"]
    assert (tick, array.status[0].message) == (40, "4 overloaded")
    assert from_missing_readings(array) == told


def test_dropped_messages_are_counted_by_topic_and_begin(lab: Scenario) -> None:
    dropped = Counter({KEYS["imu"]: 5})
    recorder = Recorder(lab, RUN, lambda _: pytest.fail("not begun"), dropped=dropped)
    assert recorder.dropped == {}
    dropped[KEYS["imu"]] += 2
    assert recorder.dropped == {"/imu": 2}


def test_file_lists_dropped_messages(lab: Scenario, tmp_path: Path) -> None:
    file = RosFile(tmp_path / "run.mcap")
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(lab, RUN, EPOCH)))
    file.lacks({"/imu": 2})
    file.commit({})
    file.close()
    with Recording(tmp_path / "run.mcap") as recording:
        assert recording.dropped == {"/imu": 2}


def test_recording_without_duration_is_never_complete(lab: Scenario, tmp_path: Path) -> None:
    rig = Rig(lab, tmp_path / "run.mcap")
    rig.clock(0)
    rig.clock(4000)
    assert not rig.recorder.is_whole
    assert not rig.recorder.is_complete
