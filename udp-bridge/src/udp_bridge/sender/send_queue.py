# SPDX-License-Identifier: Apache-2.0
"""What waits to be sent, and which datagram goes next. No socket, no thread, no clock.

Single-part messages (clock, commands, IMU) go before parts of large ones; of the large ones of
a topic only the newest waits, behind the one that is on its way. A message gets its number
when it leaves, so that what was superseded here leaves no gap there.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Tuple

from udp_bridge.wire.control import CreditRequest
from udp_bridge.wire.fragments import DatagramSize, Parts, Split, check_datagram_size, flat, plan
from udp_bridge.wire.header import PART_NUMBER_OFFSET, Buffer, Header, is_stamp, restamped
from udp_bridge.wire.known_headers import KnownHeaders
from udp_bridge.wire.message import Address, DatagramKey, Message
from udp_bridge.wire.numbering import Numbering
from udp_bridge.wire.types import CONTROL, REPAIR

from .accounts import Accounts
from .credit_window import Pacer, kernel_bytes
from .fec import symbols_of
from .outgoing import Datagram, Order, Run
from .pending import LargeWaiting, SmallWaiting, WaitingTable
from .repair import Fec, RepairTable, Resend
from .resend import Resender, Sent


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
        large_waiting: Optional[WaitingTable] = None,
    ) -> None:
        self.to = to
        self.pacer = Pacer()
        self.accounts = Accounts(signed_peer=signed_peer)
        self.superseded = 0
        """Messages dropped here because newer ones of their topic came."""
        self._datagram_size = check_datagram_size(datagram_size)
        self._signed_peer = signed_peer
        self._reserve = reserve  # bytes of each datagram for what is put around it
        self._repair = repair if repair is not None else {}
        self.resender = Resender()
        self._numbering = Numbering(signed_peer=signed_peer)
        self._small = SmallWaiting()
        self._large = LargeWaiting(large_waiting if large_waiting is not None else {})
        self._known = KnownHeaders()
        self._message: Optional[Message] = None  # the one on its way, with its number
        self._planned: Optional[Tuple[Message, Split]] = None  # the last one that was
        self._parts: Optional[Parts] = None  # its datagrams: of the body, then of its repair
        self._part: Optional[Tuple[bytes, memoryview]] = None  # its next datagram
        self._coded: Optional[Fec] = None  # how it is repaired, until that is computed
        self._leaving: Optional[Sent] = None  # its place in the history
        self._symbols: Deque[Tuple[bytes, memoryview]] = deque()  # of small messages

    def put(self, message: Message) -> None:
        """Queue a message; its seq_number is given later.

        Raises
        ------
        BadMessage
            When it can't be sent to this destination (`TooLarge`: at no datagram size).
        """
        if self._plan(message).parts_max == 1:
            oldest = self._small.put(message)
            pushed_out = [oldest] if oldest is not None else []
        else:
            pushed_out = self._large.put(message)
        for message in pushed_out:
            self.accounts.superseded(message)
            self.superseded += 1

    def express(
        self, msg_type: int, topic: str, link: str, stamp_nanos: int, body: Buffer
    ) -> Optional[Datagram]:
        """Return the datagram of a small message that meets nobody it would have to wait behind.

        It is `put` and `take` in one, with the header of the last message of its topic and only
        number and stamp anew. None means that the message has to take the long way, where it is
        also judged: it may be the first of its topic, have parts or repair, or be wrong.
        """
        known = self._known.small.get((msg_type, topic, link))
        if known is None or self._small or self._symbols:
            return None
        packed, largest = known
        view = flat(body)
        size = view.nbytes
        if size > largest or not is_stamp(stamp_nanos):
            return None
        number = self.accounts.numbered((msg_type, topic), stamp_nanos, size)
        return Datagram(restamped(packed, number, stamp_nanos), view, self.to, True)

    def express_run(
        self,
        msg_type: int,
        topic: str,
        link: str,
        stamp_nanos: int,
        body: Buffer,
        now_nanos: int,
        most_bytes: int,
    ) -> Optional[Datagram]:
        """Return the first parts of a message that is cut like the last one of its topic.

        It is `put` and `take` in one, as `express` is for small ones, for a caller who knows that
        nothing waits; None means the long way. What remains of the message is for `take`.
        """
        alike = self._known.large.get((msg_type, topic, link))
        if alike is None or not is_stamp(stamp_nanos):
            return None
        view, cut = flat(body), alike.cut
        size = len(alike.packed) + cut.part_size
        if view.nbytes != alike.body_size or self.resender.is_offer_due(now_nanos):
            return None
        most = min(most_bytes // size, cut.parts_max)
        count = self.pacer.granted(size, most, now_nanos) if most else 0
        if not count:
            return None
        number = self.accounts.numbered((msg_type, topic), stamp_nanos, view.nbytes)
        message = self._message = Message(msg_type, topic, link, stamp_nanos, number, body)
        packed, limit_nanos = restamped(alike.packed, number, stamp_nanos), alike.limit_nanos
        self._leaving = None
        if limit_nanos is not None:
            self._leaving = self.resender.leaves(message, cut, packed, limit_nanos, now_nanos)
        self._parts = Parts(packed, view, cut)
        return self._with_offer(self._leave(self._parts, 0, count, now_nanos), now_nanos)

    def take(self, now_nanos: int, most_bytes: int = 0) -> Optional[Datagram]:
        """Return the datagram to send now, if one may go.

        Others of its message may go with it, up to `most_bytes` together.
        """
        if self._symbols:
            return Datagram(*self._symbols.popleft(), self.to, is_last=False)
        if self._small:
            return self._take_small(now_nanos)
        again = self.resender.next_again(now_nanos)
        # It goes behind what was asked for, so that who gets it knows whether that was lost.
        offer = self.resender.next_offer(now_nanos) if again is None else None
        if offer is not None:
            return Datagram(offer, memoryview(b""), self.to, is_last=False)
        part = again.datagram() if again is not None else self._next_part(now_nanos)
        if part is None:
            return None
        if self.pacer.must_ask(_size(part), now_nanos):
            return self._ask(now_nanos)
        if again is None:
            return self._take_large(part, now_nanos, most_bytes)
        if not self._may_send(again.sent.message, part, now_nanos):
            return None
        self.resender.sent_again()
        return Datagram(*part, self.to, is_last=False)

    def mends(self, msg_type: int, topic: str) -> None:
        """Take the long way with a topic from now on: the table has a mode of repair for it."""
        self._known.forget(msg_type, topic)

    def order(self) -> Optional[Order]:
        """Return what remains of the current message, if it lacks but room in the window."""
        parts, message, window = self._parts, self._message, self.pacer.window
        if parts is None or message is None or self._part is None or parts.packed[0] == REPAIR:
            return None
        size, upcoming = _size(self._part), self._part[0][PART_NUMBER_OFFSET]
        if (
            parts.upcoming != upcoming + 1
            or not self.pacer.waits_for_credit
            or window.fits(size)
            or not self.resender.is_idle
        ):
            return None
        flights = window.flights(message.msg_type, message.topic)
        if flights is None:
            return None
        cost = kernel_bytes(len(parts.packed) + parts.cut.part_size)
        if flights[-1][0] != message.seq_number:
            flights.append((message.seq_number, upcoming, 0, cost, cost))
        end, (in_flight, most) = parts.cut.parts_max, (window.in_flight_bytes, window.window_bytes)
        return Order(parts, self.to, upcoming, end, cost, in_flight, most, flights)

    def ordered(self, count: int, now_nanos: int) -> Datagram:
        """Take note that so many parts of the last order went."""
        assert self._parts is not None
        assert self._part is not None
        return self._leave(self._parts, self._part[0][PART_NUMBER_OFFSET], count, now_nanos)

    @property
    def large_topic(self) -> Tuple[int, str]:
        """msg_type and topic of the large message that began to leave last."""
        assert self._message is not None
        return self._message.msg_type, self._message.topic

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
        offer_nanos = self.resender.next_offer_nanos if again is None else None
        if part is None:
            return offer_nanos
        part_nanos = self.pacer.next_wake(_size(part), now_nanos)
        return part_nanos if offer_nanos is None else min(part_nanos, offer_nanos)

    def _take_small(self, now_nanos: int) -> Datagram:
        message = self._small.pop()
        message, sent, parts, coded = self._fragments(message, now_nanos)
        header, part = next(parts)
        if coded is not None:
            self._symbols.extend(symbols_of(message, parts.cut, coded))
        self._has_sent_part(sent, now_nanos)
        return Datagram(header, part, self.to, is_last=True)

    def _ask(self, now_nanos: int) -> Datagram:
        """Return the datagram that asks the peer for a Credit."""
        number = self._numbering.next(CONTROL, "")
        header = Header(CONTROL, number, 0, 1, 0, 0).pack(signed_peer=self._signed_peer)
        body = memoryview(CreditRequest().pack())
        key = DatagramKey(CONTROL, "", number, 0)
        self.pacer.asked(key, _size((header, body)), now_nanos)
        return Datagram(header, body, self.to, is_last=False)

    def _take_large(
        self, part: Tuple[bytes, memoryview], now_nanos: int, most_bytes: int
    ) -> Optional[Datagram]:
        assert self._message is not None
        assert self._parts is not None
        parts, first = self._parts, part[0][PART_NUMBER_OFFSET]
        most = min(most_bytes // _size(part), parts.parts_left + 1)
        if most:
            count = self.pacer.granted(_size(part), most, now_nanos)
            if not count:
                return None
            return self._with_offer(self._leave(parts, first, count, now_nanos), now_nanos)
        if not self._may_send(self._message, part, now_nanos):
            return None
        self._has_sent_part(self._leaving, now_nanos)
        return Datagram(*part, self.to, is_last=not self._goes_on(parts))

    def _leave(self, parts: Parts, first: int, count: int, now_nanos: int) -> Datagram:
        """Return that many parts of the current message, from `first` on, which go now."""
        assert self._message is not None
        message, cut = self._message, parts.cut
        end = first + count
        size = len(parts.packed) + cut.part_size
        last_size = size - max(0, end * cut.part_size - parts.body.nbytes)
        key = DatagramKey(parts.packed[0], message.topic, message.seq_number, first)
        self.pacer.sent_run(key, count, size, last_size, now_nanos)
        for _ in range(count if self._leaving is not None else 0):
            self._has_sent_part(self._leaving, now_nanos)
        parts.upcoming = end
        is_last = not self._goes_on(parts)
        run = Run(parts, first, count, (count - 1) * size + last_size)
        return Datagram(parts.packed, parts.body, self.to, is_last, run)

    def _goes_on(self, parts: Parts) -> bool:
        """Take the next datagram of the current message; return whether there is one."""
        assert self._message is not None
        if not parts.parts_left and self._coded is not None:
            parts = self._parts = symbols_of(self._message, parts.cut, self._coded)
            self._coded = None
        self._part = next(parts, None)
        return self._part is not None

    def _with_offer(self, datagram: Datagram, now_nanos: int) -> Datagram:
        """Let the offer of a message go right behind its last parts."""
        if self._leaving is None or not datagram.is_last:
            return datagram
        assert datagram.run is not None
        run = datagram.run._replace(behind=self.resender.next_offer(now_nanos))
        return datagram._replace(run=run)

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
            message = self._large.pop()
            self._message, self._leaving, parts, self._coded = self._fragments(message, now_nanos)
            self._parts, self._part = parts, next(parts)
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
    ) -> Tuple[Message, Optional[Sent], Parts, Optional[Fec]]:
        """Give a message its number; return it, its place in the history, its parts, its code."""
        cut = self._plan(message)
        self._planned = None  # it would keep the body
        body = flat(message.body)
        key = (message.msg_type, message.topic)
        number = self.accounts.numbered(key, message.stamp_nanos, body.nbytes)
        message = message._replace(seq_number=number)
        header = message.header(parts_max=cut.parts_max)
        packed = header.pack(signed_peer=self._signed_peer)
        parts = Parts(packed, body, cut)
        mode = self._repair.get(key)
        if isinstance(mode, Fec):
            return message, None, parts, mode
        sent, limit_nanos = None, None
        if isinstance(mode, Resend):
            limit_nanos = mode.limit_nanos
            sent = self.resender.leaves(message, cut, packed, limit_nanos, now_nanos)
        if sent is None or cut.parts_max > 1:
            self._known.remember(message, packed, body.nbytes, cut, limit_nanos)
        return message, sent, parts, None


def _size(part: Tuple[bytes, memoryview]) -> int:
    return len(part[0]) + part[1].nbytes
