# SPDX-License-Identifier: Apache-2.0
"""Conversation of several senders and one receiver, with loss, restarts and forged datagrams.

Senders and receiver are the real ones (`SendQueue`, `Inbox`); time and the network are simulated.
Each method is one event. Invariants: the receiver keeps its limits, its requests can be parsed, and
a body of an honest sender is delivered unchanged and at most once. `sequences` and the stateful
test of `tests/udp_bridge` choose the events.
"""

from typing import NamedTuple

from udp_bridge import Limits, Message
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.sender.repair import Fec, Mode, Resend
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.wire.fec import is_available
from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header, parse
from udp_bridge.wire.message import Address
from udp_bridge.wire.repair import parse_resend
from udp_bridge.wire.types import RESEND

MS = NANOS // 1000
SENDERS = 3
HONEST = 0
"""Nothing is forged in the name of this sender."""
LIMITS = Limits(memory_bytes=1 << 18, senders=4, topics=8, offered_topics=4)
"""Small enough to be reached."""
RECEIVER: Address = ("192.0.2.9", 9)
START_NANOS = 1_000_000 * NANOS
LARGEST_BODY = 12_000
DATAGRAM = 256
LOST, TWICE, HELD = 1, 2, 3
"""What the network does with a datagram, in the lowest two bits; 0: it arrives."""
ANSWER_LOST = 4
"""Bit: the receiver's answer does not arrive."""
LONGEST_DELAY_NANOS = 500 * MS
"""Of the network; after 1 s of silence a low number is a restart."""
CLOCK_SHIFTS_NANOS = (0, -MS, -NANOS, -100 * NANOS, NANOS, 100 * NANOS)
_RESEND = Resend(500 * MS)
MODES: tuple[Mode, ...] = (_RESEND, _RESEND, Fec(0.5) if is_available() else _RESEND)


class Forgery(NamedTuple):
    """A forged datagram, described by small numbers near those of honest senders."""

    sender: int
    msg_type: int
    number: int
    """Relative to the newest number of the sender."""
    seconds: int
    """Relative to the sender's clock."""
    part_number: int
    parts_max: int
    topic: str
    body: bytes


class Sender:
    """One sender, across its restarts."""

    def __init__(self, index: int) -> None:
        self.address: Address = (f"192.0.2.{index + 1}", index + 1)
        self.clock_shift_nanos = 0
        self.count = 0
        """Messages since the beginning."""
        self.count_since_restart = 0
        self.bodies: dict[bytes, int] = {}
        """How often each body was delivered."""
        self.held: list[tuple[int, bytes]] = []
        """Delayed datagrams, and when they were sent."""
        self.mode = MODES[index]
        self.back: Inbox
        """Takes the receiver's answers since the last restart."""
        self.restart()

    def restart(self) -> None:
        """Restart from number 0; delayed datagrams are lost."""
        self.count_since_restart = 0
        self.held.clear()
        self.queue = SendQueue(RECEIVER, DATAGRAM, repair={(1, "/p"): self.mode})

    def make(self, size: int, stamp_nanos: int) -> Message:
        """Return a message with a unique body."""
        self.count += 1
        self.count_since_restart += 1
        body = (b"%s %d " % (self.address[0].encode(), self.count) * size)[:size]
        self.bodies[body] = 0
        return Message(1, "/p", "l", stamp_nanos, 0, body)


class Conversation:
    """A receiver and its senders; `AssertionError` if an invariant does not hold."""

    def __init__(self) -> None:
        self.now_nanos = 0
        self.senders = [Sender(index) for index in range(SENDERS)]
        self.inbox = Inbox(receive_buffer=1 << 16, on_credit=lambda *_: None, limits=LIMITS)
        for sender in self.senders:
            sender.back = self._back_inbox(sender)

    def send(self, index: int, size: int) -> None:
        """Queue a message of 1 to `LARGEST_BODY` bytes."""
        sender = self.senders[index]
        sender.queue.put(sender.make(32 + size % (LARGEST_BODY - 32), self._clock(sender)))

    def transfer(self, index: int, actions: list[int]) -> None:
        """Send datagrams, with one network action each; those held before arrive after them."""
        sender = self.senders[index]
        held, sender.held = sender.held, []
        for action in actions:
            datagram = sender.queue.take(self.now_nanos)
            if datagram is None:
                wake_nanos = sender.queue.next_wake(self.now_nanos)
                if wake_nanos is None:
                    break
                self.now_nanos = max(wake_nanos, self.now_nanos + MS // 10)
                continue
            data = datagram.header + bytes(datagram.part)
            self.now_nanos += MS // 100
            copies = {LOST: 0, HELD: 0, TWICE: 2}.get(action & 3, 1)
            for _ in range(copies):
                self._arrive(index, data, is_answered=not action & ANSWER_LOST)
            if action & 3 == HELD:
                sender.held.append((self.now_nanos, data))
        for sent_nanos, data in held:
            if self.now_nanos - sent_nanos < LONGEST_DELAY_NANOS:
                self._arrive(index, data)

    def restart(self, index: int, shift: int) -> None:
        """Restart a sender, with its clock shifted."""
        sender = self.senders[index]
        sender.clock_shift_nanos += CLOCK_SHIFTS_NANOS[shift % len(CLOCK_SHIFTS_NANOS)]
        sender.restart()
        sender.back = self._back_inbox(sender)

    def wait(self, ms: int) -> None:
        """Advance time while nothing arrives."""
        self.now_nanos += ms * MS
        self.inbox.reassembler.expire(self.now_nanos)

    def forge(self, forgery: Forgery) -> None:
        """Deliver a forged datagram in the name of a sender that is not `HONEST`."""
        index = forgery.sender % SENDERS
        if index == HONEST:
            return
        sender = self.senders[index]
        number = (sender.count_since_restart + forgery.number) % SEQ_NUMBERS
        seconds = self._clock(sender) // NANOS + forgery.seconds
        header = Header(
            forgery.msg_type,
            number,
            forgery.part_number % forgery.parts_max,
            forgery.parts_max,
            max(-(1 << 31), min(seconds, (1 << 31) - 1)),
            0,
            forgery.topic,
            "l",
        )
        self._arrive(index, header.pack() + forgery.body)

    def end(self) -> None:
        """Check that a new sender gets its message through, and that nothing stays held."""
        fresh = SendQueue(RECEIVER, DATAGRAM)
        fresh.put(Message(1, "/p", "", START_NANOS, 0, bytes(2000)))
        delivered = 0
        while (datagram := fresh.take(self.now_nanos)) is not None:
            data = memoryview(datagram.header + bytes(datagram.part))
            message, _ = self.inbox.receive(data, ("192.0.2.8", 8), self.now_nanos)
            delivered += message is not None
        assert delivered == 1
        self.inbox.reports(self.now_nanos, START_NANOS)
        self.inbox.reassembler.give_up_all()
        assert self.inbox.reassembler.memory_bytes == 0

    def _clock(self, sender: Sender) -> int:
        return START_NANOS + self.now_nanos + sender.clock_shift_nanos + sender.count

    def _back_inbox(self, sender: Sender) -> Inbox:
        """Return the inbox for the answers to a sender since its restart."""
        queue = sender.queue
        return Inbox(
            receive_buffer=1 << 16,
            on_credit=lambda _, key, size: queue.flow.acknowledged(key, size, self.now_nanos),
            on_request=lambda _, header, request: queue.resender.requested(
                header, request, self.now_nanos
            ),
        )

    def _arrive(self, index: int, data: bytes, *, is_answered: bool = True) -> None:
        sender = self.senders[index]
        message, credit = self.inbox.receive(memoryview(data), sender.address, self.now_nanos)
        if message is not None and index == HONEST and message.msg_type == 1:
            body = bytes(message.body)
            assert body in sender.bodies, "a body that nobody sent"
            sender.bodies[body] += 1
            assert sender.bodies[body] == 1, "a message was delivered twice"
        assert 0 <= self.inbox.reassembler.memory_bytes <= LIMITS.memory_bytes
        answers = self.inbox.requests(self.now_nanos)
        for answer, _ in answers:
            header, offset = parse(answer)
            assert header.msg_type == RESEND
            parse_resend(answer[offset:])
        for answer, to in [*answers, *([credit] if credit is not None else [])]:
            if is_answered:
                back = next(s.back for s in self.senders if s.address == to)
                back.receive(memoryview(answer), RECEIVER, self.now_nanos)
