# SPDX-License-Identifier: Apache-2.0
"""Every type of the wire passes through the node, in the directions that the table says."""

from groundlink.messages.navigation import Transforms
from groundlink.ros.cdr import ROS_CODECS, to_cdr
from tests.vectors.examples import EXAMPLES, STAMP, fields
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.types import MSG_TYPES, type_number

from .conftest import LATCHED, RELIABLE, FarEnd, Ros
from .waiting import wait_until

FROM_ROS = [
    name
    for name, e in EXAMPLES.items()
    if MSG_TYPES[type_number(e.type_name)].direction != "to ROS"
]
TO_ROS = [
    name
    for name, e in EXAMPLES.items()
    if MSG_TYPES[type_number(e.type_name)].direction != "from ROS"
]


def ros_type(name: str) -> str:
    return ROS_CODECS[type(EXAMPLES[name].message)].ros_type


def test_every_type_arrives_in_ros(ros: Ros, bridge: FarEnd) -> None:
    """All fields of each: what the subscriber got, it writes down as CDR again."""
    rows = [
        (ros_type(name), EXAMPLES[name].topic, LATCHED if name == "text" else RELIABLE)
        for name in TO_ROS
    ]
    listener = ros.listen(*rows)
    for name in TO_ROS:
        type_name, topic, _, message = EXAMPLES[name]
        body = bytes(to_cdr(message))
        bridge.reach(listener, type_number(type_name), topic, body)
        stamp, content = listener.messages(topic)[0]
        assert stamp == (STAMP if name != "text" else 0), name
        if isinstance(message, Transforms):  # of which the listener tells this
            assert content == {t.child: t.translation_m[0] for t in message.transforms}
            continue
        got = bytes.fromhex(content)[: len(body)]
        assert fields(got, type(message)) == fields(body, type(message)), name


def test_poses_maps_odometry_and_joints_come_back(ros: Ros, bridge: FarEnd) -> None:
    """A map is published once, before anybody asks for it, and again to whoever asks anew."""
    bodies = {name: bytes(to_cdr(EXAMPLES[name].message)) for name in FROM_ROS}
    for name, body in bodies.items():
        ros.start("-m", "tests.ros.replayer", ros_type(name), EXAMPLES[name].topic, body.hex())
    for name in FROM_ROS:
        msg_type, topic = type_number(EXAMPLES[name].type_name), EXAMPLES[name].topic
        bridge.send(7, topic, 0, Subscribe(msg_type, lease_s=30).pack())
        wait_until(lambda m=msg_type: bridge.of_type(m), name)  # type: ignore[misc]
        message = bridge.of_type(msg_type)[0]
        assert (message.topic, message.stamp_nanos) == (topic, STAMP)
        assert message.link == EXAMPLES[name].message.frame  # type: ignore[attr-defined]
        message_type = type(EXAMPLES[name].message)
        assert fields(bytes(message.body), message_type) == fields(bodies[name], message_type)
    a_map = type_number("OccupancyGrid")
    assert len(bridge.of_type(a_map)) == 1
    bridge.send(7, "/map", 0, Subscribe(a_map, action=0).pack())
    bridge.send(7, "/map", 0, Subscribe(a_map, lease_s=30).pack())
    wait_until(lambda: len(bridge.of_type(a_map)) == 2, "the map for who asks anew")


def test_the_table_is_covered() -> None:
    assert sorted(FROM_ROS) == ["joint-state", "map", "odometry", "pose"]
    assert sorted(TO_ROS) == sorted(EXAMPLES)
