# SPDX-License-Identifier: Apache-2.0
"""What becomes of a whole message, and whether its sender was restarted: order and repair together.

A number that is not ahead is late, sent again, or of a sender's new life, and which of them must be
told by numbers, stamps and what was asked for. Parts and bounds are not looked at here.
"""

from __future__ import annotations

from typing import List, Optional, Tuple

from udp_bridge.wire.header import NANOS, Header
from udp_bridge.wire.message import Message

from .arrivals import Key, TopicArrivals
from .counters import Counters
from .limits import Holdings, Topic
from .nack import Asking
from .ordering import MOST_AHEAD, key_of


class Verdicts:
    """The judge of one receiver.

    Parameters
    ----------
    keep_late
        Hand over messages that come behind newer ones, too.
    """

    def __init__(self, holdings: Holdings, totals: Counters, *, keep_late: bool) -> None:
        self._holdings = holdings
        self._totals = totals
        self._keep_late = keep_late
        self._handed: List[Tuple[TopicArrivals, Key, int]] = []

    def notice_restart(self, topic: Topic, header: Header, now_nanos: int) -> None:
        """Begin a topic anew when its sender was restarted, and did not send something again."""
        asking = topic.asking
        if asking is not None:
            if asking.is_wanted(header, now_nanos):
                return
            self.notice_new_life(topic, asking, header, now_nanos)
        if topic.order.is_restart_by_silence(header, now_nanos):
            self._holdings.give_up_topic(topic)
            topic.restart()

    def notice_new_life(self, topic: Topic, asking: Asking, header: Header, now_nanos: int) -> None:
        """Begin an offered topic anew at the first that is heard of a sender's new life."""
        is_known = topic.order.is_finished(header) or key_of(header) in topic.open
        if is_known or asking.is_wanted(header, now_nanos) or not asking.is_of_new_life(header):
            return
        self._holdings.give_up_topic(topic, before_nanos=header.stamp_nanos)
        topic.restart()

    def is_jump(
        self, topic: Topic, header: Header, now_nanos: int, *, is_offer: bool = False
    ) -> bool:
        """Tell whether a datagram is to be dropped because its message's number jumps.

        Two numbers in a row that jump are believed: the topic begins anew with the second one.
        Parts of open messages and of those that are asked for do not jump. Offers leave numbers
        out, so that in a row means nearly so.
        """
        order, asking = topic.order, topic.asking
        if not topic.is_jump(header, is_offer=is_offer):
            return False
        if not is_offer and key_of(header) in topic.open:
            return False
        if not is_offer and asking is not None and asking.is_wanted(header, now_nanos):
            return False
        if not order.is_second(header.seq_number, MOST_AHEAD if is_offer else 1):
            if order.suspect(header.seq_number):
                topic.count("late")
            return True
        self._totals.missing += max(0, order.ahead_by(header.seq_number) - 1)
        self._holdings.give_up_topic(topic)
        topic.restart()
        return False

    def finish(
        self, topic: Topic, header: Header, body: memoryview, now_nanos: int
    ) -> Optional[Message]:
        """Judge a whole message by the order of its topic; return it unless it is late."""
        order = topic.order
        asking = topic.asking
        is_ahead = order.ahead_by(header.seq_number) > 0
        is_wanted = asking is not None and asking.is_wanted(header, now_nanos)
        is_asked = asking is not None and asking.is_asked(header)
        # What is sent again is at most that stale; newer by more, it is of a restarted sender.
        is_again = asking is not None and is_wanted and asking.spans(order.newer_by(header))
        if not is_ahead and not is_again and order.is_newer(header):
            self._holdings.give_up_topic(topic, before_nanos=header.stamp_nanos)
            topic.restart()
            topic.arrived.seen(header)
            is_ahead = True
        order.finish(header)
        if is_ahead and not self._is_stale(topic, header):
            self._totals.missing += order.hand_over(header, now_nanos)
        elif not self._keep_late and not is_wanted:
            topic.count("late")
            topic.arrived.fates.settle(header.seq_number, "late")
            return None
        if is_asked:
            topic.count("repaired")
            topic.arrived.fates.mended(header.seq_number)
        return self.handed(topic, header, body)

    @staticmethod
    def _is_stale(topic: Topic, header: Header) -> bool:
        """Tell whether a message is too old; two in a row show that the clock was set back."""
        order = topic.order
        if topic.asking is not None or not order.is_stale(header):
            return False
        if order.is_second(header.seq_number):
            return False
        order.suspect(header.seq_number)
        return True

    def handed(self, topic: Topic, header: Header, body: memoryview) -> Message:
        """Return a message to be handed over; `take_note` tells its topic."""
        if self._handed:
            self.take_note()
        if topic.sender.is_stranger:
            self._holdings.know(topic.sender)
        self._totals.messages += 1
        message = message_of(header, body)
        self._handed.append((topic.arrived, (message.seq_number, message.stamp_nanos), body.nbytes))
        return message

    def take_note(self) -> None:
        """Tell the topic of the message that was handed over; the message goes before that."""
        while self._handed:
            arrived, key, size = self._handed.pop()
            arrived.handed(key, size)


def message_of(header: Header, body: memoryview) -> Message:
    """Return the message of a header and its whole body."""
    msg_type, seq_number, _, parts_max, sec, nsec, topic, link = header
    # What was joined lies in a block of its own. A single part lies as it came: in bytes, which
    # nobody can change, or in a buffer that is used again.
    if parts_max == 1 and not isinstance(body.obj, bytes):
        body = memoryview(bytes(body))
    return Message(msg_type, topic, link, sec * NANOS + nsec, seq_number, body, parts_max)
