# SPDX-License-Identifier: Apache-2.0
"""Limits of a receiver, and the table of senders, topics and open messages that keeps them.

A sender is unproven until one of its messages was delivered. All unproven senders together may use
what one proven sender may, and they are forgotten first. Parts and order are not known here.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Hashable, Iterable, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header
from udp_bridge.wire.message import TopicKey
from udp_bridge.wire.reports import TopicReport

from .assembly import Assembly
from .delivery_log import Counters, DeliveryLog
from .nack import NackTracker
from .ordering import MAX_BEHIND, MessageKey, TopicOrder
from .small_topics import SmallTopic


class Limits(NamedTuple):
    """Limits of a receiver; each one guards against defective or hostile senders."""

    memory_bytes: int = 64 << 20
    """Memory of all open messages. A quarter of it, one sender's share, holds the largest possible
    message (255 parts of 65,487 bytes). The pool of free blocks and one message that has just begun
    are not included."""
    share: int = 4
    """A sender may use one part in this many of the memory."""
    time_limit_nanos: int = 2 * NANOS
    """From a message's first part to its last; the largest message at 100 Mbit/s takes 1.4 s."""
    open_per_topic: int = 4
    """Open messages of a topic; older ones are unlikely to be completed."""
    open_per_offered_topic: int = 16
    """The same for a topic with resending, which takes some round trips."""
    open_per_sender: int = 256
    incomplete_per_s: int = 1000
    """Messages of several parts that a sender may begin per second without completing them, to
    bound their processor time. More are refused."""
    offered_topics: int = 128
    """Topics of all senders for which lost parts are requested."""
    senders: int = 64
    topics: int = 1024
    keep_late: bool = False
    """Deliver late messages, too (for recorders)."""

    @property
    def memory_per_sender(self) -> int:
        """Memory of one sender's open messages."""
        return self.memory_bytes // self.share


class Usage:
    """Resources used by one proven sender, or by all unproven senders together."""

    __slots__ = ("memory_bytes", "open", "spent_nanos")

    def __init__(self) -> None:
        self.memory_bytes = 0
        self.open: OrderedDict[OpenKey, int] = OrderedDict()
        """Open messages, oldest first, and their bytes."""
        self.spent_nanos = 0
        """Time up to which `Limits.incomplete_per_s` is used up."""


class SenderState:
    """One sender: its topics, ordered by their last datagram."""

    __slots__ = ("is_proven", "topics", "usage")

    def __init__(self, usage: Usage) -> None:
        self.is_proven = False
        """Whether a message was delivered."""
        self.topics: OrderedDict[TopicKey, TopicState] = OrderedDict()
        self.usage = usage


class TopicState:
    """One type and topic of one sender."""

    __slots__ = (
        "_totals",
        "duplicates",
        "link",
        "log",
        "nacks",
        "open",
        "order",
        "sender",
        "small",
    )

    def __init__(self, sender: SenderState, totals: Counters) -> None:
        self.sender = sender
        self.order = TopicOrder()
        self.open: OrderedDict[MessageKey, Assembly] = OrderedDict()
        self.link = ""
        """The link seen last."""
        self.duplicates = 0
        self.log = DeliveryLog()
        """Since the last restart of the sender."""
        self.nacks: Optional[NackTracker] = None
        """Set once the sender has offered to resend."""
        self.small: Optional[SmallTopic] = None
        """Set while the topic is followed as a small one."""
        self._totals = totals

    def end_small(self) -> None:
        """Have the next message take the ordinary path."""
        if self.small is not None:
            self.small.end()
            self.small = None

    def restart(self) -> None:
        """Start over, as for an unknown sender; `duplicates` continues."""
        self.order.reset()
        self.log = DeliveryLog()
        if self.nacks is not None:
            self.nacks.reset()

    def is_jump(self, header: Header, *, is_offer: bool = False) -> bool:
        """Tell whether a message's number is too far from earlier ones to be believed alone.

        Resent messages are behind, too, so in an offered topic only an Offer can jump back.
        """
        nacks = self.nacks
        behind = MAX_BEHIND if nacks is None or is_offer else SEQ_NUMBERS
        return self.order.is_jump(header, behind) or (
            nacks is not None and nacks.is_jump(header.seq_number, behind)
        )

    def report(self, msg_type: int, wall_nanos: int) -> TopicReport:
        """Return the report at this moment of the wall clock."""
        return self.log.report(msg_type, self.duplicates, wall_nanos)

    def count_duplicates(self, count: int = 1) -> None:
        """Count duplicate datagrams of this topic, and in the totals."""
        self.duplicates += count
        self._totals.duplicates += count


OpenKey = Tuple[TopicState, MessageKey]


class SenderTable:
    """All senders, their topics and open messages, within the limits."""

    def __init__(self, limits: Limits, totals: Counters) -> None:
        self.memory_bytes = 0
        """Memory of all open messages."""
        self._limits = limits
        self._totals = totals
        self._senders: OrderedDict[Hashable, SenderState] = OrderedDict()
        self._unproven = Usage()
        self._open: OrderedDict[OpenKey, None] = OrderedDict()  # of all senders, oldest first
        self._cost_nanos = NANOS // limits.incomplete_per_s
        self._topic_count = 0
        self._offered_count = 0

    def topic(self, address: Hashable, key: TopicKey) -> TopicState:
        """Return a topic as the one used last; if it is new, another one may be forgotten."""
        sender = self._senders.get(address)
        if sender is None:
            if len(self._senders) >= self._limits.senders:
                unproven = (a for a, other in self._senders.items() if not other.is_proven)
                self._forget_sender(next(unproven, next(iter(self._senders))))
            sender = self._senders[address] = SenderState(self._unproven)
        self._senders.move_to_end(address)
        topic = sender.topics.get(key)
        if topic is None:
            if self._topic_count >= self._limits.topics:
                owner = self._owner_of_topic_to_forget(sender)
                self._forget_topic(owner, next(iter(owner.topics)))
            topic = sender.topics[key] = TopicState(sender, self._totals)
            self._topic_count += 1
        sender.topics.move_to_end(key)
        return topic

    def topics(self, address: Hashable) -> Iterable[Tuple[TopicKey, TopicState]]:
        """Return the topics of a sender with their keys."""
        sender = self._senders.get(address)
        return sender.topics.items() if sender is not None else ()

    def find(self, address: Hashable, key: TopicKey) -> Optional[TopicState]:
        """Return a topic, or None if it is unknown."""
        sender = self._senders.get(address)
        return sender.topics.get(key) if sender is not None else None

    def track_nacks(self, topic: TopicState) -> Optional[NackTracker]:
        """Return the tracker of an offered topic; None if there are too many offered topics."""
        if topic.nacks is None and self._offered_count < self._limits.offered_topics:
            topic.nacks = NackTracker()
            self._offered_count += 1
            for assembly in topic.open.values():
                for number in (n for n, is_in in enumerate(assembly.arrived) if is_in):
                    part = assembly.header._replace(part_number=number)
                    now_nanos = assembly.since_nanos
                    topic.nacks.on_parts(part, is_complete=False, now_nanos=now_nanos)
        return topic.nacks

    def may_begin(self, address: Hashable, now_nanos: int) -> bool:
        """Tell whether a sender may begin another message of several parts."""
        sender = self._senders.get(address)
        usage = sender.usage if sender is not None else self._unproven
        return usage.spent_nanos - now_nanos < NANOS

    def mark_proven(self, sender: SenderState) -> None:
        """Give a sender its own share after its first delivered message."""
        sender.is_proven = True
        sender.usage = Usage()
        for key in [key for key in self._unproven.open if key[0].sender is sender]:
            size = self._unproven.open.pop(key)
            self._unproven.memory_bytes -= size
            sender.usage.open[key] = size
            sender.usage.memory_bytes += size

    def fits_alone(self, announced_bytes: int) -> bool:
        """Tell whether nothing is open and a message of this size is within the limits."""
        return not self.memory_bytes and announced_bytes <= self._limits.memory_per_sender

    def hold(self, topic: TopicState, key: MessageKey, assembly: Assembly) -> None:
        """Keep an open message and count its memory; give up the oldest if it is too much."""
        usage, open_key = topic.sender.usage, (topic, key)
        if key not in topic.open:
            limit = self._limits.open_per_topic
            if topic.nacks is not None:
                limit = max(limit, self._limits.open_per_offered_topic)
            while len(topic.open) >= limit:
                self.give_up(topic, next(iter(topic.open)))
            while len(usage.open) >= self._limits.open_per_sender:
                self._give_up_oldest(usage)
            topic.open[key] = assembly
            usage.open[open_key], self._open[open_key] = 0, None
            usage.spent_nanos = max(usage.spent_nanos, assembly.since_nanos) + self._cost_nanos
        size = assembly.held_bytes
        growth = size - usage.open[open_key]
        if not growth:
            return
        usage.open[open_key] = size
        usage.memory_bytes += growth
        self.memory_bytes += growth
        while usage.memory_bytes > self._limits.memory_per_sender:
            self._give_up_oldest(usage)
        while self.memory_bytes > self._limits.memory_bytes:
            # A sender without other open messages takes from the one that uses the most.
            has_others = usage.memory_bytes > usage.open.get(open_key, 0)
            usages = (sender.usage for sender in self._senders.values())
            largest = max(usages, key=lambda other: other.memory_bytes)
            self._give_up_oldest(usage if has_others else largest)

    def release(self, topic: TopicState, key: MessageKey) -> None:
        """Remove a complete message; it does not count against its sender."""
        if key in topic.open:
            self._remove(topic, key)
            topic.sender.usage.spent_nanos -= self._cost_nanos

    def _remove(self, topic: TopicState, key: MessageKey) -> None:
        del topic.open[key], self._open[topic, key]
        size = topic.sender.usage.open.pop((topic, key))
        topic.sender.usage.memory_bytes -= size
        self.memory_bytes -= size

    def give_up(self, topic: TopicState, key: MessageKey) -> None:
        """Remove an open message and count it as incomplete."""
        header = topic.open[key].header
        topic.order.mark_finished(header)
        if topic.nacks is not None:
            topic.nacks.discard(header)
        self._totals.incomplete += 1
        topic.log.outcomes.settle(header.seq_number, "incomplete")
        self._remove(topic, key)

    def give_up_topic(self, topic: TopicState, *, before_nanos: Optional[int] = None) -> None:
        """Give up a topic's open messages, or only those with a stamp before `before_nanos`."""
        for key, assembly in list(topic.open.items()):
            if before_nanos is None or assembly.header.stamp_nanos < before_nanos:
                self.give_up(topic, key)

    def give_up_since(self, since_nanos: Optional[int] = None) -> None:
        """Give up all messages that began at `since_nanos` or earlier, or all."""
        while self._open:
            topic, key = next(iter(self._open))
            if since_nanos is not None and topic.open[key].since_nanos > since_nanos:
                return
            self.give_up(topic, key)

    def forget_all(self) -> None:
        """Forget all senders."""
        for address in list(self._senders):
            self._forget_sender(address)

    def _give_up_oldest(self, usage: Usage) -> None:
        self.give_up(*next(iter(usage.open)))

    def _owner_of_topic_to_forget(self, sender: SenderState) -> SenderState:
        """Return the sender that loses a topic when `sender` begins another one.

        A proven sender takes it from an unproven one; otherwise each sender replaces its own, and
        a sender without topics takes it from the one that has the most.
        """
        unproven = [s for s in self._senders.values() if not s.is_proven and s.topics]
        if sender.topics and (not sender.is_proven or not unproven):
            return sender
        return max(unproven or self._senders.values(), key=lambda other: len(other.topics))

    def _forget_topic(self, sender: SenderState, key: TopicKey) -> None:
        topic = sender.topics.pop(key)
        topic.end_small()
        self.give_up_topic(topic)
        self._topic_count -= 1
        self._offered_count -= topic.nacks is not None

    def _forget_sender(self, address: Hashable) -> None:
        sender = self._senders.pop(address)
        for key in list(sender.topics):
            self._forget_topic(sender, key)
