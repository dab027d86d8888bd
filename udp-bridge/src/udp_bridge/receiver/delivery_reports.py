# SPDX-License-Identifier: Apache-2.0
"""What users say became of their messages, and what senders are told about what arrived.

Users speak in any thread; what they said is taken note of in the thread that receives, which also
makes the reports. No socket and no clock here.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, List, Optional, Tuple, Union

from udp_bridge.wire.control import Credit, LinkReport, TopicReport
from udp_bridge.wire.header import NANOS, Header
from udp_bridge.wire.message import Address, Message
from udp_bridge.wire.types import CONTROL

from .arrivals import Key, key_of
from .peers import Peer, Peers
from .reassembly import Reassembler

HEARD_NANOS = 5 * NANOS
"""A sender is reported to for this long after its last datagram."""

Answer = Tuple[bytes, Address]
Told = Tuple[Address, str, str, TopicReport]
_Fate = Tuple[Address, int, str, Key, Optional[int]]


class Telling:
    """The fates of messages on their way from users to reports."""

    def __init__(self, reassembler: Reassembler) -> None:
        self.told: List[Told] = []
        """Sender, topic, link and report: what `reports` told last."""
        self._reassembler = reassembler
        self._fates: Deque[_Fate] = deque()  # appended to by any thread, taken by ours

    def published(self, message: Message, sender: Address, wall_nanos: int) -> None:
        """Take note, from any thread, that a message reached its user at this time."""
        self._fates.append((sender, message.msg_type, message.topic, key_of(message), wall_nanos))

    def dropped(self, message: Message, sender: Address) -> None:
        """Take note, from any thread, that a message will not reach its user."""
        self._fates.append((sender, message.msg_type, message.topic, key_of(message), None))

    def take_note(self) -> None:
        """Count what was handed over, and what users said of it."""
        self._reassembler.take_note()
        while self._fates:
            sender, msg_type, topic, key, wall_nanos = self._fates.popleft()
            arrived = self._reassembler.arrived(sender, msg_type, topic)
            if arrived is None:
                continue
            if wall_nanos is None:
                arrived.drop(key)
            else:
                arrived.published(key, wall_nanos)

    def reports(
        self, peers: Peers, link_report: LinkReport, now_nanos: int, wall_nanos: int
    ) -> List[Answer]:
        """Return what to tell the senders that were heard lately about what arrived."""
        self.take_note()
        answers = []
        told = []
        for sender, peer in peers:
            if now_nanos - peer.heard_nanos > HEARD_NANOS:
                continue
            for topic, link, report in self._reassembler.reports(sender, wall_nanos):
                told.append((sender, topic, link, report))
                answers.append((control_of(peer, topic, link, wall_nanos, report), sender))
            answers.append((control_of(peer, "", "", wall_nanos, link_report), sender))
        self.told = told
        return answers


def control_of(
    peer: Peer,
    topic: str,
    link: str,
    stamp_nanos: int,
    body: Union[Credit, TopicReport, LinkReport],
) -> bytes:
    """Return the datagram of a Control message to a peer."""
    number = peer.numbering.next(CONTROL, topic)
    sec, nsec = divmod(stamp_nanos, NANOS)
    return Header(CONTROL, number, 0, 1, sec, nsec, topic, link).pack() + body.pack()
