# SPDX-License-Identifier: Apache-2.0
"""Both ends of a bridge and the emulated link between them, in virtual time.

Rule: the bridge's own sending and receiving rules and the project's own link, but no socket, no
thread and no clock: a run is the same each time, and minutes of it take seconds. What is left out
is what only kernels do: they schedule, and their buffers overflow.
"""

from __future__ import annotations

from typing import NamedTuple

from groundlink.emulation import Impairment, LinkDirection
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
"""How often a receiver looks at its clock when nothing comes."""


class Handed(NamedTuple):
    """A message that was handed over, and when."""

    message: Message
    at_nanos: int


class VirtualLink:
    """A sender, a receiver and a link with the same impairment both ways.

    Parameters
    ----------
    mode
        How lost datagrams are made good; None for not at all.
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
        """Send a message that is measured now."""
        self.queue.put(Message(MSG_TYPE, TOPIC, LINK, self.now_nanos, 0, body))

    def impair(self, impairment: Impairment) -> None:
        """Let the link be another one from now on, both ways."""
        self.there.settings = self.back.settings = impairment

    def advance(self, nanos: int) -> None:
        """Let time pass, and everything happen that is due in it."""
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
        # What may not go at a moment may not go at the same moment a second time.
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
            # The receiver may use a message's memory again; what it said at this moment counts.
            self.handed.append(Handed(message._replace(body=bytes(message.body)), now))

    def _credited(self, _: Address, key: DatagramKey, receive_buffer: int) -> None:
        self.queue.flow.acknowledged(key, receive_buffer, self.now_nanos)

    def _requested(self, _: Address, header: Header, request: Request) -> None:
        self.queue.resender.requested(header, request, self.now_nanos)
