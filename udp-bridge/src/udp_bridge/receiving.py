# SPDX-License-Identifier: Apache-2.0
"""What a link does with a datagram that came in: messages out, credits taken, answers written.

No socket, no thread, no clock: answers are returned as bytes to send. Credits go back for
multi-part messages without being asked for; reports only where they are wanted.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Callable, List, Optional, Tuple, Union

from . import control
from .arrivals import Arrivals
from .control import Credit, LinkReport, TopicReport
from .flow import DatagramKey
from .header import NANOS, Header, Refused, parse
from .holdings import Limits
from .message import Message
from .reassembly import Reassembler
from .sending import Address, Numbering
from .types import CONTROL

CREDIT_SHARE = 8
"""A credit goes out at the latest when one part in this many of the receive buffer was taken."""
HEARD_NANOS = 5 * NANOS
"""A sender is reported to for this long after its last datagram."""

Answer = Tuple[bytes, Address]
OnCredit = Callable[[Address, DatagramKey, int], None]


class _Peer:
    """What is known of one sender."""

    def __init__(self) -> None:
        self.numbering = Numbering()
        self.arrivals = Arrivals()
        self.uncredited_bytes = 0
        self.heard_nanos = 0


class Inbox:
    """Everything between a socket that receives and the messages that came in."""

    def __init__(
        self, *, receive_buffer: int, on_credit: OnCredit, limits: Optional[Limits] = None
    ) -> None:
        self.receive_buffer = receive_buffer
        """Bytes of the socket's receive buffer, as the kernel accounts them."""
        self.reassembler = Reassembler(limits)
        self.datagrams = 0
        self.bytes_received = 0
        self.kernel_drops = 0
        """Datagrams that the kernel dropped for want of buffer; the socket's owner sets it."""
        self._on_credit = on_credit
        self._peers: OrderedDict[Address, _Peer] = OrderedDict()

    def receive(
        self, datagram: memoryview, sender: Address, now_nanos: int, wall_nanos: int
    ) -> Tuple[Optional[Message], Optional[Answer]]:
        """Take one datagram; return the message that it completed and the credit to send.

        Parameters
        ----------
        datagram
            Its bytes; the buffer may be reused once this returns.
        sender
            Where it came from.
        now_nanos
            A clock that never goes back.
        wall_nanos
            The wall clock, for the ages of messages.
        """
        self.datagrams += 1
        self.bytes_received += len(datagram)
        try:
            header, offset = parse(datagram)
            message = self.reassembler.accept(header, datagram[offset:], sender, now_nanos)
        except Refused as refused:
            self.reassembler.counters.refuse(refused.reason)
            return None, None
        if header.msg_type == CONTROL:
            return (None if message is None else self._take_control(message, sender)), None
        peer = self._peer(sender, now_nanos)
        if message is not None:
            peer.arrivals.arrived(message, wall_nanos)
        if header.parts_max == 1:
            return message, None
        peer.uncredited_bytes += len(datagram)
        is_end = message is not None or header.part_number == header.parts_max - 1
        if not is_end and peer.uncredited_bytes <= self.receive_buffer // CREDIT_SHARE:
            return message, None
        peer.uncredited_bytes = 0
        return message, self._credit(header, sender, peer)

    def reports(self, now_nanos: int, wall_nanos: int) -> List[Answer]:
        """Return what to tell the senders that were heard lately about what arrived."""
        answers = []
        for sender, peer in self._peers.items():
            if now_nanos - peer.heard_nanos > HEARD_NANOS:
                continue
            tallies = self.reassembler.tallies(sender)
            for topic, link, report in peer.arrivals.reports(tallies):
                answers.append((_control(peer, topic, link, wall_nanos, report), sender))
            answers.append((_control(peer, "", "", wall_nanos, self._link_report()), sender))
        return answers

    def _take_control(self, message: Message, sender: Address) -> Optional[Message]:
        credit = control.parse(message.body)
        if not isinstance(credit, Credit):
            return message
        key = DatagramKey(credit.msg_type, message.topic, credit.seq_number, credit.part_number)
        self._on_credit(sender, key, credit.receive_buffer)
        return None

    def _peer(self, sender: Address, now_nanos: int) -> _Peer:
        peer = self._peers.get(sender)
        if peer is None:
            if len(self._peers) >= self.reassembler.limits.senders:
                self._peers.popitem(last=False)
            peer = self._peers[sender] = _Peer()
        self._peers.move_to_end(sender)
        peer.heard_nanos = now_nanos
        return peer

    def _credit(self, header: Header, sender: Address, peer: _Peer) -> Answer:
        credit = Credit(header.msg_type, header.part_number, header.seq_number, self.receive_buffer)
        return _control(peer, header.topic, "", header.stamp_nanos, credit), sender

    def _link_report(self) -> LinkReport:
        refused = sum(self.reassembler.counters.refused.values())
        return LinkReport(
            self.receive_buffer, self.datagrams, self.bytes_received, refused, self.kernel_drops
        )


def _control(
    peer: _Peer,
    topic: str,
    link: str,
    stamp_nanos: int,
    body: Union[Credit, TopicReport, LinkReport],
) -> bytes:
    number = peer.numbering.next(CONTROL, topic)
    sec, nsec = divmod(stamp_nanos, NANOS)
    return Header(CONTROL, number, 0, 1, sec, nsec, topic, link).pack() + body.pack()
