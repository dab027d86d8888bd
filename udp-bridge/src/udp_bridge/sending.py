# SPDX-License-Identifier: Apache-2.0
"""What waits to be sent, and which datagram goes next. No socket, no thread, no clock.

Single-part messages (clock, commands, IMU) go before parts of large ones; of the large ones of
a topic only the newest waits, behind the one that is on its way. A message gets its number
when it leaves, so that what was superseded here leaves no gap there.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from itertools import chain
from typing import Deque, Dict, Iterator, List, NamedTuple, Optional, Tuple

from .accounts import Accounts
from .fec_sending import symbols_of
from .flow import DatagramKey, Pacer
from .fragments import DatagramSize, Parts, Split, check_datagram_size, flat, parts_of, plan
from .header import PART_NUMBER_OFFSET, SEQ_NUMBERS, SIGNED_SEQ_NUMBERS
from .message import Message
from .repair import Fec, RepairTable, Resend
from .resend import Resender, Sent

SMALL_WAITING_PER_TOPIC = 512
"""Single-part messages of a topic that wait; more than a second of a 400 Hz topic."""
NUMBERED_TOPICS = 4096
"""Topics whose numbers are remembered; one that is forgotten begins at 0 like a restart."""

Address = Tuple[str, int]
_TopicKey = Tuple[int, str]
_LargeKey = Tuple[int, str, str]


class Run(NamedTuple):
    """Consecutive parts of one message that may go at once."""

    parts: Parts
    first: int
    """Number of the first part."""
    parts_count: int

    @property
    def size(self) -> int:
        """Bytes of all datagrams."""
        end = (self.first + self.parts_count) * self.parts.cut.part_size
        body_size = min(end, self.parts.body.nbytes) - self.first * self.parts.cut.part_size
        return body_size + self.parts_count * len(self.parts.packed)


class Datagram(NamedTuple):
    """What is to be sent next: `sendmsg([header, part], [], 0, to)`."""

    header: bytes
    part: memoryview
    to: Address
    is_last: bool
    """Whether its message is sent with it."""
    run: Optional[Run] = None
    """It and those that are to go with it."""


class Numbering:
    """Gives each message the next seq_number of its type and topic."""

    def __init__(self, *, signed_peer: bool = False) -> None:
        self._modulus = SIGNED_SEQ_NUMBERS if signed_peer else SEQ_NUMBERS
        self._next: OrderedDict[_TopicKey, int] = OrderedDict()

    def next(self, msg_type: int, topic: str) -> int:
        """Return the number of the next message, counted from 0."""
        key = (msg_type, topic)
        number = self._next.pop(key, 0)
        self._next[key] = (number + 1) % self._modulus
        if len(self._next) > NUMBERED_TOPICS:
            self._next.popitem(last=False)
        return number


class Outbox:
    """All that waits for one destination."""

    def __init__(
        self,
        to: Address,
        datagram_size: DatagramSize,
        *,
        signed_peer: bool = False,
        repair: Optional[RepairTable] = None,
        reserve: int = 0,
        large_waiting: int = 0,
    ) -> None:
        self.to = to
        self.pacer = Pacer()
        self.accounts = Accounts()
        self.superseded = 0
        """Messages dropped here because newer ones of their topic came."""
        self._datagram_size = check_datagram_size(datagram_size)
        self._signed_peer = signed_peer
        self._large_waiting = large_waiting  # body bytes of a topic; the newest waits anyhow
        self._reserve = reserve  # bytes of each datagram for what is put around it
        self._repair = repair if repair is not None else {}
        self.resender = Resender()
        self._numbering = Numbering(signed_peer=signed_peer)
        self._small: OrderedDict[int, Message] = OrderedDict()  # by order of arrival
        self._small_of: Dict[_TopicKey, Deque[int]] = {}
        self._arrivals = 0
        self._large: OrderedDict[_LargeKey, Deque[Message]] = OrderedDict()
        self._current: Optional[Iterator[Tuple[bytes, memoryview]]] = None
        self._message: Optional[Message] = None  # the one on its way, with its number
        self._planned: Optional[Tuple[Message, Split]] = None  # the last one that was
        self._parts: Optional[Parts] = None  # it whole, as long as it may go in runs
        self._part: Optional[Tuple[bytes, memoryview]] = None  # its next datagram
        self._leaving: Optional[Sent] = None  # its place in the history
        self._symbols: Deque[Tuple[bytes, memoryview]] = deque()  # of small messages

    def put(self, message: Message) -> None:
        """Queue a message; its seq_number is given later.

        Raises
        ------
        BadMessage
            When it can't be sent to this destination (`TooLarge`: at no datagram size).
        """
        cut = self._plan(message)
        if cut.parts_max == 1:
            self._put_small(message)
        else:
            key = (message.msg_type, message.topic, message.link)
            waiting = self._large.setdefault(key, deque())
            waiting.append(message)
            while len(waiting) > 1 and _body_bytes(waiting) > self._large_waiting:
                self.accounts.superseded(waiting.popleft())
                self.superseded += 1

    def take(self, now_nanos: int, most_bytes: int = 0) -> Optional[Datagram]:
        """Return the datagram to send now, if one may go.

        Others of its message may go with it, up to `most_bytes` together.
        """
        if self._symbols:
            return Datagram(*self._symbols.popleft(), self.to, is_last=False)
        if self._small:
            return self._take_small(now_nanos)
        offer = self.resender.next_offer(now_nanos)
        if offer is not None:
            return Datagram(offer, memoryview(b""), self.to, is_last=False)
        again = self.resender.next_again(now_nanos)
        if again is not None:
            part = again.datagram()
            if not self._may_send(again.sent.message, part, now_nanos):
                return None
            self.resender.sent_again()
            return Datagram(*part, self.to, is_last=False)
        return self._take_large(now_nanos, most_bytes)

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits but offers, which are repeated for some time."""
        waiting = self._small or self._large or self._part or self._symbols
        return not waiting and self.resender.is_idle

    def next_wake(self, now_nanos: int) -> Optional[int]:
        """Return when to call `take` again if nothing happens; None when nothing waits."""
        if self._small or self._symbols:
            return now_nanos
        again = self.resender.next_again(now_nanos)
        part = again.datagram() if again is not None else self._next_part(now_nanos)
        offer_nanos = self.resender.next_offer_nanos
        if part is None:
            return offer_nanos
        part_nanos = self.pacer.next_wake(_size(part), now_nanos)
        return part_nanos if offer_nanos is None else min(part_nanos, offer_nanos)

    def _put_small(self, message: Message) -> None:
        waiting = self._small_of.setdefault((message.msg_type, message.topic), deque())
        if len(waiting) >= SMALL_WAITING_PER_TOPIC:
            self.accounts.superseded(self._small.pop(waiting.popleft()))
            self.superseded += 1
        self._arrivals += 1
        waiting.append(self._arrivals)
        self._small[self._arrivals] = message

    def _take_small(self, now_nanos: int) -> Datagram:
        _, message = self._small.popitem(last=False)
        key = (message.msg_type, message.topic)
        self._small_of[key].popleft()
        if not self._small_of[key]:
            del self._small_of[key]
        _, sent, current = self._fragments(message, now_nanos)
        header, part = next(current)
        self._symbols.extend(current)
        self._has_sent_part(sent, now_nanos)
        return Datagram(header, part, self.to, is_last=True)

    def _take_large(self, now_nanos: int, most_bytes: int) -> Optional[Datagram]:
        part = self._next_part(now_nanos)
        if part is None:
            return None
        assert self._message is not None
        assert self._current is not None
        parts = self._parts
        number = part[0][PART_NUMBER_OFFSET]
        if most_bytes > _size(part) and parts is not None and parts.upcoming == number + 1:
            return self._take_run(parts, number, most_bytes // _size(part), now_nanos)
        if not self._may_send(self._message, part, now_nanos):
            return None
        self._has_sent_part(self._leaving, now_nanos)
        self._part = next(self._current, None)
        return Datagram(*part, self.to, is_last=self._part is None)

    def _take_run(self, parts: Parts, first: int, most: int, now_nanos: int) -> Optional[Datagram]:
        """Return as many parts from `first` on as may go now."""
        assert self._message is not None
        assert self._current is not None
        assert self._part is not None
        most = min(most, parts.cut.parts_max - first)
        datagram, size = self._part, _size(self._part)
        count = self.pacer.granted(size, most, now_nanos)
        if not count:
            return None
        run = Run(parts, first, count)
        last_size = run.size - (count - 1) * size
        key = DatagramKey(
            self._message.msg_type, self._message.topic, self._message.seq_number, first
        )
        self.pacer.sent_run(key, count, size, last_size, now_nanos)
        for _ in range(count if self._leaving is not None else 0):
            self._has_sent_part(self._leaving, now_nanos)
        parts.upcoming = first + count
        if parts.upcoming == parts.cut.parts_max:
            self._parts = None
        self._part = next(self._current, None)
        return Datagram(*datagram, self.to, is_last=self._part is None, run=run)

    def _may_send(self, message: Message, part: Tuple[bytes, memoryview], now_nanos: int) -> bool:
        """Tell whether a datagram of a message may go now, and take note that it does."""
        if not self.pacer.may_send(_size(part), now_nanos):
            return False
        header = part[0]
        number = header[PART_NUMBER_OFFSET]
        key = DatagramKey(header[0], message.topic, message.seq_number, number)
        self.pacer.sent(key, _size(part), now_nanos)
        return True

    def _has_sent_part(self, sent: Optional[Sent], now_nanos: int) -> None:
        if sent is not None:
            sent.parts_sent += 1
            if sent.parts_sent == sent.cut.parts_max:
                self.resender.is_out(sent, now_nanos)

    def _next_part(self, now_nanos: int) -> Optional[Tuple[bytes, memoryview]]:
        if self._part is None and self._large:
            key, waiting = self._large.popitem(last=False)
            message = waiting.popleft()
            if waiting:
                self._large[key] = waiting  # behind other topics
            self._message, self._leaving, self._current = self._fragments(message, now_nanos)
            is_plain = isinstance(self._current, Parts)
            self._parts = self._current if is_plain else None  # type: ignore[assignment]
            self._part = next(self._current)
        return self._part

    def _plan(self, message: Message) -> Split:
        if self._planned is not None and self._planned[0] is message:
            return self._planned[1]
        is_coded = isinstance(self._repair.get((message.msg_type, message.topic)), Fec)
        cut = plan(
            message,
            self._datagram_size,
            signed_peer=self._signed_peer,
            coded=is_coded,
            reserve=self._reserve,
        )
        self._planned = message, cut
        return cut

    def _fragments(
        self, message: Message, now_nanos: int
    ) -> Tuple[Message, Optional[Sent], Iterator[Tuple[bytes, memoryview]]]:
        """Give a message its number; return it, its place in the history, and its datagrams."""
        cut = self._plan(message)
        self._planned = None  # it would keep the body
        number = self._numbering.next(message.msg_type, message.topic)
        self.accounts.numbered(message)
        message = message._replace(seq_number=number)
        header = message.header(parts_max=cut.parts_max)
        packed = header.pack(signed_peer=self._signed_peer)
        parts = parts_of(packed, flat(message.body), cut)
        mode = self._repair.get((message.msg_type, message.topic))
        if isinstance(mode, Fec):
            return message, None, chain(parts, symbols_of(message, cut, mode))
        sent = None
        if isinstance(mode, Resend):
            sent = self.resender.leaves(message, cut, packed, mode.limit_nanos, now_nanos)
        return message, sent, parts


def take_in_turn(outboxes: List[Outbox], now_nanos: int, most_bytes: int = 0) -> Optional[Datagram]:
    """Return what `Outbox.take` returns, of any of them; whose turn it was goes to the end."""
    for index, outbox in enumerate(outboxes):
        datagram = outbox.take(now_nanos, most_bytes)
        if datagram is not None:
            outboxes.append(outboxes.pop(index))
            return datagram
    return None


def _body_bytes(messages: Deque[Message]) -> int:
    return sum(memoryview(message.body).nbytes for message in messages)


def _size(part: Tuple[bytes, memoryview]) -> int:
    return len(part[0]) + part[1].nbytes
