# SPDX-License-Identifier: Apache-2.0
"""Both ends of a bridge and the emulated link between them, in virtual time.

It uses the bridge's real sender and receiver and the project's link, but no socket, thread or
clock: results are reproducible, and minutes take seconds. Not simulated are the kernel's scheduling
and its buffer overflows.
"""

from typing import NamedTuple

from groundlink.core.clock import NANOS
from groundlink.emulation.model import LinkDirection
from udp_bridge import Message
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.sender.repair import RepairTable
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.sender.waiting import QueueLimits
from udp_bridge.wire.control import LinkReport, TopicReport
from udp_bridge.wire.control import parse as parse_control
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.header import Header
from udp_bridge.wire.message import Address, DatagramKey
from udp_bridge.wire.repair import Request

SENDER, RECEIVER = ("10.0.0.1", 7510), ("10.0.0.2", 7511)
RECEIVE_BUFFER = 8 << 20
_EXPIRY_NANOS = NANOS // 10
"""Period at which an idle receiver expires messages."""


class Handed(NamedTuple):
    """A delivered message, and when."""

    message: Message
    at_nanos: int


class VirtualLink:
    """A sender, a receiver and the link between them.

    Parameters
    ----------
    now_nanos
        time at the start.
    there, back
        directions from the sender to the receiver, and back.
    datagram, repair, signed_peer, limits
        as of `udp_bridge.Link`.
    """

    def __init__(
        self,
        now_nanos: int,
        there: LinkDirection[None],
        back: LinkDirection[None],
        *,
        datagram: DatagramSize = "mtu",
        repair: RepairTable | None = None,
        signed_peer: bool = False,
        limits: QueueLimits | None = None,
    ) -> None:
        self.now_nanos = now_nanos
        self.handed: list[Handed] = []
        self.sent_bytes = 0
        """Of the datagrams that the sender sent, headers included."""
        self.link_report: LinkReport | None = None
        """Newest report of the receiver about all topics."""
        self.there, self.back = there, back
        self.queue = SendQueue(
            RECEIVER, datagram, repair=repair, signed_peer=signed_peer, limits=limits
        )
        self.receiver = Inbox(receive_buffer=RECEIVE_BUFFER, on_credit=lambda *_: None)
        self._sender = Inbox(
            receive_buffer=RECEIVE_BUFFER,
            on_credit=self._credited,
            on_request=self._requested,
            on_report=self._reported,
        )
        self._look_nanos = now_nanos

    def advance(self, nanos: int) -> None:
        """Advance the time and process all events that are due."""
        end = self.now_nanos + nanos
        while True:
            while (sent := self.queue.take(self.now_nanos)) is not None:
                datagram = b"".join((sent.header, sent.part))
                self.sent_bytes += len(datagram)
                self.there.put(datagram, None, self.now_nanos)
            next_nanos = self._next_nanos()
            if next_nanos > end:
                self.now_nanos = end
                return
            self.now_nanos = next_nanos
            self._deliver()

    def report(self) -> None:
        """Let the receiver report what it has received, as it does once a second."""
        for answer, _ in self.receiver.reports(self.now_nanos, self.now_nanos):
            self.back.put(answer, None, self.now_nanos)

    def _next_nanos(self) -> int:
        wake = self.queue.next_wake(self.now_nanos)
        # A datagram that may not be sent now may not be sent later at the same instant either.
        wake = wake if wake is None else max(wake, self.now_nanos + 1)
        times = (self.there.next_due(), self.back.next_due(), wake, self._look_nanos)
        return min(time for time in times if time is not None)

    def _deliver(self) -> None:
        now = self.now_nanos
        while (arrived := self.there.take(now)) is not None:
            self._take(arrived[1])
        while (arrived := self.back.take(now)) is not None:
            message, _ = self._sender.receive(memoryview(arrived[1]), RECEIVER, now)
            if message is not None:
                report = parse_control(message.body)
                self.link_report = report if isinstance(report, LinkReport) else self.link_report
        if now >= self._look_nanos:
            self._look_nanos = now + _EXPIRY_NANOS
            self.receiver.reassembler.expire(now)
            self.receiver.update_logs()

    def _take(self, datagram: bytes) -> None:
        now = self.now_nanos
        message, credit = self.receiver.receive(memoryview(datagram), SENDER, now)
        answers = self.receiver.requests(now)
        for answer, _ in answers if credit is None else [credit, *answers]:
            self.back.put(answer, None, now)
        if message is not None:
            self.receiver.mark_published(message, SENDER, now)
            # The receiver may reuse a message's memory.
            self.handed.append(Handed(message._replace(body=bytes(message.body)), now))

    def _credited(self, _: Address, key: DatagramKey, receive_buffer: int) -> None:
        self.queue.flow.acknowledged(key, receive_buffer, self.now_nanos)

    def _requested(self, _: Address, header: Header, request: Request) -> None:
        self.queue.resender.requested(header, request, self.now_nanos)

    def _reported(self, _: Address, topic: str, report: TopicReport, nanos: int) -> None:
        self.queue.delivery.reported(topic, report, nanos)
