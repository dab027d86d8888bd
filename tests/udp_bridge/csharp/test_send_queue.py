# SPDX-License-Identifier: Apache-2.0
"""The pace and the accounts of a sender in C#: what leaves when is what leaves in Python."""

import hashlib
import random
import struct
from typing import Any

import pytest

from udp_bridge import Header, Message, parse
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.wire.control import Credit, CreditRequest, LinkReport, TopicReport
from udp_bridge.wire.message import DatagramKey
from udp_bridge.wire.types import CONTROL

from .programs import Exchange

MILLI = 10**6
SECOND = 10**9
EPOCH = 1_700_000_000 * SECOND
NEVER = 2**63 - 1
LOOPBACK = 0


class Twin:
    """A send queue of the library, and the questions by which C# repeats what it does."""

    def __init__(self, largest: int) -> None:
        self.queue = SendQueue(("127.0.0.1", 1), largest or "loopback")
        self.largest = largest
        self.now = 0
        self.rows: list[bytes] = []
        self.lines: list[str] = []
        self.sent: list[bytes] = []

    def put(self, kind: int, topic: str, link: str, body: bytes) -> None:
        stamp = EPOCH + self.now
        self.queue.put(Message(kind, topic, link, stamp, 0, body))
        texts = topic.encode(), link.encode(), body
        packed = b"".join(struct.pack("<i", len(text)) + text for text in texts)
        self._ask("p", struct.pack("<Bq", kind, stamp) + packed)

    def take(self) -> None:
        """Send all that may leave now."""
        self._ask("n")
        while (datagram := self.queue.take(self.now)) is not None:
            self.sent.append(datagram.header + bytes(datagram.part))
            digest = hashlib.sha256(self.sent[-1]).hexdigest().upper()
            self.lines.append(f"datagram {len(self.sent[-1])} x{digest}")
        wake = self.queue.next_wake(self.now)
        is_idle = self.queue.is_idle
        wake = NEVER if wake is None else wake
        self.lines.append(f"wake {wake} {is_idle} {self.queue.flow.stalls}")

    def credit(self, datagram: bytes, receive_buffer: int) -> None:
        """Let the peer acknowledge a datagram."""
        of, _ = parse(datagram)
        key = DatagramKey(of.msg_type, of.topic, of.seq_number, of.part_number)
        self.queue.flow.credited(key, receive_buffer, self.now)
        body = Credit(key.msg_type, key.part_number, key.seq_number, receive_buffer).pack()
        self._control(of.topic, body)

    def report(self, topic: str, report: TopicReport) -> None:
        self.queue.delivery.reported(topic, report, EPOCH + self.now)
        self._control(topic, report.pack())

    def link_report(self, report: LinkReport) -> None:
        self._control("", report.pack())

    def deliveries(self, *others: str) -> None:
        """Compare what became of the messages, and lines that follow."""
        self._ask("d")
        for one in sorted(self.queue.delivery.counts(self.now), key=lambda one: one[:2]):
            counts = [*one[2:11], one.delivered_bytes]
            self.lines.append(" ".join(map(str, ("deliveries", one.msg_type, one.topic, *counts))))
        self.lines.extend(others)

    def compare(self, exchange: Exchange) -> None:
        question = b"Q" + struct.pack("<iI", self.largest, len(self.rows)) + b"".join(self.rows)
        *answer, _ = [" ".join(words) for words in exchange.ask(question)]
        assert answer == self.lines

    def _control(self, topic: str, body: bytes) -> None:
        head = Header(CONTROL, 0, 0, 1, (EPOCH + self.now) // SECOND, self.now % SECOND, topic)
        control = head.pack() + body
        self._ask("c", struct.pack("<i", len(control)) + control)

    def _ask(self, operation: str, rest: bytes = b"") -> None:
        self.rows.append(operation.encode() + struct.pack("<q", self.now) + rest)


@pytest.mark.parametrize(
    ("largest", "seed"), [(1472, 0), (9000, 1), (LOOPBACK, 2), (1472, 3), (LOOPBACK, 3)]
)
def test_datagrams_leave_as_those_of_python(largest: int, seed: int, exchange: Exchange) -> None:
    rng = random.Random(f"{largest} {seed}")
    twin = Twin(largest)
    is_answering = seed != 3  # a peer that sends no Credits
    for _ in range(100):
        twin.now += rng.choice([0, 100_000, MILLI, 7 * MILLI, 30 * MILLI, 300 * MILLI])
        for _ in range(rng.choice([0, 0, 1, 3])):
            size = rng.choice([0, 5, 1000, 60_000, 200_000])
            topic, link = rng.choice(["/a", "/b", "/c"]), rng.choice(["", "lidar"])
            twin.put(rng.choice([1, 3]), topic, link, rng.randbytes(size))
        twin.take()
        if is_answering and twin.sent and rng.random() < 0.7:
            twin.credit(rng.choice(twin.sent[-20:]), rng.choice([16_384, 212_992, 8 << 20]))
            twin.take()
    twin.deliveries()
    requests = [datagram for datagram in twin.sent if datagram[0] == CONTROL]
    assert {datagram[-4:] for datagram in requests} == {CreditRequest().pack()}
    assert len({datagram[:16] for datagram in twin.sent}) > 100
    assert (twin.queue.flow.stalls > 0) == is_answering or seed == 3
    twin.compare(exchange)


def test_messages_that_wait_give_way_to_newer_ones(exchange: Exchange) -> None:
    """Small ones when 512 of a topic wait, large ones at once, per topic and link."""
    twin = Twin(1472)
    for number in range(600):
        twin.put(9, "/cmd_vel", "", struct.pack("<I", number))
    for number, link in enumerate(["front", "rear", "front", "front"]):
        twin.put(1, "/points", link, bytes([number]) * 5000)
    twin.take()
    twin.now += 20 * MILLI
    twin.take()
    twin.deliveries()
    assert twin.lines[-2].split()[3:6] == ["2", "10000", "2"]
    assert twin.lines[-1].split()[3:6] == ["512", "2048", "88"]
    twin.compare(exchange)


def test_sender_knows_its_losses(exchange: Exchange) -> None:
    twin = Twin(1472)
    for _ in range(20):
        twin.put(2, "/imu", "imu_link", bytes(100))
        twin.take()
        twin.now += 100 * MILLI
        twin.deliveries()
    own = report(first=2, numbers=15, published=9, dropped=1, incomplete=2, late=1, pending=1)
    foreign: list[dict[str, Any]] = [
        {"first_seen_stamp_nanos": EPOCH - 1},  # of a sender before this one
        {"numbers": 30},
        {"first_number": 25},
        {"msg_type": 3},  # a topic that was never sent
    ]
    for other in foreign:
        twin.report("/imu", own._replace(**other))
        twin.deliveries()
    twin.report("/imu", own)
    twin.deliveries()
    assert twin.lines[-1] == "deliveries 2 /imu 20 2000 0 9 1 2 1 3 4 900"
    twin.now -= 50 * MILLI  # one that was reordered
    twin.report("/imu", own._replace(published=0))
    twin.now += 5050 * MILLI
    twin.deliveries()  # the last three were never reported
    restarted = report(first=18, numbers=2, published=2, since=2, seen=EPOCH + 1800 * MILLI)
    twin.report("/imu", restarted)
    twin.deliveries()
    twin.now += SECOND
    again = restarted._replace(since_nanos=3, first_number=0, numbers=20, published=12)
    twin.report("/imu", again._replace(first_seen_stamp_nanos=EPOCH))
    twin.deliveries()  # more than were sent: the excess is taken from the incomplete first
    twin.compare(exchange)


def test_link_report_of_the_peer_is_read(exchange: Exchange) -> None:
    twin = Twin(1472)
    twin.link_report(LinkReport(1, 2, 3, 9, 5, (("unknown_type", 7), ("short", 2))))
    twin.deliveries("peer 1 2 3 9 5 [unknown_type, 7] [short, 2]")
    twin.link_report(LinkReport(2**32 - 1, 2**64 - 1, 0, 0, 0))
    twin.deliveries(f"peer {2**32 - 1} {2**64 - 1} 0 0 0")
    twin.compare(exchange)


def report(*, first: int, seen: int = EPOCH + 200 * MILLI, **counts: int) -> TopicReport:
    """Return a report of the IMU, by default of the first receiver."""
    empty = TopicReport(*([0] * len(TopicReport._fields)))
    counts = {"since_nanos": counts.pop("since", 1), **counts}
    counts["body_bytes"] = 100 * counts["published"]
    return empty._replace(msg_type=2, first_number=first, first_seen_stamp_nanos=seen, **counts)
