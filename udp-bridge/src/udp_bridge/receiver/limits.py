# SPDX-License-Identifier: Apache-2.0
"""What a receiver holds: senders, their topics, their open messages; and what gives way.

Every bound of `Limits` is kept here and nowhere else. A sender is a stranger until a message of it
was handed over; all strangers together get what one known sender gets, and give way to known ones.
No datagram is looked into: the rules by which messages are joined and ordered are in `reassembly`.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Hashable, Iterable, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header
from udp_bridge.wire.reports import TopicReport

from .arrivals import TopicArrivals
from .assembly import Assembly
from .counters import Counters
from .nack import Asking
from .ordering import MOST_BEHIND, Key, Order


class Limits(NamedTuple):
    """What a receiver spends at most; each is a guard against peers that err or attack."""

    memory_bytes: int = 64 << 20
    """What all open messages take; a quarter of it, which is one sender's share, holds the largest
    possible message (255 parts of 65,487 bytes). The pool of free blocks and one message that is
    just begun come on top."""
    share: int = 4
    """A sender holds at most one part in this many of the memory."""
    time_limit_nanos: int = 2 * NANOS
    """From a message's first part to its last; the largest message at 100 Mbit/s takes 1.4 s."""
    open_per_topic: int = 4
    """Open messages of a topic: older ones can hardly become whole any more."""
    open_per_offered_topic: int = 16
    """The same where lost parts can be asked for, which takes some round trips."""
    open_per_sender: int = 256
    incomplete_per_s: int = 1000
    """Messages of several parts that a sender may begin a second and that do not become whole: what
    they cost in processor time. More are refused until time has passed."""
    offered_topics: int = 128
    """Topics of all senders for which lost parts are asked."""
    senders: int = 64
    topics: int = 1024
    keep_late: bool = False
    """Hand over messages that come behind newer ones, too (for recorders)."""

    @property
    def most_of_a_sender(self) -> int:
        """Bytes that one sender's open messages take at most."""
        return self.memory_bytes // self.share


class Share:
    """What one known sender holds and has spent, or all strangers together."""

    __slots__ = ("memory_bytes", "open", "spent_nanos")

    def __init__(self) -> None:
        self.memory_bytes = 0
        self.open: OrderedDict[Place, int] = OrderedDict()
        """Open messages, oldest first, and their bytes."""
        self.spent_nanos = 0
        """The time up to which `Limits.incomplete_per_s` is spent."""


class Sender:
    """What is known of one sender; its topics in the order in which they were last heard."""

    __slots__ = ("is_stranger", "share", "topics")

    def __init__(self, share: Share) -> None:
        self.is_stranger = True
        self.topics: OrderedDict[Tuple[int, str], Topic] = OrderedDict()
        self.share = share


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


Place = Tuple[Topic, Key]


class Holdings:
    """All that is known of all senders."""

    def __init__(self, limits: Limits, totals: Counters) -> None:
        self.memory_bytes = 0
        """What all open messages take."""
        self._limits = limits
        self._totals = totals
        self._senders: OrderedDict[Hashable, Sender] = OrderedDict()
        self._strangers = Share()
        self._open: OrderedDict[Place, None] = OrderedDict()  # of all senders, oldest first
        self._cost_nanos = NANOS // limits.incomplete_per_s
        self._topic_count = 0
        self._offered_count = 0

    def topic(self, address: Hashable, key: Tuple[int, str]) -> Topic:
        """Return what is known of a topic; when it is one too many, another one is forgotten."""
        sender = self._senders.get(address)
        if sender is None:
            if len(self._senders) >= self._limits.senders:
                silent = (a for a, other in self._senders.items() if other.is_stranger)
                self._forget_sender(next(silent, next(iter(self._senders))))
            sender = self._senders[address] = Sender(self._strangers)
        self._senders.move_to_end(address)
        topic = sender.topics.get(key)
        if topic is None:
            if self._topic_count >= self._limits.topics:
                loser = self._loser_of_a_topic(sender)
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

    def may_begin(self, address: Hashable, now_nanos: int) -> bool:
        """Tell whether a sender may begin another message of several parts."""
        sender = self._senders.get(address)
        share = sender.share if sender is not None else self._strangers
        return share.spent_nanos - now_nanos < NANOS

    def know(self, sender: Sender) -> None:
        """Take note that a message of a sender was handed over: it is a stranger no more."""
        sender.is_stranger = False
        sender.share = Share()
        for place in [place for place in self._strangers.open if place[0].sender is sender]:
            size = self._strangers.open.pop(place)
            self._strangers.memory_bytes -= size
            sender.share.open[place] = size
            sender.share.memory_bytes += size

    def takes_alone(self, announced_bytes: int) -> bool:
        """Tell whether nothing is open and a message of this size is not too large."""
        return not self.memory_bytes and announced_bytes <= self._limits.most_of_a_sender

    def hold(self, topic: Topic, key: Key, assembly: Assembly) -> None:
        """Keep an unfinished message; where it takes too much, the oldest give way."""
        share, place = topic.sender.share, (topic, key)
        if key not in topic.open:
            most = self._limits.open_per_topic
            if topic.asking is not None:
                most = max(most, self._limits.open_per_offered_topic)
            while len(topic.open) >= most:
                self.give_up(topic, next(iter(topic.open)))
            while len(share.open) >= self._limits.open_per_sender:
                self._give_up_oldest(share)
            topic.open[key] = assembly
            share.open[place], self._open[place] = 0, None
            share.spent_nanos = max(share.spent_nanos, assembly.since_nanos) + self._cost_nanos
        size = assembly.held_bytes
        more = size - share.open[place]
        if not more:
            return
        share.open[place] = size
        share.memory_bytes += more
        self.memory_bytes += more
        while share.memory_bytes > self._limits.most_of_a_sender:
            self._give_up_oldest(share)
        while self.memory_bytes > self._limits.memory_bytes:
            # Who holds nothing else to give takes from the one who holds the most.
            has_others = share.memory_bytes > share.open.get(place, 0)
            shares = (sender.share for sender in self._senders.values())
            largest = max(shares, key=lambda other: other.memory_bytes)
            self._give_up_oldest(share if has_others else largest)

    def release(self, topic: Topic, key: Key) -> None:
        """Let go of a message that is whole; it costs its sender nothing."""
        if key in topic.open:
            self._let_go(topic, key)
            topic.sender.share.spent_nanos -= self._cost_nanos

    def _let_go(self, topic: Topic, key: Key) -> None:
        del topic.open[key], self._open[topic, key]
        size = topic.sender.share.open.pop((topic, key))
        topic.sender.share.memory_bytes -= size
        self.memory_bytes -= size

    def give_up(self, topic: Topic, key: Key) -> None:
        """Count an open message as incomplete and let go of it."""
        topic.order.finish(topic.open[key].header)
        if topic.asking is not None:
            topic.asking.finished(topic.open[key].header)
        topic.count("incomplete")
        topic.arrived.fates.settle(topic.open[key].header.seq_number, "incomplete")
        self._let_go(topic, key)

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

    def _give_up_oldest(self, share: Share) -> None:
        self.give_up(*next(iter(share.open)))

    def _loser_of_a_topic(self, sender: Sender) -> Sender:
        """Return who gives a topic: a stranger to a known sender, else itself, or the largest."""
        strangers = [s for s in self._senders.values() if s.is_stranger and s.topics]
        if sender.topics and (sender.is_stranger or not strangers):
            return sender
        return max(strangers or self._senders.values(), key=lambda other: len(other.topics))

    def _forget_topic(self, sender: Sender, key: Tuple[int, str]) -> None:
        topic = sender.topics.pop(key)
        self.give_up_topic(topic)
        self._topic_count -= 1
        self._offered_count -= topic.asking is not None

    def _forget_sender(self, address: Hashable) -> None:
        sender = self._senders.pop(address)
        for key in list(sender.topics):
            self._forget_topic(sender, key)
