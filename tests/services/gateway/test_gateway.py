# SPDX-License-Identifier: Apache-2.0
"""The gateway between a stand-in of the link and a list of commands."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import (
    POINT,
    BusMessage,
    Clock,
    Command,
    Imu,
    PointCloud,
    Relayed,
    StreamReport,
    WheelEncoders,
    floats,
    packed,
)
from groundlink.messages.navigation import JointState
from groundlink.ros.cdr import to_cdr
from groundlink.ros.streams import outgoing
from groundlink.ros.types import WHEEL_ENCODERS_DEFINITION, header
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import FromRos, JointGroup, TrueMap
from groundlink.scenario.ros_side import Stream as ExtraStream
from services.gateway.gateway import Gateway
from services.gateway.streams import LEASE_SECONDS, TF_MESSAGE, wire_type
from tests.udp_bridge.vectors import VECTORS
from tests.vectors.examples import EXAMPLES
from udp_bridge.sender.delivery_counts import DeliveryCounts
from udp_bridge.wire import run_commands as wire_commands
from udp_bridge.wire.control import LinkReport, RunCommand, Subscribe, TopicReport, WorldQuery
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.typed import pack_typed
from udp_bridge.wire.types import CONTROL, SUBSCRIBE, TYPED, type_number

PEER = ("127.0.0.1", 7511)
STRANGER = ("127.0.0.1", 9999)
RUN = "lab"
TWIST = type_number("Twist")
STORE = get_typestore(Stores.ROS2_KILTED)
STORE.register(get_types_from_msg(WHEEL_ENCODERS_DEFINITION, "groundlink_msgs/msg/WheelEncoders"))


class RecordingLink:
    """Keeps what would go on the wire."""

    def __init__(self) -> None:
        self.sent: list[dict[str, Any]] = []
        self.delivery_counts_of: dict[Any, list[DeliveryCounts]] = {}
        self.came: list[tuple[Any, str, str, TopicReport]] = []

    def delivery_counts(self, to: Any) -> list[DeliveryCounts]:
        return self.delivery_counts_of.get(to, [])

    def arrivals(self) -> list[tuple[Any, str, str, TopicReport]]:
        return self.came

    def send(
        self, msg_type: int, topic: str, link: str, stamp_nanos: int, body: Any, to: Any
    ) -> None:
        self.sent.append(
            {
                "msg_type": msg_type,
                "topic": topic,
                "link": link,
                "stamp": stamp_nanos,
                "body": bytes(body),
                "to": to,
            }
        )


class Bench:
    """A gateway of the shipped scenario with nothing real around it."""

    def __init__(self, scenario: Scenario | None = None) -> None:
        self.commands: list[tuple[str, BusMessage]] = []
        self.run_commands: list[RunCommand] = []
        self.world_queries: list[WorldQuery] = []
        self.link = RecordingLink()
        self.gateway = Gateway(
            scenario or load(SHIPPED / "indoor_lab.yaml"),
            RUN,
            peer=PEER,
            publish=lambda key, message: self.commands.append((key, message)),
            on_run_command=self.run_commands.append,
            on_world_query=self.world_queries.append,
        )

    def forward(self, name: str, message: BusMessage) -> None:
        self.gateway.forward(f"groundlink/{RUN}/{name}", message, self.link)  # type: ignore[arg-type]

    def report(self, **dropped: int) -> tuple[list[StreamReport], dict[str, int]]:
        by_key = {f"groundlink/{RUN}/rover/{name}": count for name, count in dropped.items()}
        return self.gateway.report(self.link, by_key)  # type: ignore[arg-type]

    def hear(self, msg_type: int, topic: str, body: bytes, sender: Any = PEER) -> None:
        self.gateway.on_message(WireMessage(msg_type, topic, "", 5, 0, body), sender)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def twist(*components: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<6d", *components)


def imu(stamp: int) -> Imu:
    return Imu(stamp, "imu_link", (0.0, 0.0, 0.6, 0.8), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), 7, 8, 9)


def test_messages_replaced_on_the_bus_count_as_superseded(bench: Bench) -> None:
    bench.forward("rover/imu", imu(1))
    rows, _ = bench.report(imu=3)
    assert {row.topic: row.superseded for row in rows if row.superseded} == {"/imu": 3}


def test_every_stream_is_known_by_key() -> None:
    streams = outgoing(load(SHIPPED / "indoor_lab.yaml"), RUN)
    assert [(s.key, s.topic, wire_type(s.message), s.declared_hz) for s in streams] == [
        ("groundlink/lab/clock", "/clock", 8, 100.0),
        ("groundlink/lab/rover/lidar", "/points", 1, 10.0),
        ("groundlink/lab/rover/imu", "/imu", 2, 400.0),
        ("groundlink/lab/rover/encoders", "/wheel_encoders", 5, 50.0),
        ("groundlink/lab/rover/camera", "/camera/image_raw/compressed", 3, 30.0),
        ("groundlink/lab/rover/camera/camera_info", "/camera/camera_info", 34, 30.0),
        ("groundlink/lab/rover/ground_truth", "/ground_truth/odom", 36, 50.0),
        ("groundlink/lab/rover/ground_truth/wheels", "/ground_truth/wheels", 37, 50.0),
        ("groundlink/lab/bodies", "/ground_truth/bodies", 35, 10.0),
    ]


def test_an_imu_sample_becomes_a_ros_message(bench: Bench) -> None:
    bench.forward("rover/imu", imu(3_000_000_007))
    (sent,) = bench.link.sent
    assert (sent["msg_type"], sent["topic"], sent["link"]) == (2, "/imu", "imu_link")
    assert (sent["stamp"], sent["to"]) == (3_000_000_007, PEER)
    message: Any = STORE.deserialize_cdr(sent["body"], "sensor_msgs/msg/Imu")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 7)
    assert message.header.frame_id == "imu_link"
    assert (message.orientation.z, message.orientation.w) == (0.6, 0.8)
    assert message.linear_acceleration.z == 6.0
    assert message.angular_velocity_covariance.tolist() == [8, 0, 0, 0, 8, 0, 0, 0, 8]


def test_a_cloud_becomes_a_ros_message(bench: Bench) -> None:
    points = np.zeros(3, POINT)
    points["x"], points["ring"], points["time"] = [1, 2, 3], [0, 7, 15], [0, 0.05, 0.1]
    bench.forward("rover/lidar", PointCloud(1, "lidar_link", packed(points)))
    cloud: Any = STORE.deserialize_cdr(bench.link.sent[0]["body"], "sensor_msgs/msg/PointCloud2")
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 3, 22, 66)
    assert [(f.name, f.offset, f.datatype) for f in cloud.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
        ("intensity", 12, 7),
        ("ring", 16, 4),
        ("time", 18, 7),
    ]
    assert cloud.is_dense
    assert cloud.data.tobytes() == points.tobytes()


def test_encoder_counts_become_a_ros_message(bench: Bench) -> None:
    reading = WheelEncoders(2, "base_link", ("left", "right"), (-(2**62), 2**62))
    bench.forward("rover/encoders", reading)
    body = bench.link.sent[0]["body"]
    message: Any = STORE.deserialize_cdr(body, "groundlink_msgs/msg/WheelEncoders")
    assert message.name == ["left", "right"]
    assert message.ticks.tolist() == [-(2**62), 2**62]


def test_transforms_and_subscriptions_are_repeated_once_time_is_known(bench: Bench) -> None:
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    assert bench.link.sent == []
    bench.forward("clock", Clock(10**9 + 5, 5, 400, 5))
    bench.link.sent.clear()
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    request, transforms, description = bench.link.sent[0], *bench.link.sent[-2:]
    assert (description["stamp"], description["topic"]) == (5, "/robot_description")
    text: Any = STORE.deserialize_cdr(description["body"], "std_msgs/msg/String")
    assert text.data.startswith("<robot")
    assert (request["stamp"], transforms["stamp"]) == (10**9 + 5, 5)
    assert (request["msg_type"], request["topic"]) == (SUBSCRIBE, "/cmd_vel")
    assert Subscribe.parse(request["body"]) == Subscribe(TWIST, 1, LEASE_SECONDS, 0.0)
    assert (transforms["msg_type"], transforms["topic"]) == (TF_MESSAGE, "/tf_static")
    message: Any = STORE.deserialize_cdr(transforms["body"], "tf2_msgs/msg/TFMessage")
    frames = {t.child_frame_id: t.header.frame_id for t in message.transforms}
    mounted = ("lidar_link", "imu_link", "camera_optical_frame")
    assert frames == dict.fromkeys(mounted, "base_link")


def test_a_twist_becomes_a_command_of_now(bench: Bench) -> None:
    bench.hear(TWIST, "/cmd_vel", twist(0.5, 0, 0, 0, 0, 0.25))
    assert bench.commands == [], "before the run's time is known nothing can be commanded"
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    bench.hear(TWIST, "/cmd_vel", twist(0.5, 0, 0, 0, 0, 0.25))
    command = Command(10**9, (0.5, 0.0, 0.0), (0.0, 0.0, 0.25))
    assert bench.commands == [("groundlink/lab/rover/command", command)]


def test_scenario_selects_stamped_twist() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    vehicle = replace(scenario.vehicles[0], command_type="TwistStamped")
    bench = Bench(replace(scenario, vehicles=(vehicle,)))
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    bench.link.sent.clear()
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    assert Subscribe.parse(bench.link.sent[0]["body"]).wanted_type == type_number("TwistStamped")
    (stamped,) = [vector for vector in VECTORS if vector.name == "twist-stamped"]
    body = stamped.datagrams[0][-stamped.meaning["messages"][0]["body_size"] :]
    bench.hear(type_number("TwistStamped"), "/cmd_vel", body)
    assert bench.commands.pop()[1] == Command(10**9, (0.5, 0.0, 0.0), (0.0, 0.0, -1.25))
    bench.hear(TWIST, "/cmd_vel", twist(0.5, 0, 0, 0, 0, 0.25))
    assert not bench.commands


def test_derived_messages_are_sent_with_their_source() -> None:
    bench = Bench(load(SHIPPED / "indoor_2d.yaml"))
    odometry = EXAMPLES["odometry"].message
    bench.forward("rover/odometry", odometry)
    for _ in range(2):  # the second time it is stale
        bench.forward("rover/odometry", odometry)
    sent = [(row["msg_type"], row["topic"], row["stamp"]) for row in bench.link.sent]
    stamp = odometry.stamp_nanos  # type: ignore[attr-defined]
    assert sent == [(36, "/odom", stamp), (TF_MESSAGE, "/tf", stamp)]
    declared = {row.topic: row.declared_hz for row in bench.report()[0]}
    assert (declared["/tf"], declared["/joint_states"]) == (50.0, 50.0)


def test_slam_outputs_are_published_on_the_bus(bench: Bench) -> None:
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    for name, msg_type in (("pose", 10), ("map", 11)):
        sent = EXAMPLES[name].message
        bench.hear(msg_type, f"/{name}", bytes(to_cdr(sent)))
        assert bench.commands.pop() == (f"groundlink/lab/rover/from_ros/{name}", sent)
    assert bench.report()[1]["from_ros"] == 2


def test_any_further_topic_is_subscribed_to_and_relayed_unchanged() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    further = FromRos(topics={"/nav/plan": "nav_msgs/Path"})
    vehicle = replace(scenario.vehicles[0], from_ros=further)
    bench = Bench(replace(scenario, vehicles=(vehicle,)))
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    bench.link.sent.clear()
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    subscribes = [row for row in bench.link.sent if row["msg_type"] == SUBSCRIBE]
    found = [(row["topic"], Subscribe.parse(row["body"]).wanted_type) for row in subscribes]
    assert found == [("/cmd_vel", TWIST), ("/nav/plan", type_number("Path"))]
    ros = STORE.types["nav_msgs/msg/Path"](header=header(5, "map"), poses=[])
    body = bytes(STORE.serialize_cdr(ros, "nav_msgs/msg/Path"))
    bench.hear(type_number("Path"), "/nav/plan", body)
    sent = Relayed(10**9, "nav_msgs/msg/Path", memoryview(body))
    assert bench.commands == [("groundlink/lab/rover/from_ros/topics/nav/plan", sent)]
    bench.hear(type_number("Path"), "/nav/plan", body[:-5])
    counts = bench.report()[1]
    assert (counts["from_ros"], counts["refused"]) == (1, 1)


def test_a_group_of_joints_is_commanded_by_a_type_without_a_number() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    group = JointGroup(interface="velocity", joints=("rear_left_wheel", "rear_right_wheel"))
    of_ros = FromRos(joint_groups={"/v/commands": group})
    bench = Bench(replace(scenario, vehicles=(replace(scenario.vehicles[0], from_ros=of_ros),)))
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
    subscribes = [row for row in bench.link.sent if row["msg_type"] == SUBSCRIBE]
    assert ("/v/commands", TYPED) in [
        (row["topic"], Subscribe.parse(row["body"]).wanted_type) for row in subscribes
    ]
    ros_type = "std_msgs/msg/Float64MultiArray"
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    ros = STORE.types[ros_type](layout=layout, data=np.array([1.5, -2.0]))
    cdr = STORE.serialize_cdr(ros, ros_type)
    body = pack_typed(ros_type, cdr)
    bench.hear(TYPED, "/v/commands", body)
    ((key, command),) = bench.commands
    assert key == "groundlink/lab/rover/command/joints/v/commands"
    assert isinstance(command, JointState)
    assert (command.stamp_nanos, command.names) == (10**9, group.joints)
    assert floats(command.velocities).tolist() == [1.5, -2.0]
    for wrong in (pack_typed("std_msgs/msg/Float32MultiArray", cdr), body[:-1], b"", bytes(cdr)):
        bench.hear(TYPED, "/v/commands", wrong)
    assert len(bench.commands) == 1
    counts = bench.report()[1]
    assert (counts["from_ros"], counts["refused"]) == (1, 4)


def test_poses_and_maps_are_subscribed_to_and_a_map_again_at_the_start(bench: Bench) -> None:
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    subscribes = []
    for _ in range(2):
        bench.link.sent.clear()
        bench.gateway.repeat(bench.link)  # type: ignore[arg-type]
        sent = [row for row in bench.link.sent if row["msg_type"] == SUBSCRIBE]
        subscribes.append([(row["topic"], Subscribe.parse(row["body"])[:3]) for row in sent])
    wanted = (1, LEASE_SECONDS)
    again = [("/cmd_vel", (9, *wanted)), ("/pose", (10, *wanted)), ("/map", (11, *wanted))]
    assert subscribes == [[*again[:2], ("/map", (11, 0, 0)), again[2]], again]


def test_ground_truth_goes_to_subscribers_only(bench: Bench) -> None:
    truth = EXAMPLES["odometry"].message
    bench.forward("rover/ground_truth", replace(truth, stamp_nanos=1))
    assert bench.link.sent == []
    request = Subscribe(36, lease_s=60, max_rate_hz=10.0).pack()
    bench.hear(SUBSCRIBE, "/ground_truth/odom", request, STRANGER)
    stamps = range(10**9, 2 * 10**9, 20_000_000)
    for stamp in stamps:
        bench.forward("rover/ground_truth", replace(truth, stamp_nanos=stamp))
    assert [sent["stamp"] for sent in bench.link.sent] == list(stamps[::5])
    assert {(s["msg_type"], s["topic"], s["to"]) for s in bench.link.sent} == {
        (36, "/ground_truth/odom", STRANGER)
    }
    declared = {row.topic for row in bench.report()[0] if row.declared_hz is not None}
    assert "/ground_truth/odom" not in declared, "nobody is to miss what was not pushed"


def test_the_true_map_goes_to_ros_if_the_scenario_asks_for_it() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    place = type_number("OccupancyGrid"), "/ground_truth/map"
    assert place not in Bench(scenario).gateway.topic_keys
    bench = Bench(replace(scenario, true_map=TrueMap()))
    assert place in bench.gateway.pushed
    (stream,) = (s for s in bench.gateway.streams.values() if s.topic == place[1])
    assert stream.key == f"groundlink/{RUN}/true_map"
    assert stream.declared_hz == 1.0


def test_a_stream_of_any_kind_is_carried() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    kinds = {"PoseStamped": "pose", "OccupancyGrid": "map", "TFMessage": "transforms"}
    streams, messages = [], {}
    for name, example in EXAMPLES.items():
        if name == "text":
            continue  # no process but the gateway has one
        kind = kinds.get(example.type_name, name.replace("-", "_"))
        topic = f"/extra{example.topic}"
        streams.append(ExtraStream(name=kind, kind=kind, topic=topic, rate_hz=1.0))  # type: ignore[arg-type]
        messages[kind] = example
    vehicle = replace(scenario.vehicles[0], streams=tuple(streams))
    bench = Bench(replace(scenario, vehicles=(vehicle,)))
    for kind, example in messages.items():
        bench.forward(f"rover/{kind}", example.message)
        sent = bench.link.sent.pop()
        assert sent["msg_type"] == type_number(example.type_name)
        assert sent["topic"] == f"/extra{example.topic}"
        assert sent["body"] == bytes(to_cdr(example.message))


def test_messages_too_large_for_ros_are_counted(bench: Bench) -> None:
    bench.forward("rover/imu", imu(2**62))
    assert bench.link.sent == []
    assert bench.report()[1]["refused"] == 1


@pytest.mark.parametrize(
    ("msg_type", "topic", "body"),
    [
        (10, "/pose", b""),
        (10, "/pose", bytes(to_cdr(EXAMPLES["map"].message))),
        (10, "/elsewhere", bytes(to_cdr(EXAMPLES["pose"].message))),
        (11, "/map", bytes(to_cdr(EXAMPLES["map"].message))[:-8]),
        (36, "/odom", bytes(to_cdr(EXAMPLES["odometry"].message))),
        (TWIST, "/cmd_vel", b""),
        (TWIST, "/cmd_vel", b"\0\1\0\0abc"),
        (TWIST, "/cmd_vel", twist(math.nan, 0, 0, 0, 0, 0)),
        (TWIST, "/cmd_vel", twist(0, 0, 0, 0, 0, math.inf)),
        (TWIST, "/elsewhere", twist(1, 0, 0, 0, 0, 0)),
        (SUBSCRIBE, "/imu", b"short"),
        (SUBSCRIBE, "/nothing", Subscribe(2).pack()),
        (CONTROL, "/imu", b"\xff"),
        (2, "/imu", b"a reading on its way in"),
    ],
)
def test_invalid_messages_are_counted(bench: Bench, msg_type: int, topic: str, body: bytes) -> None:
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    bench.hear(msg_type, topic, body)
    assert bench.commands == []
    assert bench.report()[1]["refused"] == 1


def test_a_stranger_may_subscribe_but_not_report(bench: Bench) -> None:
    bench.hear(SUBSCRIBE, "/imu", Subscribe(2, lease_s=60).pack(), STRANGER)
    bench.forward("rover/imu", imu(1))
    assert [sent["to"] for sent in bench.link.sent] == [PEER, STRANGER]
    bench.hear(CONTROL, "", LinkReport(1, 2, 3, 4, 6).pack(), STRANGER)
    assert "peer_kernel_drops" not in bench.report()[1]
    bench.hear(CONTROL, "", LinkReport(1, 2, 3, 4, 5, (("short", 4),)).pack())
    counters = bench.report()[1]
    assert (counters["peer_kernel_drops"], counters["peer_refused_short"]) == (5, 4)


def test_stream_rows_count_the_peer_only(bench: Bench) -> None:
    came = TopicReport(9, 0, 0, 3, 2, 0, 0, 1, 0, 0, 0, 48, 0, 0, 0, 5_000_000, 6_000_000)
    told = came._replace(msg_type=2, numbers=99, published=99)
    bench.link.delivery_counts_of[PEER] = [
        DeliveryCounts(2, "/imu", 100, 0, 0, 99, 0, 0, 0, 1, 0, 0, 0, told)
    ]
    bench.link.came = [(PEER, "/cmd_vel", "", came), (STRANGER, "/cmd_vel", "", came)]
    rows = bench.report()[0]
    assert [(row.sent, row.messages, row.lost) for row in rows if row.topic == "/imu"] == [
        (100, 99, 1)
    ]
    (back,) = [row for row in rows if row.direction == "from ROS"]
    assert (back.topic, back.type, back.sent, back.messages, back.late) == (
        "/cmd_vel",
        "Twist",
        3,
        2,
        1,
    )
    assert back.age_p99_seconds == 0.006


def test_repeated_stamps_are_dropped_and_jumps_back_in_time_are_not(bench: Bench) -> None:
    def stamps() -> list[int]:
        return [sent["stamp"] for sent in bench.link.sent if sent["topic"] == "/imu"]

    bench.forward("clock", Clock(10**10, 0, 4000, 0))
    for stamp in (10**10, 10**10 + 5, 10**10, 10**10 + 5, 10**10 + 10):
        bench.forward("rover/imu", imu(stamp))
    assert stamps() == [10**10, 10**10 + 5, 10**10 + 10]
    assert bench.report()[1]["stale"] == 2
    bench.forward("clock", Clock(0, 0, 0, 0))
    bench.forward("rover/imu", imu(5))
    assert stamps()[-1] == 5


def test_a_clock_that_is_off_repeats_nothing_and_stands_on_the_wire() -> None:
    bench = Bench()
    offsets = (0, -2 * 10**9, -2 * 10**9, 10**9, 0)
    for number, offset in enumerate(offsets, 1):
        stamp = 10**10 + number * 2_500_000 + offset
        reading = replace(imu(stamp), clock_error_nanos=offset)
        bench.forward("rover/imu", reading)
        bench.forward("rover/imu", reading)  # of a successor that catches up
    expected = [10**10 + n * 2_500_000 + offset for n, offset in enumerate(offsets, 1)]
    assert [message["stamp"] for message in bench.link.sent] == expected
    assert bench.gateway.counts["stale"] == len(offsets)
    decoded = [STORE.deserialize_cdr(m["body"], "sensor_msgs/msg/Imu") for m in bench.link.sent]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in decoded]  # type: ignore[attr-defined]
    assert stamps == expected


def test_only_the_peer_may_send_run_commands(bench: Bench) -> None:
    bench.hear(CONTROL, "", RunCommand(5, wire_commands.RESET).pack(), STRANGER)
    assert bench.run_commands == []
    assert bench.gateway.counts["refused"] == 1
    bench.hear(CONTROL, "", RunCommand(6, wire_commands.RESET).pack())
    assert bench.run_commands == [RunCommand(6, wire_commands.RESET)]
    assert bench.gateway.counts["refused"] == 1


def test_only_the_peer_may_send_world_queries(bench: Bench) -> None:
    bench.hear(CONTROL, "", WorldQuery(5, b"text").pack(), STRANGER)
    assert bench.world_queries == []
    assert bench.gateway.counts["refused"] == 1
    bench.hear(CONTROL, "", WorldQuery(6, b"text").pack())
    assert bench.world_queries == [WorldQuery(6, b"text")]
    assert bench.run_commands == []
    assert bench.gateway.counts["refused"] == 1


def test_pushed_topics_reach_native_ros_nodes(bench: Bench) -> None:
    native: list[tuple[Any, int, bytes]] = []

    class Native:
        """A stand-in of what speaks rmw_zenoh."""

        def offers(self, place: Any) -> bool:
            return place in bench.gateway.pushed

        def publish(self, place: Any, stamp_nanos: int, cdr: memoryview) -> None:
            native.append((place, stamp_nanos, bytes(cdr)))

        def arrived(self) -> list[WireMessage]:
            return [WireMessage(TWIST, "/cmd_vel", "", 0, 0, twist(1, 0, 0, 0, 0, 0))]

    bench.gateway.native = Native()  # type: ignore[assignment]
    bench.forward("clock", Clock(10**9, 0, 400, 0))
    (sent,) = bench.link.sent
    assert native == [((sent["msg_type"], "/clock"), sent["stamp"], sent["body"])]
    bench.gateway.receive_native()
    ((key, command),) = bench.commands
    assert key.endswith("/command")
    assert isinstance(command, Command)
