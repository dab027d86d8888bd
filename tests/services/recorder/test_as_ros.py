# SPDX-License-Identifier: Apache-2.0
"""A recording holds what ROS gets, and the truth under names of its own."""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.bus.core_topics import CLOCK
from groundlink.bus.topics import GROUND_TRUTH, SENSOR_TOPICS
from groundlink.core.clock import NANOS
from groundlink.core.frames import quaternion_from_rpy, transform
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import BusMessage, Clock, WheelEncoders
from groundlink.messages.navigation import Odometry
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.types import STORE
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import TfTree
from groundlink.scenario.schema import Vehicle
from services.recorder.recorder import Recorder
from services.sensors.encoders.spec import Encoders
from services.sensors.wheel_odometry.spec import WheelOdometry
from tests.services.gateway.test_gateway import RUN, Bench

EPOCH = 1_700_000_000 * NANOS
PERIOD = NANOS // 50
STILL = (0.0, 0.0, 0.0)
NO_ERROR = memoryview(bytes(36 * 8))
STEPS = 20
TREES = [TfTree(), TfTree(odom=False), TfTree(map="identity"), TfTree(map="truth")]


def odometry(stamp: int, frame: str, child: str, x_m: float, yaw: float) -> Odometry:
    placed = (x_m, 0.0, 0.1), quaternion_from_rpy(0.0, 0.0, yaw)
    return Odometry(stamp, frame, child, *placed, STILL, STILL, NO_ERROR, NO_ERROR)


def told(vehicle: Vehicle, step: int) -> Iterator[tuple[str, BusMessage]]:
    """Yield what physics and the sensors of a vehicle say at a step: wheels slip on a bend."""
    stamp, x_m, name = EPOCH + step * PERIOD, 0.01 * step, vehicle.name
    base = vehicle.frame_prefix + vehicle.model.base_frame
    for sensor in vehicle.sensors:
        where = {"vehicle": name, "sensor": sensor.name}
        if isinstance(sensor, WheelOdometry):
            frame = vehicle.frame_prefix + sensor.frame
            moved = odometry(stamp, frame, base, x_m, 0.02 * step)
            yield SENSOR_TOPICS["wheel_odometry"].key_in(RUN, **where), moved
        elif isinstance(sensor, Encoders):
            shafts = tuple(shaft.name for shaft in vehicle.model.counted)
            ticks = (sensor.start_ticks + 100 * step,) * len(shafts)
            yield (
                SENSOR_TOPICS["encoders"].key_in(RUN, **where),
                WheelEncoders(stamp, base, shafts, ticks),
            )
    truth = odometry(stamp, "world", base, 3.0 + 0.9 * x_m, 1.0 + 0.01 * step)
    yield GROUND_TRUTH.key_in(RUN, vehicle=name), truth


def with_tree(name: str, tree: TfTree) -> Scenario:
    scenario = load(SHIPPED / f"{name}.yaml")
    return replace(scenario, vehicles=tuple(replace(v, tf=tree) for v in scenario.vehicles))


def recorded(scenario: Scenario, path: Path) -> dict[str, list[bytes]]:
    """Return the bodies by topic of a run that is recorded."""

    def begin(epoch_nanos: int) -> RosFile:
        file = RosFile(path)
        file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, RUN, epoch_nanos)))
        return file

    recorder = Recorder(scenario, RUN, begin)
    for key, message in messages(scenario):
        recorder.take(key, message)
    recorder.commit()
    found: dict[str, list[bytes]] = defaultdict(list)
    with Recording(path) as recording:
        for message in recording.read():
            found[message.topic].append(message.cdr)
    return found


def messages(scenario: Scenario) -> Iterator[tuple[str, BusMessage]]:
    for step in range(STEPS):
        yield CLOCK.key_in(RUN), Clock(EPOCH + step * PERIOD, EPOCH, 8 * step, 1)
        for vehicle in scenario.vehicles:
            yield from told(vehicle, step)


def to_ros(scenario: Scenario) -> dict[str, list[bytes]]:
    """Return the bodies by topic that a gateway sends of the same run."""
    bench = Bench(scenario)
    for key, message in messages(scenario):
        bench.gateway.forward(key, message, bench.link)  # type: ignore[arg-type]
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    subscribed = {each.topic for each in bench.gateway.subscriptions}
    found: dict[str, list[bytes]] = defaultdict(list)
    for row in bench.link.sent:
        if row["topic"] not in subscribed:
            found[row["topic"]].append(row["body"])
    return found


def transforms(bodies: list[bytes]) -> list[Any]:
    read = (STORE.deserialize_cdr(body, "tf2_msgs/msg/TFMessage") for body in bodies)
    return [row for message in read for row in message.transforms]  # type: ignore[attr-defined]


@pytest.mark.parametrize("tree", TREES, ids=lambda tree: f"{tree.map}-{tree.odom}")
@pytest.mark.parametrize("name", ["indoor_lab", "indoor_2d", "two_rovers"])
def test_each_body_that_goes_to_ros_is_in_the_file(name: str, tree: TfTree, tmp_path: Path) -> None:
    scenario = with_tree(name, tree)
    in_file, in_ros = recorded(scenario, tmp_path / "run.mcap"), to_ros(scenario)
    assert {topic: in_file[topic] for topic in in_ros} == in_ros
    assert any(topic.endswith("/joint_states") for topic in in_ros)


@pytest.mark.parametrize("tree", TREES, ids=lambda tree: f"{tree.map}-{tree.odom}")
@pytest.mark.parametrize("name", ["indoor_lab", "indoor_2d", "two_rovers"])
def test_every_frame_has_one_parent_and_stands_in_the_world(
    name: str, tree: TfTree, tmp_path: Path
) -> None:
    """Foxglove takes all transforms of a file for one tree, whatever their topics are."""
    scenario = with_tree(name, tree)
    found = recorded(scenario, tmp_path / "run.mcap")
    rows = transforms([*found["/tf"], *found["/tf_static"], *found["/ground_truth/tf"]])
    pairs = {(row.child_frame_id, row.header.frame_id) for row in rows}
    parents = dict(pairs)
    assert len(pairs) == len(parents)
    for vehicle in scenario.vehicles:
        base = vehicle.frame_prefix + vehicle.model.base_frame
        if any(isinstance(s, WheelOdometry) for s in vehicle.sensors) and tree.odom:
            assert parents[base].removeprefix(vehicle.frame_prefix) == "odom"
        for frame in (base, *(child for child in parents if child.startswith(base))):
            while frame in parents:
                frame = parents[frame]
            assert frame == "world"


@pytest.mark.parametrize("tree", TREES, ids=lambda tree: f"{tree.map}-{tree.odom}")
@pytest.mark.parametrize("name", ["indoor_lab", "indoor_2d", "two_rovers"])
def test_the_tree_puts_each_base_where_it_truly_is(name: str, tree: TfTree, tmp_path: Path) -> None:
    scenario = with_tree(name, tree)
    found = recorded(scenario, tmp_path / "run.mcap")
    rows = transforms([*found["/tf"], *found["/tf_static"], *found["/ground_truth/tf"]])
    by_child = defaultdict(dict)
    for row in rows:
        by_child[row.child_frame_id][row.header.stamp.sec, row.header.stamp.nanosec] = row
    for vehicle in scenario.vehicles:
        base = vehicle.frame_prefix + vehicle.model.base_frame
        step = 10
        (truth,) = [m for key, m in told(vehicle, step) if key.endswith("ground_truth")]
        assert isinstance(truth, Odometry)
        at, world_from_base = divmod(truth.stamp_nanos, NANOS), np.eye(4)
        frame = base
        while frame in by_child:
            row = by_child[frame].get(at) or next(iter(by_child[frame].values()))
            t, q = row.transform.translation, row.transform.rotation
            world_from_base = transform((t.x, t.y, t.z), (q.x, q.y, q.z, q.w)) @ world_from_base
            frame = row.header.frame_id
        expected = transform(truth.position_m, truth.orientation)
        np.testing.assert_allclose(world_from_base, expected, atol=1e-9)
