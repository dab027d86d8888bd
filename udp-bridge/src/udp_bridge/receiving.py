# SPDX-License-Identifier: Apache-2.0
"""What a link does with a datagram that came in: messages out, credits taken, answers written.

No socket, no thread, no clock: answers are returned as bytes to send. Credits go back for
multi-part messages without being asked for; reports only where they are wanted.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Callable, Deque, List, Optional, Tuple, Union, cast

from . import control
from .arrivals import Key, key_of
from .control import Credit, LinkReport, TopicReport
from .flow import DatagramKey
from .header import NANOS, Header, Refused, parse
from .holdings import Limits
from .message import Message
from .placing import Guess, Run, Slots, place_of, strays
from .reassembly import Reassembler
from .repair_wire import Request, parse_resend
from .sending import Address, Numbering
from .types import CONTROL, REPAIR, RESEND

CREDIT_SHARE = 8
"""A credit goes out at the latest when one part in this many of the receive buffer was taken."""
HEARD_NANOS = 5 * NANOS
"""A sender is reported to for this long after its last datagram."""

GOODPUT_GRAIN_NANOS = NANOS // 10
"""Of the measure of what comes within a second."""

Answer = Tuple[bytes, Address]
Taken = Tuple[Optional[Message], Optional[Answer], Address]
OnCredit = Callable[[Address, DatagramKey, int], None]
_Told = Tuple[Address, int, str, Key, Optional[int]]
OnRequest = Callable[[Address, Header, Request], None]
OnReport = Callable[[Address, str, TopicReport, int], None]


class _Peer:
    """What is known of one sender."""

    def __init__(self, now_nanos: int) -> None:
        self.numbering = Numbering()
        self.uncredited_bytes = 0
        self.heard_nanos = now_nanos
        self.goodput_bytes = 0
        """All that came from it."""
        self._marks = deque([(now_nanos, 0)])  # when, and what came until then

    def goodput(self, now_nanos: int) -> int:
        """Return the bytes that came within the last second, or in one on the average."""
        if now_nanos - self._marks[-1][0] >= GOODPUT_GRAIN_NANOS:
            self._marks.append((now_nanos, self.goodput_bytes))
        while len(self._marks) > 1 and now_nanos - self._marks[1][0] >= NANOS:
            self._marks.popleft()
        since_nanos, until_then = self._marks[0]
        came = self.goodput_bytes - until_then
        return min(came * NANOS // max(NANOS, now_nanos - since_nanos), 0xFFFFFFFF)


class Inbox:
    """Everything between a socket that receives and the messages that came in."""

    def __init__(
        self,
        *,
        receive_buffer: int,
        on_credit: OnCredit,
        on_report: OnReport = lambda *_: None,
        on_request: OnRequest = lambda *_: None,
        limits: Optional[Limits] = None,
    ) -> None:
        self.receive_buffer = receive_buffer
        """Bytes of the socket's receive buffer, as the kernel accounts them."""
        self.reassembler = Reassembler(limits)
        self.datagrams = 0
        self.bytes_received = 0
        self.kernel_drops = 0
        """Datagrams that the kernel dropped for want of buffer; the socket's owner sets it."""
        self.requests_sent = 0
        """Requests to send something again."""
        self._on_credit = on_credit
        self._on_report = on_report
        self._on_request = on_request
        self._told_of: Deque[_Told] = deque()  # appended to by any thread, taken by ours
        self.told: List[Tuple[Address, str, str, TopicReport]] = []
        """Sender, topic, link and report: what `reports` told last."""
        self._peers: OrderedDict[Address, _Peer] = OrderedDict()
        self._guess = Guess(self.reassembler.pool, receive_buffer // CREDIT_SHARE)

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
        return self._receive(datagram, None, len(datagram), sender, now_nanos)

    def slots(self) -> Optional[Slots]:
        """Return where to put the next datagrams, if there is a place; for `receive_run`."""
        return self._guess.slots()

    def receive_run(self, run: Run, now_nanos: int) -> List[Taken]:
        """Take datagrams that came in `slots`; return what `receive` returns, and the sender.

        Parts that lie in their places are taken together, with one credit.
        """
        copies = strays(self._guess, run)
        taken: List[Taken] = []
        index = 0
        while index < run.count:
            end = index
            if copies[index] is None and self._guess.are_placed(run, index):
                end = run.count
            while end < run.count and copies[end] is None and self._guess.is_placed(run, end):
                end += 1
            if end > index:
                taken.append(self._receive_placed(run, index, end, now_nanos))
                index = end
                continue
            sender = run.sender(index)
            copy = copies[index]
            if copy is None and self._guess.begins(run, index):
                head, part = memoryview(run.head(index)), place_of(run, index)
                one = self._receive(head, part, run.size(index), sender, now_nanos)
            else:
                whole = memoryview(copy if copy is not None else run.copy(index))
                one = self._receive(whole, None, len(whole), sender, now_nanos)
            taken.append((*one, sender))
            index += 1
        return taken

    def _receive_placed(self, run: Run, first: int, end: int, now_nanos: int) -> Taken:
        guess = self._guess
        assert guess.header is not None
        sender = run.sender(first)
        number = run.slots.first + first
        last = run.slots.first + end - 1
        size = sum(run.size(index) for index in range(first, end))
        last_size = run.size(end - 1) - run.slots.header_size
        header = guess.header._replace(part_number=number)
        guess.went_on(last + 1)
        self._take_note()
        self.datagrams += end - first
        self.bytes_received += size
        message = None
        try:
            message = self.reassembler.accept_placed(
                header, end - first, last_size, sender, now_nanos
            )
        except Refused as refused:
            self.reassembler.counters.refuse(refused.reason)
        peer = self._peer(sender, now_nanos)
        peer.goodput_bytes += size
        header = header._replace(part_number=last)
        return message, self._credit_if_due(header, message, size, sender, peer), sender

    def _receive(
        self,
        datagram: memoryview,
        part: Optional[memoryview],
        size: int,
        sender: Address,
        now_nanos: int,
    ) -> Tuple[Optional[Message], Optional[Answer]]:
        """Take a datagram of `size` bytes, or its header and the `part` that lies elsewhere."""
        self._take_note()
        self.datagrams += 1
        self.bytes_received += size
        try:
            header, offset = parse(datagram)
            if part is None:
                part = datagram[offset:]
            message = self.reassembler.accept(header, part, sender, now_nanos)
        except Refused as refused:
            self.reassembler.counters.refuse(refused.reason)
            return None, None
        if header.msg_type == CONTROL:
            return (None if message is None else self._take_control(message, sender)), None
        peer = self._peer(sender, now_nanos)
        peer.goodput_bytes += size
        if header.msg_type == RESEND:
            peer.goodput(now_nanos)
            if message is not None:
                self._take_request(header, message, sender)
            return None, None
        if header.parts_max == 1:
            return message, None
        if message is None and header.msg_type != REPAIR:
            known = self.reassembler.open_message(header, sender, now_nanos)
            self._guess.follow(header, bytes(datagram[:offset]), sender, known)
        return message, self._credit_if_due(header, message, size, sender, peer)

    def _credit_if_due(
        self,
        header: Header,
        message: Optional[Message],
        size: int,
        sender: Address,
        peer: _Peer,
    ) -> Optional[Answer]:
        peer.uncredited_bytes += size
        is_end = message is not None or header.part_number == header.parts_max - 1
        if not is_end and peer.uncredited_bytes <= self.receive_buffer // CREDIT_SHARE:
            return None
        peer.uncredited_bytes = 0
        return self._credit(header, sender, peer)

    def requests(self, now_nanos: int) -> List[Answer]:
        """Return what is missed and to be asked for now, as datagrams to send."""
        answers: List[Answer] = []
        for sender, topic, (seq_number, (sec, nsec), request, copies) in self.reassembler.asked():
            to = cast(Address, sender)
            peer = self._peers.get(to)
            goodput = peer.goodput(now_nanos) if peer is not None else 0
            head = Header(RESEND, seq_number, 0, 1, sec, nsec, topic).pack()
            answers += [(head + request._replace(goodput=goodput).pack(), to)] * copies
            self.requests_sent += 1
        return answers

    def refuse(self, reason: str) -> None:
        """Count a datagram that was refused before it came here."""
        self.datagrams += 1
        self.reassembler.counters.refuse(reason)

    def reports(self, now_nanos: int, wall_nanos: int) -> List[Answer]:
        """Return what to tell the senders that were heard lately about what arrived."""
        self._take_note()
        answers = []
        told = []
        for sender, peer in self._peers.items():
            if now_nanos - peer.heard_nanos > HEARD_NANOS:
                continue
            for topic, link, report in self.reassembler.reports(sender, wall_nanos):
                told.append((sender, topic, link, report))
                answers.append((_control(peer, topic, link, wall_nanos, report), sender))
            answers.append((_control(peer, "", "", wall_nanos, self._link_report()), sender))
        self.told = told
        return answers

    def published(self, message: Message, sender: Address, wall_nanos: int) -> None:
        """Take note, from any thread, that a message reached its user at this time."""
        self._told_of.append((sender, message.msg_type, message.topic, key_of(message), wall_nanos))

    def dropped(self, message: Message, sender: Address) -> None:
        """Take note, from any thread, that a message will not reach its user."""
        self._told_of.append((sender, message.msg_type, message.topic, key_of(message), None))

    def _take_note(self) -> None:
        while self._told_of:
            sender, msg_type, topic, key, wall_nanos = self._told_of.popleft()
            arrived = self.reassembler.arrived(sender, msg_type, topic)
            if arrived is None:
                continue
            if wall_nanos is None:
                arrived.drop(key)
            else:
                arrived.published(key, wall_nanos)

    def _take_request(self, header: Header, message: Message, sender: Address) -> None:
        request = parse_resend(message.body)
        if isinstance(request, Request):
            self._on_request(sender, header, request)

    def _take_control(self, message: Message, sender: Address) -> Optional[Message]:
        credit = control.parse(message.body)
        if isinstance(credit, TopicReport):
            self._on_report(sender, message.topic, credit, message.stamp_nanos)
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
            peer = self._peers[sender] = _Peer(now_nanos)
        self._peers.move_to_end(sender)
        peer.heard_nanos = now_nanos
        return peer

    def _credit(self, header: Header, sender: Address, peer: _Peer) -> Answer:
        credit = Credit(header.msg_type, header.part_number, header.seq_number, self.receive_buffer)
        return _control(peer, header.topic, "", header.stamp_nanos, credit), sender

    def _link_report(self) -> LinkReport:
        return LinkReport.of(
            self.receive_buffer,
            self.datagrams,
            self.bytes_received,
            self.kernel_drops,
            self.reassembler.counters.refused,
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
