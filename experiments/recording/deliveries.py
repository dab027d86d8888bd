# SPDX-License-Identifier: Apache-2.0
"""Delivery of messages to ROS: compares a bag with a recording of the bus, byte by byte.

Messages in transit at the edges of the bag are ignored.
"""

import csv
import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from mcap.reader import make_reader

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.ros.streams import outgoing
from groundlink.scenario import Scenario

IN_TRANSIT_NANOS = NANOS // 4
"""Ignored time at both ends: late messages may not have been sent, and DDS discovery takes time."""


@dataclass(frozen=True)
class TopicDelivery:
    """Delivery of one topic."""

    topic: str
    sent: int
    """Messages published on the bus."""

    arrived: int
    """Messages in the bag with the same bytes."""

    other: int
    """Messages in the bag with other bytes."""

    @property
    def lost(self) -> int:
        """Messages that are not in the bag."""
        return self.sent - self.arrived


def compare_delivery(bus: Path, bag: Path, scenario: Scenario) -> list[TopicDelivery]:
    """Return the delivery of each topic pushed to ROS.

    Parameters
    ----------
    bus
        a recording of the run, by Groundlink's own recorder.
    bag
        recording of a ROS node.
    """
    topics = [stream.topic for stream in outgoing(scenario, "") if stream.push]
    first, last = zip(*(_clocks(file) for file in (bus, bag)), strict=True)
    span = range(max(first) + IN_TRANSIT_NANOS, min(last) - IN_TRANSIT_NANOS)
    sent, got = (_digests(file, topics, span) for file in (bus, bag))
    return [
        TopicDelivery(
            topic,
            sent=sent[topic].total(),
            arrived=(sent[topic] & got[topic]).total(),
            other=(got[topic] - sent[topic]).total(),
        )
        for topic in topics
    ]


def _clocks(file: Path) -> tuple[int, int]:
    """Return the first and the last time of the clock."""
    with file.open("rb") as stream:
        messages = make_reader(stream).iter_messages(["/clock"], log_time_order=False)
        times = [message.log_time for _, _, message in messages]
    if not times:
        raise UserError(f"{file}: no /clock messages recorded")
    return min(times), max(times)


def _digests(file: Path, topics: Iterable[str], span: range) -> dict[str, Counter[bytes]]:
    """Return digests of the messages of each topic in a time, with how often there were."""
    found: dict[str, Counter[bytes]] = {topic: Counter() for topic in topics}
    with file.open("rb") as stream:
        reader = make_reader(stream)
        for _, channel, message in reader.iter_messages(list(found), log_time_order=False):
            if message.log_time in span:
                found[channel.topic][_digest(message.data)] += 1
    return found


def _digest(cdr: bytes) -> bytes:
    """Return a digest of a message, filled up to four bytes as DDS does it on its way."""
    return hashlib.blake2b(cdr + bytes(-len(cdr) % 4), digest_size=12).digest()


def loss_summary(deliveries: Sequence[TopicDelivery]) -> str:
    """Return the losses as text; empty for none."""
    return ", ".join(
        f"{delivery.topic}: {delivery.lost} of {delivery.sent} lost, {delivery.other} changed"
        for delivery in deliveries
        if delivery.lost or delivery.other
    )


def write_deliveries(file: Path, deliveries: Iterable[TopicDelivery]) -> None:
    """Write deliveries as CSV."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, [field.name for field in fields(TopicDelivery)])
        writer.writeheader()
        writer.writerows(map(asdict, deliveries))


def read_deliveries(file: Path) -> list[TopicDelivery]:
    """Return deliveries as they were written."""
    with file.open(encoding="utf-8", newline="") as stream:
        return [
            TopicDelivery(row["topic"], int(row["sent"]), int(row["arrived"]), int(row["other"]))
            for row in csv.DictReader(stream)
        ]
