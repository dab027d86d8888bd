# SPDX-License-Identifier: Apache-2.0
"""What a gateway subscribed to comes back from ROS, for as long as it asks for it."""

import time

from udp_bridge.wire.control import Subscribe

from . import bodies
from .conftest import FarEnd, Ros
from .waiting import wait_until

TWIST = "geometry_msgs/msg/Twist"


def test_a_command_comes_back_as_ros_sent_it(ros: Ros, bridge: FarEnd) -> None:
    before_nanos = time.time_ns()
    bridge.send(7, "/cmd_vel", 0, Subscribe(9, lease_s=30).pack())
    ros.talk(TWIST, "/cmd_vel", 20.0)
    wait_until(lambda: len(bridge.of_type(9)) >= 5, "commands")
    commands = bridge.of_type(9)
    numbers = [bodies.decode(message.body, TWIST).linear.x for message in commands]
    assert numbers == [numbers[0] + step for step in range(len(numbers))]
    assert {(message.topic, message.link) for message in commands} == {("/cmd_vel", "")}
    stamps = [before_nanos, *(message.stamp_nanos for message in commands), time.time_ns()]
    assert stamps == sorted(stamps)


def test_an_empty_topic_means_the_default_one(ros: Ros, bridge: FarEnd) -> None:
    ros.talk(TWIST, "/cmd_vel", 20.0)
    bridge.send(7, "", 0, Subscribe(9, lease_s=30).pack())
    wait_until(lambda: bridge.of_type(9), "a command")
    assert bridge.of_type(9)[0].topic == "/cmd_vel"


def test_stamp_and_frame_of_a_header_go_into_the_datagram(ros: Ros, bridge: FarEnd) -> None:
    ros.talk("geometry_msgs/msg/PoseStamped", "/goal", 20.0)
    bridge.send(7, "/goal", 0, Subscribe(10, lease_s=30).pack())
    wait_until(lambda: bridge.of_type(10), "a pose")
    message = bridge.of_type(10)[0]
    pose = bodies.decode(message.body, "geometry_msgs/msg/PoseStamped")
    assert message.link == pose.header.frame_id == "map"
    assert message.stamp_nanos == pose.header.stamp.sec * bodies.NANOS > 0


def test_any_type_comes_back_from_a_topic_of_others(ros: Ros, bridge: FarEnd) -> None:
    body = bodies.cloud(7, bytes(22))
    ros.start("-m", "tests.ros.replayer", "sensor_msgs/msg/PointCloud2", "/filtered", body.hex())
    bridge.send(7, "/filtered", 0, Subscribe(1, lease_s=30).pack())
    wait_until(lambda: bridge.of_type(1), "a filtered cloud")
    message = bridge.of_type(1)[0]
    assert (message.topic, message.link, message.stamp_nanos) == ("/filtered", "lidar", 7)
    assert bytes(message.body)[: len(body)] == body


def test_a_subscription_lasts_as_long_as_its_lease(ros: Ros, bridge: FarEnd) -> None:
    talker = ros.talk(TWIST, "/cmd_vel", 50.0)
    talker.wait_for("readers")
    bridge.send(7, "/cmd_vel", 0, Subscribe(9, lease_s=0).pack())
    talker.wait_until(lambda: talker.messages("readers")[-1][1] == 1, "the subscription")
    wait_until(lambda: bridge.of_type(9), "a command")
    bridge.send(7, "/cmd_vel", 0, Subscribe(9, lease_s=1).pack())
    talker.wait_until(lambda: talker.messages("readers")[-1][1] == 0, "the end of the lease")
    count = len(bridge.of_type(9))
    bridge.send(7, "/cmd_vel", 0, Subscribe(9, lease_s=0).pack())
    wait_until(lambda: len(bridge.of_type(9)) > count, "commands of a new subscription")
    talker.wait_until(lambda: talker.messages("readers")[-1][1] == 1, "the new subscription")
    bridge.send(7, "/cmd_vel", 0, Subscribe(9, action=0).pack())
    talker.wait_until(lambda: talker.messages("readers")[-1][1] == 0, "the unsubscription")


def test_the_bridges_own_topics_are_not_sent_back(ros: Ros) -> None:
    process, address = ros.bridge()
    far_end = FarEnd(address)
    far_end.send(2, "/imu", 1, bodies.imu(1), "imu")
    for _ in range(3):
        far_end.send(7, "/imu", 0, Subscribe(2, lease_s=30).pack())
    process.wait_for("/imu: not subscribed to: Imu comes from the bridge itself")
    far_end.close()
    process.end()
    assert process.output.count("not subscribed to") == 1
