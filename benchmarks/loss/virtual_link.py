# SPDX-License-Identifier: Apache-2.0
"""Both ends of a bridge and the emulated link between them, in virtual time.

It uses the bridge's real sender and receiver and the project's link, but no socket, thread or
clock: results are reproducible, and minutes take seconds. Not simulated are the kernel's scheduling
and its buffer overflows.
"""

from typing import NamedTuple

from groundlink.emulation.model import LinkDirection
from groundlink.emulation.settings import Impairment
from udp_bridge import Message
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.sender.repair import Mode
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.header import Header
from udp_bridge.wire.message import Address, DatagramKey
from udp_bridge.wire.repair import Request

NANOS = 1_000_000_000
MSG_TYPE, TOPIC, LINK = 1, "/points", "lidar"
SENDER, RECEIVER = ("10.0.0.1", 7510), ("10.0.0.2", 7511)
RECEIVE_BUFFER = 8 << 20
_EXPIRY_NANOS = NANOS // 10
"""Period at which an idle receiver expires messages."""


class Handed(NamedTuple):
    """A delivered message, and when."""

    message: Message
    at_nanos: int


class VirtualLink:
    """A sender, a receiver and a link with the same impairment both ways.

    Parameters
    ----------
    mode
        Repair mode; None for no repair.
    """

    def __init__(
        self,
        impairment: Impairment,
        *,
        seed: int,
        datagram: DatagramSize = "mtu",
        mode: Mode | None = None,
    ) -> None:
        self.now_nanos = NANOS
        self.handed: list[Handed] = []
        self.sent_bytes = 0
        """Of the datagrams that the sender sent, headers included."""
        self.there: LinkDirection[None] = LinkDirection(impairment, seed=seed, direction="there")
        self.back: LinkDirection[None] = LinkDirection(impairment, seed=seed, direction="back")
        table = {} if mode is None else {(MSG_TYPE, TOPIC): mode}
        self.queue = SendQueue(RECEIVER, datagram, repair=table)
        self.receiver = Inbox(receive_buffer=RECEIVE_BUFFER, on_credit=lambda *_: None)
        self._sender = Inbox(
            receive_buffer=RECEIVE_BUFFER, on_credit=self._credited, on_request=self._requested
        )
        self._look_nanos = self.now_nanos

    def send(self, body: bytes) -> None:
        """Send a message stamped with the current time."""
        self.queue.put(Message(MSG_TYPE, TOPIC, LINK, self.now_nanos, 0, body))

    def impair(self, impairment: Impairment) -> None:
        """Change the impairment of both directions."""
        self.there.settings = self.back.settings = impairment

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
            self._sender.receive(memoryview(arrived[1]), RECEIVER, now)
        if now >= self._look_nanos:
            self._look_nanos = now + _EXPIRY_NANOS
            self.receiver.reassembler.expire(now)

    def _take(self, datagram: bytes) -> None:
        now = self.now_nanos
        message, credit = self.receiver.receive(memoryview(datagram), SENDER, now)
        answers = self.receiver.requests(now)
        for answer, _ in answers if credit is None else [credit, *answers]:
            self.back.put(answer, None, now)
        if message is not None:
            # The receiver may reuse a message's memory.
            self.handed.append(Handed(message._replace(body=bytes(message.body)), now))

    def _credited(self, _: Address, key: DatagramKey, receive_buffer: int) -> None:
        self.queue.flow.acknowledged(key, receive_buffer, self.now_nanos)

    def _requested(self, _: Address, header: Header, request: Request) -> None:
        self.queue.resender.requested(header, request, self.now_nanos)
