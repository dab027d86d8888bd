# SPDX-License-Identifier: Apache-2.0
import math

import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.navigation import Odometry
from groundlink.ros.base import Base, Bases, is_latched
from groundlink.ros.cdr import ros_type_of
from groundlink.ros.streams import (
    WAITING_MESSAGES,
    outgoing,
    static_transforms,
    waiting_messages,
)
from groundlink.scenario.ros_side import TrueMap
from udp_bridge.node.topic_qos import publisher_qos
from udp_bridge.wire.types import MSG_TYPES, NUMBER_OF_ROS_TYPE, TYPED


def test_odometry_goes_out_and_its_frame_is_no_place_on_the_vehicle() -> None:
    yard = load("yard")
    odom = [s for s in outgoing(yard, "run") if s.topic == "/odom"]
    assert [(s.message, s.declared_hz, s.push) for s in odom] == [(Odometry, 50.0, True)]
    placed = static_transforms(yard, 0)
    assert placed is not None
    assert "odom" not in {transform.child for transform in placed.transforms}
    assert "imu_link" in {transform.child for transform in placed.transforms}


def test_all_that_joint_states_and_tf_are_made_of_is_carried() -> None:
    for file in sorted(SHIPPED.glob("*.yaml")):
        scenario = load(file)
        carried = {stream.key for stream in outgoing(scenario, "run")}
        for vehicle in scenario.vehicles:
            needed = Base(scenario, vehicle, "run").keys
            assert {*needed.values()} <= carried, file.name
            assert ("joints" in needed) == bool(vehicle.model.joints)


@pytest.mark.parametrize("block_deg", [0.0, 15.0])
def test_blocks_of_a_cloud_name_their_lidar(block_deg: float) -> None:
    lab = load("indoor_lab")
    (rover,) = lab.vehicles
    lidar = replace(rover.sensors[0], block_deg=block_deg)
    rover = replace(rover, sensors=(lidar, *rover.sensors[1:]))
    streams = outgoing(replace(lab, vehicles=(rover,)), "run")
    in_blocks = {s.topic: s.in_blocks for s in streams if s.in_blocks is not None}
    assert in_blocks == ({lidar.topic: (rover, lidar)} if block_deg else {})


def test_recordings_latch_what_the_bridge_latches() -> None:
    lab = load(SHIPPED / "indoor_lab.yaml")
    (rover,) = lab.vehicles
    labels = {"camera": ("segmentation", "boxes_2d"), "lidar": ("points",)}
    sensors = [
        replace(sensor, labels=labels[sensor.name]) if sensor.name in labels else sensor
        for sensor in rover.sensors
    ]
    labeled = replace(lab, vehicles=(replace(rover, sensors=tuple(sensors)),), true_map=TrueMap())
    types = {s.topic: ros_type_of(s.message, s.ros_type) for s in outgoing(labeled, "run")}
    bases = Bases(labeled, "run")
    types |= {each.topic: ros_type_of(each.message) for each in bases.topics}
    types |= {topic: ros_type_of(message) for topic, message in bases.latched.items()}
    latched = {
        topic
        for topic, ros_type in types.items()
        if publisher_qos(
            MSG_TYPES[NUMBER_OF_ROS_TYPE.get(ros_type, TYPED)].name, topic, ros_type
        ).is_latched
    }
    assert latched == set(filter(is_latched, types))
    assert len(latched) == 7


def test_more_messages_may_wait_of_many_vehicles_and_of_long_windows() -> None:
    rovers = load("two_rovers")
    many = replace(
        rovers, vehicles=tuple(replace(rovers.vehicles[0], name=f"v{i}") for i in range(32))
    )
    rates = sum(stream.declared_hz or 0.0 for stream in outgoing(many, "run"))
    assert rates > 32 * 500
    for window_ticks, seconds in ((400, 4.0), (1600, 8.0)):
        waits = replace(many, time=replace(many.time, window_ticks=window_ticks))
        assert waiting_messages(waits, "run") == math.ceil(seconds * rates)
    assert waiting_messages(rovers, "run") == WAITING_MESSAGES
