# SPDX-License-Identifier: Apache-2.0
"""The node in C++ as its peers have it: loss, restarts, slow publishers, lockstep, bad bytes."""

import random
import re
import struct
import time
from pathlib import Path

import pytest

from tests.ros.waiting import wait_until
from tests.system.rig import free_port
from tests.udp_bridge.vectors import VECTORS
from udp_bridge import Link, Message
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.sender.repair import Resend
from udp_bridge.wire import control
from udp_bridge.wire.control import Barrier, Subscribe
from udp_bridge.wire.lockstep import (
    DONE,
    INCOMPLETE,
    RESTARTED,
    WAITING,
    BarrierReply,
    ExpectedResponse,
    SentMessages,
)
from udp_bridge.wire.types import CONTROL, SUBSCRIBE, type_number

from .rclcpp_node import LossyRelay, RclcppNode

pytestmark = pytest.mark.system

IMU, CLOCK, TWIST, ODOM = map(type_number, ("Imu", "Clock", "Twist", "Odometry"))
LOCAL = ("127.0.0.1", 0)
LIMIT_NANOS = 4_000_000_000
CDR = b"\0\1\0\0"
SMALL_BODY = CDR + bytes(48)


def numbered(number: int, size: int = 0) -> bytes:
    return CDR + struct.pack("<I", number) + bytes(size)


def counts(node: RclcppNode) -> dict[str, int]:
    """Return the totals that the node printed at its end."""
    line = next(line for line in node.log if "published" in line and "sent back" in line)
    found = re.findall(r"([a-z ]+) (\d+)", line.removeprefix("log "))
    return {name.strip(): int(count) for name, count in found}


def test_what_is_lost_on_either_path_is_resent(thread_checked: Path, share: Path) -> None:
    """A tenth of all datagrams is lost, those of repair included."""
    with RclcppNode(thread_checked, share, repair="resend 4", datagram="mtu") as node:
        relay = LossyRelay(node.address, 0.1, seed=3)
        received: list[Message] = []
        table = {(1, "/points"): Resend(LIMIT_NANOS), (IMU, "/imu"): Resend(LIMIT_NANOS)}
        with Link(
            LOCAL,
            relay.address,
            datagram=1472,
            repair=table,
            on_message=lambda message, _: received.append(message),
        ) as link:
            for number in range(60):
                link.send(IMU, "/imu", "imu", time.time_ns(), numbered(number))
                if number % 3 == 0:
                    link.send(1, "/points", "lidar", time.time_ns(), numbered(number, 20_000))
                request = Subscribe(11, lease_s=30).pack()
                link.send(SUBSCRIBE, "/map", "", time.time_ns(), request)
                time.sleep(0.01)

            def of_topic(topic: str) -> set[bytes]:
                return {row.body for row in node.published if row.topic == topic}

            wait_until(lambda: len(of_topic("/imu")) == 60 and len(of_topic("/points")) == 20)
            for number in range(20):
                body = numbered(number, 8)[:4] + struct.pack("<iII", 1, number, 1) + bytes(20_000)
                node.say("message", "/map", body.hex())
                time.sleep(0.01)
            wait_until(lambda: len({m.stamp_nanos for m in received if m.msg_type == 11}) == 20)
            wait_until(
                lambda: any(c.repaired for c in link.delivery_counts()), "a report of repair"
            )
        relay.close()
    assert relay.lost > 50
    assert of_topic("/imu") == {numbered(number) for number in range(60)}
    assert counts(node)["incomplete"] == 0


def test_a_peer_that_starts_again_is_a_new_count(thread_checked: Path, share: Path) -> None:
    with RclcppNode(thread_checked, share) as node:
        address = ("127.0.0.1", free_port())
        for run in range(2):
            with Link(address, node.address) as link:
                for number in range(20):
                    link.send(IMU, "/imu", "imu", time.time_ns(), numbered(100 * run + number))
                wait_until(lambda run=run: len(node.published) == 20 * (run + 1))  # type: ignore[misc]
                wait_until(
                    lambda link=link: [c.delivered for c in link.delivery_counts()] == [20],  # type: ignore[misc]
                    "the report of this count",
                )
    assert counts(node)["published"] == 40


def test_a_slow_publisher_costs_its_own_messages_which_are_counted(
    thread_checked: Path, share: Path
) -> None:
    sent = 40
    with RclcppNode(thread_checked, share) as node:
        node.say("slow", 100)
        with Link(LOCAL, node.address) as link:
            for number in range(sent):
                link.send(1, "/points", "lidar", time.time_ns(), numbered(number, 500_000))
                assert link.flush(10)
            wait_until(lambda: bool(node.published), "a cloud")

            def is_reported() -> bool:
                (row,) = link.delivery_counts()
                return row.delivered + row.dropped == sent

            wait_until(is_reported, "what became of each")
            (row,) = link.delivery_counts()
        node.say("slow", 0)
    assert row.dropped > 0
    assert row.delivered == len(node.published) == sent - row.dropped
    assert node.published[-1].body == numbered(sent - 1, 500_000)
    assert counts(node)["dropped"] == row.dropped


class Gateway:
    """A gateway in lockstep with the node."""

    episode = 77

    def __init__(self, node: RclcppNode) -> None:
        self.replies: list[tuple[str, BarrierReply]] = []
        self.received: list[Message] = []
        self.link = Link(LOCAL, node.address, on_message=self._take)
        self.responses: tuple[ExpectedResponse, ...] = (ANSWER,)
        self.in_turn = False
        self._next = 0

    def send(self, tick: int) -> tuple[SentMessages, ...]:
        """Send an odometry and the clock of a tick; return how a Barrier lists them."""
        number, self._next = self._next, self._next + 1
        for kind, topic in ((CLOCK, "/clock"), (ODOM, "/odom")):
            self.link.send(kind, topic, "", 1_000 + tick, numbered(tick, 8))
        return tuple(SentMessages(kind, topic, number, 1) for kind, topic in KEYS)

    def barrier(self, tick: int, sent: tuple[SentMessages, ...] = ()) -> BarrierReply:
        """Send a Barrier; return the answer to it."""
        self.replies.clear()
        body = Barrier(self.episode, tick, 1000, sent, self.responses, self.in_turn).pack()

        def is_answered() -> bool:
            self.link.send(CONTROL, "", "", tick, body)  # repeated, as a gateway does
            time.sleep(0.02)
            return any(reply.tick == tick for _, reply in self.replies)

        wait_until(is_answered, f"tick {tick}")
        return self.replies[-1][1]

    def repeat(self, tick: int, sent: tuple[SentMessages, ...], state: int) -> BarrierReply:
        """Repeat a Barrier until the answer has a state."""
        wait_until(lambda: self.barrier(tick, sent).state == state, f"state {state} of {tick}")
        return self.replies[-1][1]

    def _take(self, message: Message, _: object) -> None:
        body = control.parse(message.body) if message.msg_type == CONTROL else None
        if isinstance(body, BarrierReply):
            self.replies.append((message.topic, body))
        elif body is None:
            self.received.append(message)


KEYS = ((CLOCK, "/clock"), (ODOM, "/odom"))
ANSWER = ExpectedResponse("/cmd_vel", "/odom", TWIST)


def test_lockstep_publishes_in_order_and_waits_for_the_response(
    thread_checked: Path, share: Path
) -> None:
    with RclcppNode(thread_checked, share) as node:
        node.say("subscribers", "/odom", 1)
        node.say("publisher", "/cmd_vel", "geometry_msgs/msg/Twist")
        gateway = Gateway(node)
        gateway.link.send(SUBSCRIBE, "/cmd_vel", "", 0, Subscribe(TWIST, lease_s=60).pack())
        wait_until(lambda: node.subscribed == ["/cmd_vel geometry_msgs/msg/Twist 10,best_effort"])
        assert gateway.repeat(-1, (), DONE) == BarrierReply(77, -1, DONE)
        for tick in range(3):
            sent = gateway.send(tick)
            gateway.repeat(tick, sent, WAITING)
            assert gateway.replies[-1][0] == "/cmd_vel"
            wait_until(lambda tick=tick: len(node.published) == 2 * tick + 2)  # type: ignore[misc]
            assert [row.topic for row in node.published[-2:]] == ["/odom", "/clock"]
            node.say("message", "/cmd_vel", SMALL_BODY.hex())
            reply = gateway.repeat(tick, sent, DONE)
            assert reply.lost == 0
            assert reply.sent == (SentMessages(TWIST, "/cmd_vel", tick, 1),)
            wait_until(lambda tick=tick: len(gateway.received) == tick + 1)  # type: ignore[misc]
        # One message of the next tick is lost: it is counted, and the run goes on.
        sent = (*gateway.send(3)[:1], SentMessages(ODOM, "/odom", 3, 2))
        assert gateway.barrier(3, sent).state == INCOMPLETE
        gateway.repeat(3, sent, WAITING)
        node.say("message", "/cmd_vel", SMALL_BODY.hex())
        assert gateway.repeat(3, sent, DONE).lost == 1
        gateway.link.close()
    assert any("in lockstep with" in line and "/cmd_vel to /odom" in line for line in node.log)


FILTERED = ExpectedResponse("/filtered", "/odom", every=2)
CHAIN = (FILTERED, ExpectedResponse("/cmd_vel", "/filtered", TWIST))
"""A graph of two nodes: one publishes for every second odometry, and the other answers that."""


def test_in_turn_each_message_waits_for_the_responses_to_those_before(
    thread_checked: Path, share: Path
) -> None:
    with RclcppNode(thread_checked, share) as node:
        node.say("subscribers", "/odom", 1)
        node.say("subscribers", "/filtered", 1)
        node.say("publisher", "/filtered", "nav_msgs/msg/Odometry")
        node.say("publisher", "/cmd_vel", "geometry_msgs/msg/Twist")
        gateway = Gateway(node)
        gateway.link.send(SUBSCRIBE, "/cmd_vel", "", 0, Subscribe(TWIST, lease_s=60).pack())
        wait_until(lambda: len(node.subscribed) == 1)
        gateway.responses, gateway.in_turn = CHAIN, True
        gateway.repeat(-1, (), DONE)
        for number in range(4):
            gateway.link.send(ODOM, "/odom", "", 1_000 + number, numbered(number, 8))
        sent = (SentMessages(ODOM, "/odom", 0, 4),)
        wait_until(lambda: gateway.barrier(0, sent).state == WAITING and len(node.published) == 2)
        assert "/filtered nav_msgs/msg/Odometry 100,reliable" in node.subscribed
        for count in (2, 4):
            gateway.repeat(0, sent, WAITING)
            assert gateway.replies[-1][0] == "/filtered"
            assert len(node.published) == count
            node.say("message", "/filtered", SMALL_BODY.hex())
            wait_until(lambda: gateway.barrier(0, sent) and gateway.replies[-1][0] == "/cmd_vel")
            assert len(node.published) == count
            node.say("message", "/cmd_vel", SMALL_BODY.hex())
            wait_until(lambda: len(node.published) == 4)
        reply = gateway.repeat(0, sent, DONE)
        assert reply.sent == (SentMessages(TWIST, "/cmd_vel", 0, 2),)
        # One more than what was consumed: time goes on, and the log says it.
        node.say("message", "/cmd_vel", SMALL_BODY.hex())
        wait_until(lambda: len(gateway.received) == 3)
        gateway.repeat(1, (), DONE)
        node.wait_for("1 messages on /cmd_vel more than what its node consumed")
        gateway.link.close()
    assert [row.body for row in node.published] == [numbered(number, 8) for number in range(4)]


def test_a_node_that_is_started_during_a_run_asks_for_what_was_sent(
    thread_checked: Path, share: Path
) -> None:
    with RclcppNode(thread_checked, share) as node:
        gateway = Gateway(node)
        sent = (SentMessages(ODOM, "/odom", 7, 1),)  # to a node that ran before
        assert gateway.barrier(8, sent).state == RESTARTED
        assert gateway.repeat(8, sent, RESTARTED).sent == ()
        gateway.link.close()


def test_hostile_datagrams_end_nothing(memory_checked: Path, share: Path) -> None:
    rng = random.Random(5)
    samples = [datagram for vector in VECTORS for datagram in vector.datagrams[:3] if datagram]
    samples += [
        Message(CONTROL, "", "", 0, 0, body).header().pack() + body
        for body in (
            Barrier(1, 0, 9, (SentMessages(2, "/imu", 0, 2),), (ANSWER,)).pack(),
            Subscribe(9).pack(),
        )
    ]
    offer = Message(65, "/imu", "", 5, 900, b"").header().pack()
    samples += [offer + bytes([0, 2, 1, 0, 9, 0, 0, 0]), offer + bytes([1, 2, 1, 1, 0, 0, 0, 0, 1])]
    with RclcppNode(memory_checked, share) as node:
        socket = UdpSocket(LOCAL, receive_buffer=1 << 20, wait_s=0.1)
        for index in range(4000):
            datagram = bytearray(rng.choice(samples))
            for _ in range(rng.choice((0, 1, 1, 4))):
                datagram[rng.randrange(len(datagram))] = rng.choice((0, 1, 255, rng.randrange(256)))
            end = len(datagram) if rng.random() < 0.8 else rng.randrange(len(datagram))
            socket.send([bytes(datagram[:end])], node.address)
            if index % 100 == 0:
                time.sleep(0.01)
        socket.close()
        with Link(LOCAL, node.address) as link:
            link.send(IMU, "/after", "imu", time.time_ns(), numbered(1))
            wait_until(lambda: any(row.topic == "/after" for row in node.published))
    assert counts(node)["refused"] > 100


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"bind": "0.0.0.0:0"}, "~peer"),
        ({"bind": "nowhere"}, "bind is 'nowhere'; expected HOST:PORT"),
        ({"key_file": "key"}, "only the Python nodes have it"),
        ({"trace": "trace.jsonl"}, "trace: only the Python nodes have it"),
        ({"allow_any_peer": "true"}, "only the Python nodes have it"),
        ({"datagram": "12"}, "datagram is '12'"),
        ({"repair": "fec 0.2"}, "repair is 'fec 0.2'"),
    ],
)
def test_an_invalid_setting_is_one_line_and_code_2(
    settings: dict[str, str], said: str, memory_checked: Path, share: Path
) -> None:
    node = RclcppNode(memory_checked, share, **settings)
    assert node.exit_code() == 2
    assert said in node.log[-1]
