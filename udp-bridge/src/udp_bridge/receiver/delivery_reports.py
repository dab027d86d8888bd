# SPDX-License-Identifier: Apache-2.0
"""Delivery reports: take what users did with their messages, and report it to the senders.

Users call from any thread. The receiving thread updates the delivery logs and makes the reports.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, List, Optional, Tuple

from udp_bridge.wire.control import LinkReport, TopicReport
from udp_bridge.wire.header import NANOS
from udp_bridge.wire.message import Address, Message

from .ordering import MessageKey, key_of
from .peers import PeerTable
from .reassembly import Reassembler

REPORTED_NANOS = 5 * NANOS
"""A sender gets reports for this long after its last datagram."""

Answer = Tuple[bytes, Address]
SentReport = Tuple[Address, str, str, TopicReport]
"""Sender, topic, link and report."""
_Outcome = Tuple[Address, int, str, MessageKey, Optional[int]]
"""Sender, msg_type, topic, message and time of publication; None if it was dropped."""


class DeliveryReports:
    """Outcomes of messages on their way from users to the reports."""

    def __init__(self, reassembler: Reassembler) -> None:
        self.last: List[SentReport] = []
        """The topic reports that `reports` returned last."""
        self._reassembler = reassembler
        self._outcomes: Deque[_Outcome] = deque()  # appended in any thread

    @property
    def waiting(self) -> int:
        """Number of outcomes that `update_logs` will enter."""
        return len(self._outcomes)

    def mark_published(self, message: Message, sender: Address, wall_nanos: int) -> None:
        """Record, in any thread, that a message reached its user at this time."""
        key = key_of(message)
        self._outcomes.append((sender, message.msg_type, message.topic, key, wall_nanos))

    def mark_dropped(self, message: Message, sender: Address) -> None:
        """Record, in any thread, that a message will not reach its user."""
        key = key_of(message)
        self._outcomes.append((sender, message.msg_type, message.topic, key, None))

    def update_logs(self) -> None:
        """Enter delivered messages and their outcomes into the delivery logs."""
        self._reassembler.log_delivered()
        while self._outcomes:
            sender, msg_type, topic, key, wall_nanos = self._outcomes.popleft()
            log = self._reassembler.delivery_log(sender, msg_type, topic)
            if log is None:
                continue
            if wall_nanos is None:
                log.mark_dropped(key)
            else:
                log.mark_published(key, wall_nanos)

    def reports(
        self, peers: PeerTable, link_report: LinkReport, now_nanos: int, wall_nanos: int
    ) -> List[Answer]:
        """Return the reports to all senders that sent something lately, as datagrams."""
        self.update_logs()
        answers = []
        last = []
        for sender, peer in peers:
            if now_nanos - peer.last_heard_nanos > REPORTED_NANOS:
                continue
            for topic, link, report in self._reassembler.reports(sender, wall_nanos):
                last.append((sender, topic, link, report))
                answers.append((peer.pack_control(topic, link, wall_nanos, report), sender))
            answers.append((peer.pack_control("", "", wall_nanos, link_report), sender))
        self.last = last  # read by other threads, so it is replaced as a whole
        return answers
