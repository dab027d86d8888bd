# SPDX-License-Identifier: Apache-2.0
"""System tests of both directions over Ethernet-sized datagrams.

The tests cover LiDAR blocks, subscriptions of both sides, and poses and maps from ROS.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import FROM_ROS, RELAYED, STREAM_TOPICS
from groundlink.messages.base import BusMessage, Relayed, State
from groundlink.ros.cdr import ROS_CODECS, to_cdr
from tests.udp_bridge.vectors import VECTORS
from tests.vectors.examples import EXAMPLES, fields
from udp_bridge import Link, Reassembler
from udp_bridge import Message as WireMessage
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.types import MSG_TYPES, type_number

from .rig import Observer, Rig, rig, wait_for

pytestmark = pytest.mark.system

ODOMETRY = type_number("Odometry")
CLOUD = type_number("PointCloud2")
SCAN = type_number("LaserScan")
PATH = "nav_msgs/msg/Path"
LAB_CHANGES = (
    ("block_deg: 0, ", ""),
    ("map: /map}", "map: /map, topics: {/plan: nav_msgs/Path}}"),
    (
        "    sensors:\n",
        "    streams: [{name: scan, kind: laser_scan, topic: /scan, rate_hz: 10, push: false}]\n"
        "    sensors:\n",
    ),
)


@dataclass
class Running:
    rig: Rig
    observer: Observer
    bus: Bus


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    # Fast: a busy machine may take its time, and everything is waited for.
    with rig(tmp_path_factory.mktemp("run"), time_section="time: {mode: fast}\n") as it:
        text = it.scenario.read_text(encoding="utf-8")
        text = text.replace("gateway: {", "gateway: {datagram: mtu, ")
        for old, new in LAB_CHANGES:
            assert old in text
            text = text.replace(old, new)
        it.scenario.write_text(text, encoding="utf-8")
        observer = Observer(it)
        it.up()
        wait_for(lambda: observer.count("/points") > 24, 60, "blocks arrive in ROS")
        with Bus(connect=it.endpoint) as bus:
            yield Running(it, observer, bus)


class Subscriber:
    """A plain receiver that subscribes to topics as any peer may."""

    def __init__(self, it: Rig) -> None:
        self.got: list[WireMessage] = []
        self.link = Link(("127.0.0.1", 0), it.bind, on_message=lambda got, _: self.take(got))

    def take(self, message: WireMessage) -> None:
        if MSG_TYPES[message.msg_type].ros_type:
            self.got.append(message)

    def subscribe(
        self, msg_type: int, topic: str, *, lease_s: int, max_rate_hz: float = 0.0
    ) -> None:
        body = Subscribe(msg_type, lease_s=lease_s, max_rate_hz=max_rate_hz).pack()
        self.link.send(7, topic, "", time.time_ns(), body)


@pytest.fixture
def subscriber(running: Running) -> Iterator[Subscriber]:
    it = Subscriber(running.rig)
    yield it
    it.link.close()


def test_every_block_arrives(subscriber: Subscriber) -> None:
    """Of some three seconds; a plain receiver, as DDS delays no process."""
    subscriber.subscribe(CLOUD, "/points", lease_s=60)
    wait_for(lambda: len(subscriber.got) >= 700, 60, "700 blocks")
    blocks = subscriber.got[:700]
    gaps = set(np.diff([block.stamp_nanos for block in blocks]).tolist())
    assert gaps == {4_166_666, 4_166_667}, "15 degrees of 10 Hz each"
    assert max(block.parts for block in blocks) <= 37, "datagrams have not grown"
    sizes = np.array([len(block.body) for block in blocks])
    assert sizes.max() <= 150 * 16 * 22 + 200
    assert sizes.mean() > 0.8 * 150 * 16 * 22


def test_ground_truth_comes_during_its_lease_and_is_true(
    running: Running, subscriber: Subscriber
) -> None:
    states: BusInbox[State] = BusInbox(depth=10_000)
    running.bus.subscribe(STATE.key_in(running.rig.run), State, states)
    subscriber.subscribe(ODOMETRY, "/ground_truth/odom", lease_s=60, max_rate_hz=10.0)
    wait_for(lambda: len(subscriber.got) >= 8, 10, "ground truth")
    gaps = np.diff([message.stamp_nanos for message in subscriber.got[:8]])
    assert set(gaps.tolist()) == {100_000_000}, "50 Hz, thinned out to the 10 that were requested"
    known: dict[int, State] = {}

    def true_ones() -> list[WireMessage]:
        while arrived := states.get(seconds=0):
            known[arrived[1].stamp_nanos] = arrived[1]
        return [message for message in list(subscriber.got) if message.stamp_nanos in known]

    both = wait_for(true_ones, 20, "states of the same instants")
    message_type = type(EXAMPLES["odometry"].message)
    for message in both:
        pose = fields(bytes(message.body), message_type)["pose"]["pose"]
        truth = known[message.stamp_nanos].vehicles["rover"].poses()[0]
        assert [pose["position"][axis] for axis in "xyz"] == truth[:3].tolist()
        assert [pose["orientation"][axis] for axis in "xyzw"] == truth[3:].tolist()
    subscriber.subscribe(ODOMETRY, "/ground_truth/odom", lease_s=1, max_rate_hz=10.0)
    wait_for(lambda: is_over(subscriber), 10, "the end of the lease")
    count = len(subscriber.got)
    subscriber.subscribe(ODOMETRY, "/ground_truth/odom", lease_s=2)
    wait_for(lambda: len(subscriber.got) > count, 10, "ground truth for who asks anew")


def is_over(subscriber: Subscriber) -> bool:
    before = len(subscriber.got)
    time.sleep(0.5)  # five messages of the requested rate
    return len(subscriber.got) == before


def test_what_another_process_publishes_is_carried(
    running: Running, subscriber: Subscriber
) -> None:
    scan = EXAMPLES["laser-scan"].message
    key = STREAM_TOPICS["laser_scan"].key_in(running.rig.run, vehicle="rover", sensor="scan")
    publish = running.bus.publisher(key, STREAM_TOPICS["laser_scan"].delivery)
    subscriber.subscribe(SCAN, "/scan", lease_s=30)
    stamp = time.time_ns()

    def comes() -> bool:
        nonlocal stamp
        stamp += 1_000_000
        publish(replace(scan, stamp_nanos=stamp))
        return bool(subscriber.got)

    wait_for(comes, 10, "a scan")
    message = subscriber.got[0]
    expected = replace(scan, stamp_nanos=message.stamp_nanos)
    assert (message.msg_type, message.topic, message.link) == (SCAN, "/scan", "laser_link")
    assert bytes(message.body) == bytes(to_cdr(expected))


def test_a_pose_and_a_map_of_ros_are_typed_messages_on_the_bus(running: Running) -> None:
    it = running.rig
    for name in ("pose", "map"):
        example = EXAMPLES[name]
        row = FROM_ROS[name]
        inbox: BusInbox[BusMessage] = BusInbox(depth=100)
        key = row.key_in(it.run, vehicle="rover")
        running.bus.subscribe(key, row.message, inbox)
        ros_type = ROS_CODECS[row.message].ros_type
        body = bytes(to_cdr(example.message)).hex()
        it.start("-m", "tests.ros.replayer", ros_type, f"/{name}", body, log=f"{name}.log")
        arrived = inbox.get(seconds=20)
        assert arrived, it.log(f"{name}.log")
        assert arrived == (key, example.message)


def test_any_further_topic_of_ros_is_on_the_bus_as_it_came(running: Running) -> None:
    it = running.rig
    (path,) = [vector for vector in VECTORS if vector.name == "path"]
    reassembler = Reassembler()
    for datagram in path.datagrams:
        whole = reassembler.receive(datagram, "", 0)
    assert whole
    inbox: BusInbox[BusMessage] = BusInbox(depth=100)
    running.bus.subscribe(RELAYED.key_in(it.run), Relayed, inbox)
    it.start("-m", "tests.ros.replayer", PATH, "/plan", bytes(whole.body).hex(), log="plan.log")
    arrived = inbox.get(seconds=20)
    assert arrived, it.log("plan.log")
    key, message = arrived
    assert key == RELAYED.key_in(it.run, vehicle="rover", topic="plan")
    assert isinstance(message, Relayed)
    assert (message.ros_type, bytes(message.cdr)) == (PATH, bytes(whole.body))
