# SPDX-License-Identifier: Apache-2.0
"""Datagrams in, whole messages out: the receiving rules of PROTOCOL.md.

Whatever arrives, nothing is raised: a bad datagram is counted by reason and changes nothing
else. Time is an argument, a sender is anything hashable, and no reference to a datagram's
buffer is kept. Not here: bounds (`holdings`), what becomes of a whole message (`verdicts`),
sockets, credits, and who may send at all.
"""

from __future__ import annotations

from typing import Hashable, List, Optional, Tuple

from udp_bridge.wire import control, fec
from udp_bridge.wire.header import Buffer, Header, Refused, parse
from udp_bridge.wire.message import Message
from udp_bridge.wire.repair import Offer, parse_resend, parse_symbol
from udp_bridge.wire.reports import TopicReport
from udp_bridge.wire.types import CONTROL, REPAIR, RESEND, SUBSCRIBE

from . import fec as fec_parts
from .arrivals import TopicArrivals
from .assembly import Assembly
from .counters import Counters
from .limits import Holdings, Limits, Topic
from .nack import Asked, Asking
from .ordering import key_of
from .pool import Pool
from .verdicts import Verdicts, message_of

_NOT_HANDED_OVER = (control.CreditRequest, control.AddressChallenge, control.AddressResponse)


class Reassembler:
    """Joins datagrams of any number of senders into messages.

    Call `receive` for every datagram, and `expire` now and then while none comes.
    """

    def __init__(self, limits: Optional[Limits] = None) -> None:
        self.limits = limits if limits is not None else Limits()
        self.counters = Counters()
        self.pool = Pool()
        """Where bodies lie."""
        self._holdings = Holdings(self.limits, self.counters)
        self._verdicts = Verdicts(self._holdings, self.counters, keep_late=self.limits.keep_late)
        self.to_ask: List[Tuple[Hashable, str, Asked]] = []
        """What `asked` returns next."""

    @property
    def memory_bytes(self) -> int:
        """What all open messages take."""
        return self._holdings.memory_bytes

    def receive(self, datagram: Buffer, sender: Hashable, now_nanos: int) -> Optional[Message]:
        """Take one datagram; return the message that it completed, if any.

        Parameters
        ----------
        datagram
            The bytes as they came; the buffer may be reused once this returns.
        sender
            The sender's address.
        now_nanos
            Any clock that never goes back, in nanoseconds.
        """
        try:
            header, offset = parse(datagram)
            return self.accept(header, memoryview(datagram)[offset:], sender, now_nanos)
        except Refused as refused:
            self.counters.refuse(refused.reason)
            return None

    def accept(
        self, header: Header, part: memoryview, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Do as `receive` does with a datagram that is parsed already.

        Raises
        ------
        Refused
            When the part contradicts its message; the caller counts it.
        """
        if self._holdings.memory_bytes:  # otherwise nothing is open
            self.expire(now_nanos)
        if header.parts_max > 1 and not len(part):
            raise Refused("part_size")
        if header.msg_type == CONTROL:
            self.accept_control(header, part)
            return message_of(header, part)
        if header.msg_type == RESEND:
            return self._accept_resend(header, part, sender, now_nanos)
        if header.msg_type == REPAIR:
            return self._accept_symbol(header, part, sender, now_nanos)
        if header.msg_type == SUBSCRIBE:
            if header.parts_max != 1:
                raise Refused("parts_max")
            control.Subscribe.parse(part)
        if self._holdings.memory_bytes:  # it may contradict what is open
            self._check(header, len(part), sender, now_nanos)
        topic = self._holdings.topic(sender, (header.msg_type, header.topic))
        is_plain = header.parts_max == 1 and topic.asking is None and not topic.open
        if is_plain and topic.order.takes_next(header, now_nanos):
            topic.link = header.link
            return self._verdicts.handed(topic, header, part)
        self._verdicts.notice_restart(topic, header, now_nanos)
        if topic.order.is_finished(header):
            topic.count("duplicates")
            return None
        is_open = key_of(header) in topic.open
        if not is_open and self._verdicts.is_jump(topic, header, now_nanos):
            return None
        topic.link = header.link
        topic.arrived.seen(header)
        if header.parts_max == 1 and not is_open:
            message = self._verdicts.finish(topic, header, part, now_nanos)
        else:
            message = self._add(topic, header, part, now_nanos)
        if topic.asking is not None:
            is_whole = topic.order.is_finished(header)
            topic.asking.saw(header, is_whole=is_whole, now_nanos=now_nanos)
            self._ask(topic.asking, header, header.msg_type, sender, now_nanos)
        return message

    # Control says what is so at this moment and repeats itself; credits carry old stamps and
    # reports a wall clock, so order has no meaning there, and a dropped one would only harm.
    def accept_control(self, header: Header, part: memoryview) -> control.Control:
        """Return what a Control message says, or raise `Refused`."""
        if header.parts_max != 1:
            raise Refused("parts_max" if len(part) else "part_size")
        told = control.parse(part)
        self.counters.messages += not isinstance(told, _NOT_HANDED_OVER)
        return told

    def asked(self) -> List[Tuple[Hashable, str, Asked]]:
        """Return what is to be asked since the last call: of which sender, the topic, the rest."""
        asked, self.to_ask = self.to_ask, []
        return asked

    def expire(self, now_nanos: int) -> None:
        """Give up the messages whose time is over."""
        self._holdings.give_up_since(now_nanos - self.limits.time_limit_nanos)

    def give_up_all(self) -> None:
        """Count every open message as incomplete, as at the end of a recording."""
        self._holdings.give_up_since()

    def close(self) -> None:
        """Forget all senders and the buffers; what is open counts as incomplete."""
        self._holdings.forget_all()
        self.pool = Pool(0)

    def take_note(self) -> None:
        """Count what was handed over last, which the next message or report would do, too."""
        self._verdicts.take_note()

    def reports(self, sender: Hashable, wall_nanos: int) -> List[Tuple[str, str, TopicReport]]:
        """Return topic, the link last seen and the report of each topic of a sender."""
        self.take_note()
        return [
            (name, topic.link, topic.report(msg_type, wall_nanos))
            for (msg_type, name), topic in self._holdings.topics(sender)
        ]

    def arrived(self, sender: Hashable, msg_type: int, topic: str) -> Optional[TopicArrivals]:
        """Return what arrived of a topic of a sender, if it is still known."""
        found = self._holdings.find(sender, (msg_type, topic))
        return found.arrived if found is not None else None

    def _check(self, header: Header, size: int, sender: Hashable, now_nanos: int) -> None:
        """Refuse a part that contradicts its message, or that begins one too many."""
        assembly = self._open(header, sender, now_nanos)
        if assembly is not None:
            assembly.check(header, size)
        elif header.parts_max > 1 and not self._holdings.may_begin(sender, now_nanos):
            raise Refused("busy")

    def _open(self, header: Header, sender: Hashable, now_nanos: int) -> Optional[Assembly]:
        """Return what has come of the message in a header, if anything has."""
        topic = self._holdings.find(sender, (header.msg_type, header.topic))
        if topic is None or topic.order.is_restart_by_silence(header, now_nanos):
            return None
        return topic.open.get(key_of(header))

    def _accept_resend(
        self, header: Header, part: memoryview, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Take an offer; a request is handed over, for it is the sending side's."""
        if header.parts_max != 1:
            raise Refused("parts_max")
        body = parse_resend(part)
        if not isinstance(body, Offer):
            return message_of(header, part)
        topic = self._holdings.topic(sender, (body.msg_type, header.topic))
        asking = self._holdings.ask(topic)
        if asking is not None:
            self._verdicts.notice_new_life(topic, asking, header, now_nanos)
            is_finished = topic.order.is_finished(header)
            named = header._replace(parts_max=body.parts_max)
            if not is_finished and self._verdicts.is_jump(topic, named, now_nanos, is_offer=True):
                return None
            asking.offered(header, body, is_finished=is_finished, now_nanos=now_nanos)
            self._ask(asking, header, body.msg_type, sender, now_nanos)
        return None

    def _accept_symbol(
        self, header: Header, part: memoryview, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Keep a repair symbol with its message, and mend that if it can be."""
        symbol, data = parse_symbol(part)
        if symbol.code != fec.RAPTORQ or not fec.is_available():
            raise Refused("repair_code")
        source = header._replace(
            msg_type=symbol.msg_type, part_number=0, parts_max=symbol.parts_max
        )
        known = self._open(source, sender, now_nanos)
        if known is not None:
            if source.link != known.header.link:
                raise Refused("link")
            fec_parts.check(known, symbol, data)
        elif not self._holdings.may_begin(sender, now_nanos):
            raise Refused("busy")
        topic = self._holdings.topic(sender, (source.msg_type, source.topic))
        self._verdicts.notice_restart(topic, source, now_nanos)
        if topic.order.is_finished(source) or self._verdicts.is_jump(topic, source, now_nanos):
            return None
        key = key_of(source)
        assembly = topic.open.get(key) or Assembly(source, now_nanos, self.pool)
        if not fec_parts.add(assembly, header.part_number, symbol, data):
            topic.count("duplicates")
            return None
        topic.link = source.link
        topic.arrived.seen(source)
        return self._mended(topic, assembly, source, now_nanos)

    def _mended(
        self, topic: Topic, assembly: Assembly, header: Header, now_nanos: int
    ) -> Optional[Message]:
        """Hold an unfinished message, or hand it over if its repair symbols make it whole."""
        key = key_of(header)
        if not fec_parts.mend(assembly):
            self._holdings.hold(topic, key, assembly)
            return None
        self._holdings.release(topic, key)
        topic.arrived.fates.mended(header.seq_number)
        message = self._verdicts.finish(topic, header, assembly.body, now_nanos)
        if message is not None:
            topic.count("repaired")
        return message

    def _ask(
        self, asking: Asking, header: Header, msg_type: int, sender: Hashable, now_nanos: int
    ) -> None:
        for asked in asking.due(msg_type, now_nanos):
            self.to_ask.append((sender, header.topic, asked))

    def _add(
        self, topic: Topic, header: Header, part: memoryview, now_nanos: int
    ) -> Optional[Message]:
        """Add a part to its message, which may be a new one."""
        key = key_of(header)
        assembly = topic.open.get(key) or Assembly(header, now_nanos, self.pool)
        added = assembly.add(header, part)
        if added.refused:
            self.counters.refuse(added.refused)
        if added.is_duplicate:
            topic.count("duplicates")
            return None
        if not assembly.complete:
            return self._mended(topic, assembly, header, now_nanos)
        self._holdings.release(topic, key)
        return self._verdicts.finish(topic, header, assembly.body, now_nanos)
