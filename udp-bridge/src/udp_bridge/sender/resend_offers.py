# SPDX-License-Identifier: Apache-2.0
"""When a sender offers which topic: at once when a message is out, then ever less often.

Only what was sent altogether is offered, and until it is stale; so the receiver learns of lost
ends, and needs no clock of its own for asking again. What is kept is `resend`'s.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple, Optional, Tuple

from udp_bridge.wire.message import Message
from udp_bridge.wire.repair import Offer
from udp_bridge.wire.types import RESEND

FIRST_STEP_NANOS = 1_000_000
"""The offer of a message of several parts is repeated after this, then after twice as long..."""
SMALL_STEP_NANOS = 5_000_000
"""...that of a single-part message, of which there are many, after this. These are not offered
more often than that either."""
LONGEST_STEP_NANOS = 20_000_000
"""Offers are repeated at least this often, until their message is stale."""


class Offered(NamedTuple):
    """What is said of a topic's newest message."""

    message: Message
    """With its number; its body does not matter here."""
    parts_max: int
    limit_nanos: int
    stale_nanos: int
    """From then on it is not offered any more."""

    def datagram(self) -> bytes:
        """Return the offer."""
        limit_ms = -(-self.limit_nanos // 1_000_000)
        body = Offer(self.message.msg_type, self.parts_max, limit_ms).pack()
        return self.message._replace(msg_type=RESEND, link="").header().pack() + body


class _Schedule:
    """When a topic is offered next."""

    __slots__ = ("due_nanos", "offered", "step_nanos", "told_nanos")

    def __init__(self, offered: Offered, now_nanos: int) -> None:
        self.offered = offered
        self.due_nanos = now_nanos
        self.told_nanos = now_nanos - SMALL_STEP_NANOS
        self.step_nanos = FIRST_STEP_NANOS


class Offers:
    """The offers to one destination, one a topic."""

    def __init__(self) -> None:
        self._topics: OrderedDict[Tuple[int, str], _Schedule] = OrderedDict()

    def put(self, offered: Offered, now_nanos: int) -> None:
        """Offer a topic's newest message from now on, in place of the one before."""
        key = offered.message.msg_type, offered.message.topic
        schedule = self._topics.pop(key, None)
        is_small = offered.parts_max == 1
        if schedule is None:
            schedule = _Schedule(offered, now_nanos)
        elif is_small and now_nanos - schedule.told_nanos < SMALL_STEP_NANOS:
            schedule.due_nanos = schedule.told_nanos + SMALL_STEP_NANOS
        else:
            schedule.due_nanos = now_nanos
        schedule.offered = offered
        schedule.step_nanos = SMALL_STEP_NANOS if is_small else FIRST_STEP_NANOS
        self._topics[key] = schedule

    def hasten(self, key: Tuple[int, str, int], due_nanos: int) -> None:
        """Offer a message of several parts then, and from then on as often as in the beginning.

        For what is sent again of it may be lost again, and who asked for it has no clock of its
        own. One that is not its topic's newest any more is not offered.
        """
        msg_type, topic, seq_number = key
        schedule = self._topics.get((msg_type, topic))
        if schedule is None or schedule.offered.message.seq_number != seq_number:
            return
        if schedule.offered.parts_max > 1:
            schedule.due_nanos, schedule.step_nanos = due_nanos, FIRST_STEP_NANOS

    def take(self, now_nanos: int) -> Optional[bytes]:
        """Return an offer that is due, as a whole datagram."""
        for key, schedule in self._topics.items():
            if schedule.due_nanos > now_nanos:
                continue
            if now_nanos > schedule.offered.stale_nanos:
                del self._topics[key]
                return self.take(now_nanos)
            schedule.told_nanos = now_nanos
            schedule.due_nanos = now_nanos + schedule.step_nanos
            schedule.step_nanos = min(2 * schedule.step_nanos, LONGEST_STEP_NANOS)
            return schedule.offered.datagram()
        return None

    @property
    def next_nanos(self) -> Optional[int]:
        """When an offer is due; None when there is none."""
        if not self._topics:
            return None
        return min(schedule.due_nanos for schedule in self._topics.values())
