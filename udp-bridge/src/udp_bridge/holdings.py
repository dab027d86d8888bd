# SPDX-License-Identifier: Apache-2.0
"""What a receiver holds: senders, their topics, their open messages; and what gives way.

Every bound of `Limits` is kept here and nowhere else. No datagram is looked into: the rules by
which messages are joined and ordered are in `reassembly`.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Callable, Hashable, Iterable, NamedTuple, Optional, Tuple

from .arrivals import TopicArrivals
from .assembly import Assembly
from .counters import Counters
from .header import NANOS, SEQ_NUMBERS, Header
from .ordering import MOST_BEHIND, Key, Order
from .reports import TopicReport
from .resend_asking import Asking


class Limits(NamedTuple):
    """What a receiver spends at most; each is a guard against peers that err or attack."""

    memory_bytes: int = 64 << 20
    """Announced size of all open messages; a quarter of it, which is one sender's share, holds
    the largest possible message (255 parts of 65,487 bytes)."""
    share: int = 4
    """A sender holds at most one part in this many of the memory."""
    time_limit_nanos: int = 2 * NANOS
    """From a message's first part to its last; the largest message at 100 Mbit/s takes 1.4 s."""
    open_per_topic: int = 4
    """Open messages of a topic: older ones can hardly become whole any more."""
    open_per_offered_topic: int = 16
    """The same where lost parts can be asked for, which takes some round trips."""
    offered_topics: int = 128
    """Topics of all senders for which lost parts are asked."""
    senders: int = 64
    topics: int = 1024
    keep_late: bool = False
    """Hand over messages that come behind newer ones, too (for recorders)."""

    @property
    def most_of_a_sender(self) -> int:
        """Announced bytes that one sender's open messages take at most."""
        return self.memory_bytes // self.share


class Sender:
    """What is known of one sender; its topics in the order in which they were last heard."""

    __slots__ = ("memory_bytes", "topics")

    def __init__(self) -> None:
        self.topics: OrderedDict[Tuple[int, str], Topic] = OrderedDict()
        self.memory_bytes = 0


class Topic:
    """What is known of one type and topic of one sender."""

    __slots__ = ("_totals", "arrived", "asking", "counters", "link", "open", "order", "sender")

    def __init__(self, sender: Sender, totals: Counters) -> None:
        self.sender = sender
        self.order = Order()
        self.open: OrderedDict[Key, Assembly] = OrderedDict()
        self.link = ""
        """The link last seen."""
        self.counters = Counters()
        self.arrived = TopicArrivals()
        """Of the sender's present life."""
        self.asking: Optional[Asking] = None
        """What can be asked for, once the sender offered to send it again."""
        self._totals = totals

    def restart(self) -> None:
        """Begin anew, as for a sender never heard of; only the counters go on."""
        self.order.forget()
        self.arrived = TopicArrivals()
        if self.asking is not None:
            self.asking.forget()

    def is_jump(self, header: Header, *, is_offer: bool = False) -> bool:
        """Tell whether a message's number is too far from those that came to be believed alone.

        What was sent again is behind, too, so that in an offered topic only an Offer jumps back.
        """
        asking = self.asking
        behind = MOST_BEHIND if asking is None or is_offer else SEQ_NUMBERS
        return self.order.is_jump(header, behind) or (
            asking is not None and asking.is_jump(header.seq_number, behind)
        )

    def report(self, msg_type: int, wall_nanos: int) -> TopicReport:
        """Return what is so at this moment of the wall clock."""
        return self.arrived.report(msg_type, self.counters.duplicates, wall_nanos)

    def count(self, what: str, count: int = 1) -> None:
        """Count something of this topic, and in the totals."""
        for counters in (self.counters, self._totals):
            setattr(counters, what, getattr(counters, what) + count)


class Holdings:
    """All that is known of all senders."""

    def __init__(self, limits: Limits, totals: Counters) -> None:
        self.memory_bytes = 0
        """Announced size of all open messages."""
        self._limits = limits
        self._totals = totals
        self._senders: OrderedDict[Hashable, Sender] = OrderedDict()
        self._open: OrderedDict[Tuple[Topic, Key], int] = OrderedDict()  # announced, oldest first
        self._topic_count = 0
        self._offered_count = 0

    def topic(self, address: Hashable, key: Tuple[int, str]) -> Topic:
        """Return what is known of a topic; when it is one too many, another one is forgotten."""
        sender = self._senders.get(address)
        if sender is None:
            if len(self._senders) >= self._limits.senders:
                self._forget_sender(next(iter(self._senders)))
            sender = self._senders[address] = Sender()
        self._senders.move_to_end(address)
        topic = sender.topics.get(key)
        if topic is None:
            if self._topic_count >= self._limits.topics:
                # Its own oldest; a newcomer takes from the one who holds the most.
                loser = sender if sender.topics else self._most(lambda s: len(s.topics))
                self._forget_topic(loser, next(iter(loser.topics)))
            topic = sender.topics[key] = Topic(sender, self._totals)
            self._topic_count += 1
        sender.topics.move_to_end(key)
        return topic

    def topics(self, address: Hashable) -> Iterable[Tuple[Tuple[int, str], Topic]]:
        """Return the topics of a sender with their keys."""
        sender = self._senders.get(address)
        return sender.topics.items() if sender is not None else ()

    def find(self, address: Hashable, key: Tuple[int, str]) -> Optional[Topic]:
        """Return what is known of a topic, if anything is."""
        sender = self._senders.get(address)
        return sender.topics.get(key) if sender is not None else None

    def ask(self, topic: Topic) -> Optional[Asking]:
        """Return where to note what can be asked for of a topic; None when it is one too many."""
        if topic.asking is None and self._offered_count < self._limits.offered_topics:
            topic.asking = Asking()
            self._offered_count += 1
            for assembly in topic.open.values():
                for number in filter(assembly.has, range(assembly.header.parts_max)):
                    came = assembly.header._replace(part_number=number)
                    topic.asking.saw(came, is_whole=False, now_nanos=assembly.since_nanos)
        return topic.asking

    def takes_alone(self, announced_bytes: int) -> bool:
        """Tell whether nothing is open and a message of this size is not too large."""
        return not self.memory_bytes and announced_bytes <= self._limits.most_of_a_sender

    def hold(self, topic: Topic, key: Key, assembly: Assembly) -> None:
        """Keep an unfinished message; where it announces too much, the oldest give way."""
        if key not in topic.open:
            most = self._limits.open_per_topic
            if topic.asking is not None:
                most = max(most, self._limits.open_per_offered_topic)
            while len(topic.open) >= most:
                self.give_up(topic, next(iter(topic.open)))
            topic.open[key] = assembly
        sender = topic.sender
        more = assembly.announced_bytes - self._open.get((topic, key), 0)
        self._open[topic, key] = assembly.announced_bytes
        sender.memory_bytes += more
        self.memory_bytes += more
        while sender.memory_bytes > self._limits.most_of_a_sender:
            self._give_up_oldest(sender)
        while self.memory_bytes > self._limits.memory_bytes:
            # Who holds nothing else to give takes from the one who holds the most.
            has_others = sender.memory_bytes > self._open.get((topic, key), 0)
            self._give_up_oldest(sender if has_others else self._most(lambda s: s.memory_bytes))

    def release(self, topic: Topic, key: Key) -> None:
        """Let go of a message that is whole."""
        if topic.open.pop(key, None) is not None:
            announced_bytes = self._open.pop((topic, key))
            topic.sender.memory_bytes -= announced_bytes
            self.memory_bytes -= announced_bytes

    def give_up(self, topic: Topic, key: Key) -> None:
        """Count an open message as incomplete and let go of it."""
        topic.order.finish(topic.open[key].header)
        if topic.asking is not None:
            topic.asking.finished(topic.open[key].header)
        topic.count("incomplete")
        topic.arrived.fates.settle(topic.open[key].header.seq_number, "incomplete")
        self.release(topic, key)

    def give_up_topic(self, topic: Topic, *, before_nanos: Optional[int] = None) -> None:
        """Give up a topic's open messages, or only those with a stamp before `before_nanos`."""
        for key, assembly in list(topic.open.items()):
            if before_nanos is None or assembly.header.stamp_nanos < before_nanos:
                self.give_up(topic, key)

    def give_up_since(self, since_nanos: Optional[int] = None) -> None:
        """Give up all messages whose first part came at `since_nanos` or earlier, or all."""
        while self._open:
            topic, key = next(iter(self._open))
            if since_nanos is not None and topic.open[key].since_nanos > since_nanos:
                return
            self.give_up(topic, key)

    def forget_all(self) -> None:
        """Forget all senders."""
        for address in list(self._senders):
            self._forget_sender(address)

    def _give_up_oldest(self, sender: Sender) -> None:
        self.give_up(*next(place for place in self._open if place[0].sender is sender))

    def _most(self, measure: Callable[[Sender], int]) -> Sender:
        return max(self._senders.values(), key=measure)

    def _forget_topic(self, sender: Sender, key: Tuple[int, str]) -> None:
        topic = sender.topics.pop(key)
        self.give_up_topic(topic)
        self._topic_count -= 1
        self._offered_count -= topic.asking is not None

    def _forget_sender(self, address: Hashable) -> None:
        sender = self._senders.pop(address)
        for key in list(sender.topics):
            self._forget_topic(sender, key)
