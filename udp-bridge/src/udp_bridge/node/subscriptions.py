# SPDX-License-Identifier: Apache-2.0
"""From ROS to the bridge: subscriptions that peers asked for, as long as their leases last.

Rule: a subscription lives exactly as long as somebody wants it. All but `put` belongs to the
thread that calls `turn`. Bodies go out as the CDR that came in; of those that begin with a
std_msgs/Header, stamp and frame are read, as the datagram's header has to repeat them.
"""

from __future__ import annotations

from collections import deque
from functools import partial
from struct import Struct
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Protocol, Tuple, TypeVar

from udp_bridge.io.link import Link
from udp_bridge.sender.repair import Mode
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.header import BadMessage
from udp_bridge.wire.message import Address
from udp_bridge.wire.typed import typed_prefix
from udp_bridge.wire.types import MSG_TYPES, TYPED, MessageType

from .leases import MAX_WAIT_NANOS, NANOS, Lease, Outgoing
from .log import Log
from .slots import Slot, given_back

Key = Tuple[int, str]
"""A msg_type and a topic."""
_Key = TypeVar("_Key")

MAX_SUBSCRIPTIONS = 64
"""Subscriptions, and peers of each, at most: a hostile peer must not fill the ROS graph; see
`slots`."""
IDLE_S = 10.0
"""What was not asked for again for so long gives its place to another; gateways do each second."""
_HEADER = Struct("<iII")
"""sec, nanosec and the size of frame_id, behind the 4 bytes of the encapsulation."""


class Subscription(NamedTuple):
    """A topic that is subscribed to."""

    is_stamped: bool
    """Whether its messages begin with a std_msgs/Header."""
    end: Callable[[], object]


class Ros(Protocol):
    """What an inlet needs of ROS."""

    def type_of(self, topic: str) -> str:
        """Return the full type name of a topic that is published; empty where nobody does."""

    def subscribe(
        self, row: MessageType, topic: str, take: Callable[[bytes], None]
    ) -> Subscription:
        """Have `take` called with the CDR of each message, in the thread of `turn`.

        Raises whatever ROS says against it.
        """

    def now_nanos(self) -> int:
        """Return the time as ROS has it."""

    def get_logger(self) -> Any:
        """Return what has `info`, `warning` and `error`."""


class LeasedSubscriptions:
    """Subscribes to what peers want and sends it to them.

    Parameters
    ----------
    ros
        Where subscriptions are made; its clock stamps what has no stamp of its own.
    is_published
        Tells whether a topic is one that the bridge itself fills.
    is_known
        Tells whether an address may still be sent streams.
    repair
        How what is lost of all that is sent is made good.
    heard
        Called with the topic of each message that came, in the thread of `turn`.
    """

    def __init__(
        self,
        ros: Ros,
        *,
        is_published: Callable[[str], bool],
        is_known: Callable[[Address], bool] = lambda _: True,
        repair: Optional[Mode] = None,
        heard: Callable[[str], object] = lambda _: None,
    ) -> None:
        self.sent = 0
        """Messages handed to the link."""
        self._ros = ros
        self._is_published, self._is_known = is_published, is_known
        self._log = Log(ros.get_logger())
        self._heard = heard
        self._repair = repair
        self._asked: Deque[Tuple[Subscribe, str, Address]] = deque(maxlen=1024)
        self._subscriptions: Dict[Key, Subscription] = {}
        self._prefixes: Dict[Key, bytes] = {}  # before the CDR of Typed messages
        self._wishes: Dict[Key, Dict[Address, Lease]] = {}
        self._complaints: Dict[Key, str] = {}

    def put(self, subscribe: Subscribe, topic: str, sender: Address) -> None:
        """Hand over what a peer asked for; from any thread, never blocks."""
        self._asked.append((subscribe, topic, sender))

    @property
    def topics(self) -> List[Key]:
        """What is subscribed to."""
        return list(self._subscriptions)

    def turn(self, link: Link, now_nanos: int) -> float:
        """Do what is due; return the seconds until something else may be.

        Parameters
        ----------
        link
            Where messages go.
        now_nanos
            A clock that never goes back.
        """
        while self._asked:
            self._answer(link, *self._asked.popleft(), now_nanos)
        wait_nanos = MAX_WAIT_NANOS
        for key, sender, wish in self._all_wishes():
            if wish.is_over(now_nanos):
                self._end(key, sender, "the lease ran out")
                continue
            if not self._is_known(sender):
                self._end(key, sender, "the subscriber's address is not validated any more")
                continue
            outgoing = wish.take(now_nanos)
            if outgoing is not None:
                self._send(link, key, sender, outgoing)
            wait_nanos = min(wait_nanos, wish.wait_nanos(now_nanos))
        return wait_nanos / NANOS

    def _all_wishes(self) -> List[Tuple[Key, Address, Lease]]:
        return [
            (key, sender, wish)
            for key, wishes in self._wishes.items()
            for sender, wish in wishes.items()
        ]

    def _answer(
        self, link: Link, subscribe: Subscribe, topic: str, sender: Address, now_nanos: int
    ) -> None:
        row = MSG_TYPES[subscribe.wanted_type]
        key = (row.number, topic or row.default_topic)
        if not subscribe.action:
            self._end(key, sender, "unsubscribed")
            return
        if key not in self._subscriptions:
            complaint = self._subscribe(row, key[1], sender, now_nanos)
            if complaint and self._complaints.get(key) != complaint:
                if len(self._complaints) < MAX_SUBSCRIPTIONS:
                    self._complaints[key] = complaint
                    self._log.warning(f"{key[1]}: not subscribed to: {complaint}")
            if complaint:
                return
            if self._repair is not None:
                link.mend(*key, self._repair)
        wishes = self._wishes.setdefault(key, {})
        if sender not in wishes and len(wishes) >= MAX_SUBSCRIPTIONS:
            slots = [_slot(peer, {peer: wish}) for peer, wish in wishes.items()]
            slot = given_back(slots, sender[0], now_nanos / NANOS, idle_s=IDLE_S)
            if slot is None:
                return
            del wishes[slot.key]
        wishes.setdefault(sender, Lease()).renew(subscribe, now_nanos)

    def _has_given_back(self, sender: Address, now_nanos: int) -> bool:
        """End the subscription that gives its place to one of a sender, if there is any."""
        slots = [_slot(key, wishes) for key, wishes in self._wishes.items()]
        slot = given_back(slots, sender[0], now_nanos / NANOS, idle_s=IDLE_S)
        if slot is not None:
            for peer in list(self._wishes[slot.key]):
                self._end(slot.key, peer, "its place was given to another")
        return slot is not None

    def _subscribe(self, row: MessageType, topic: str, sender: Address, now_nanos: int) -> str:
        """Subscribe; return why it can't be done, or nothing."""
        if self._is_published(topic):
            return f"{row.name} comes from the bridge itself"
        is_full = len(self._subscriptions) >= MAX_SUBSCRIPTIONS
        if is_full and not self._has_given_back(sender, now_nanos):
            return f"there are {MAX_SUBSCRIPTIONS} subscriptions, which is the most"
        key = (row.number, topic)
        try:
            if row.number == TYPED:
                if not (ros_type := self._ros.type_of(topic)):
                    return "nobody publishes it, so its type is not known yet"
                row = row._replace(ros_type=ros_type)
                self._prefixes[key] = typed_prefix(ros_type)
            self._subscriptions[key] = self._ros.subscribe(row, topic, partial(self._take, key))
        except Exception as error:
            return " ".join(str(error).split())
        asker = f"{sender[0]}:{sender[1]}"
        self._log.info(f"{topic}: {row.ros_type} subscribed to for {asker}")
        return ""

    def _end(self, key: Key, sender: Address, why: str) -> None:
        wishes = self._wishes.get(key, {})
        if wishes.pop(sender, None) is None or wishes:
            return
        del self._wishes[key]
        self._subscriptions.pop(key).end()
        self._prefixes.pop(key, None)
        self._log.info(f"{key[1]}: no longer subscribed to: {why}")

    def _take(self, key: Key, body: bytes) -> None:
        if not self._subscriptions[key].is_stamped:
            self._offer(key, Outgoing("", None, body))
            return
        if len(body) < 4 + _HEADER.size:
            return
        sec, nanosec, size = _HEADER.unpack_from(body, 4)
        frame = body[4 + _HEADER.size :][: size - 1].decode("utf-8", "replace")
        self._offer(key, Outgoing(frame, sec * NANOS + nanosec, body))

    def _offer(self, key: Key, outgoing: Outgoing) -> None:
        if prefix := self._prefixes.get(key):
            outgoing = outgoing._replace(body=prefix + outgoing.body)
        for wish in self._wishes.get(key, {}).values():
            wish.offer(outgoing)
        self._heard(key[1])

    def _send(self, link: Link, key: Key, to: Address, outgoing: Outgoing) -> None:
        stamp_nanos = outgoing.stamp_nanos
        if stamp_nanos is None:
            stamp_nanos = self._ros.now_nanos()
        try:
            link.send(*key, outgoing.link, stamp_nanos, outgoing.body, to)
            self.sent += 1
        except BadMessage as error:  # TooLarge is one, too
            if self._complaints.get(key) != str(error):
                self._complaints[key] = str(error)
                self._log.error(f"{key[1]}: can't be sent: {error}")


def _slot(key: _Key, wishes: Dict[Address, Lease]) -> Slot[_Key]:
    """Return the slot that wishes of peers hold together: that of whoever wished last."""
    peer, wish = max(wishes.items(), key=lambda row: row[1].renewed_nanos)
    return Slot(key, peer[0], wish.renewed_nanos / NANOS)
