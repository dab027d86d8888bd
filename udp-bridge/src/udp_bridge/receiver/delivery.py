# SPDX-License-Identifier: Apache-2.0
"""Delivery rules: deliver a complete message or drop it as late, and detect restarted senders.

A number that is not ahead is late, resent, or from a restarted sender. Numbers, stamps and the
requests that were sent tell these cases apart.
"""

from __future__ import annotations

from typing import List, Optional, Tuple

from udp_bridge.wire.header import NANOS, Header
from udp_bridge.wire.message import Message

from .delivery_log import Counters, DeliveryLog
from .limits import SenderTable, TopicState
from .nack import NackTracker
from .ordering import MAX_AHEAD, MessageKey, key_of


class DeliveryRules:
    """Decisions about the messages of one receiver.

    Parameters
    ----------
    keep_late
        Deliver late messages, too.
    """

    def __init__(self, senders: SenderTable, totals: Counters, *, keep_late: bool) -> None:
        self._senders = senders
        self._totals = totals
        self._keep_late = keep_late
        self._unlogged: List[Tuple[DeliveryLog, MessageKey, int]] = []

    def detect_restart(self, topic: TopicState, header: Header, now_nanos: int) -> None:
        """Start a topic over if its sender was restarted."""
        nacks = topic.nacks
        if nacks is not None:
            if nacks.is_missing(header, now_nanos):
                return  # it was resent
            self.detect_offered_restart(topic, nacks, header, now_nanos)
        if topic.order.is_restart_after_silence(header, now_nanos):
            self._senders.give_up_topic(topic)
            topic.restart()

    def detect_offered_restart(
        self, topic: TopicState, nacks: NackTracker, header: Header, now_nanos: int
    ) -> None:
        """Start an offered topic over at the first datagram of a restarted sender."""
        is_known = topic.order.is_finished(header) or key_of(header) in topic.open
        if is_known or nacks.is_missing(header, now_nanos) or not nacks.is_restart(header):
            return
        self._senders.give_up_topic(topic, before_nanos=header.stamp_nanos)
        topic.restart()

    def drops_jump(
        self, topic: TopicState, header: Header, now_nanos: int, *, is_offer: bool = False
    ) -> bool:
        """Tell whether to drop a datagram because its message's number jumps.

        Two consecutive numbers that jump are believed: the topic starts over with the second one.
        Parts of open and of requested messages do not jump. Offers skip numbers, so any two of
        them that are close count as consecutive.
        """
        order, nacks = topic.order, topic.nacks
        if not topic.is_jump(header, is_offer=is_offer):
            return False
        if not is_offer and key_of(header) in topic.open:
            return False
        if not is_offer and nacks is not None and nacks.is_missing(header, now_nanos):
            return False
        if not order.follows_suspect(header.seq_number, MAX_AHEAD if is_offer else 1):
            self._totals.late += order.mark_suspect(header.seq_number)
            return True
        self._totals.missing += max(0, order.ahead_by(header.seq_number) - 1)
        self._senders.give_up_topic(topic)
        topic.restart()
        return False

    def deliver_in_order(
        self, topic: TopicState, header: Header, body: memoryview, now_nanos: int
    ) -> Optional[Message]:
        """Return a complete message; None if it is late."""
        order = topic.order
        nacks = topic.nacks
        is_ahead = order.ahead_by(header.seq_number) > 0
        is_missing = nacks is not None and nacks.is_missing(header, now_nanos)
        is_requested = nacks is not None and nacks.is_requested(header)
        # A resent message is not newer by more than the limit; otherwise the sender restarted.
        newer_by = order.newer_by(header)
        is_resent = nacks is not None and is_missing and nacks.is_within_limit(newer_by)
        if not is_ahead and not is_resent and newer_by > 0:
            self._senders.give_up_topic(topic, before_nanos=header.stamp_nanos)
            topic.restart()
            topic.log.mark_arrived(header)
            is_ahead = True
        order.mark_finished(header)
        if is_ahead and not self._is_stale(topic, header):
            self._totals.missing += order.mark_delivered(header, now_nanos)
        elif not self._keep_late and not is_missing:
            self._totals.late += 1
            topic.log.outcomes.settle(header.seq_number, "late")
            return None
        else:
            order.end_silence(now_nanos)
        if is_requested:
            self._totals.repaired += 1
            topic.log.outcomes.mark_repaired(header.seq_number)
        return self.deliver(topic, header, body)

    @staticmethod
    def _is_stale(topic: TopicState, header: Header) -> bool:
        """Tell whether a message is too old; two in a row show that the clock was set back."""
        order = topic.order
        if topic.nacks is not None or not order.is_stale(header):
            return False
        if order.follows_suspect(header.seq_number):
            return False
        order.mark_suspect(header.seq_number)
        return True

    def deliver(self, topic: TopicState, header: Header, body: memoryview) -> Message:
        """Return a message that passed all rules; `log_delivered` enters it into the log."""
        if not topic.sender.is_proven:
            self._senders.mark_proven(topic.sender)
        self._totals.messages += 1
        message = message_of(header, body)
        self._unlogged.append((topic.log, key_of(message), body.nbytes))
        return message

    def log_delivered(self) -> None:
        """Enter messages into their logs. This is done after their users have got them."""
        if self._unlogged:
            for log, key, size in self._unlogged:
                log.mark_delivered(key, size)
            self._unlogged.clear()


def message_of(header: Header, body: memoryview) -> Message:
    """Return the message of a header and its whole body."""
    msg_type, seq_number, _, parts_max, sec, nsec, topic, link = header
    # An assembled body lies in its own block. A single part lies in the received datagram: either
    # immutable bytes, or a buffer that is overwritten.
    if parts_max == 1 and not isinstance(body.obj, bytes):
        body = memoryview(bytes(body))
    return Message(msg_type, topic, link, sec * NANOS + nsec, seq_number, body, parts_max)
