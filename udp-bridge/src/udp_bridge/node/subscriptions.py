# SPDX-License-Identifier: Apache-2.0
"""From ROS to the bridge: subscriptions that peers request, each with a lease and a rate limit.

A ROS subscription exists exactly as long as a peer holds a lease on it. All methods but `put`
belong to the thread that calls `turn`. Bodies are sent as the CDR that was received; of bodies that
begin with a std_msgs/Header, stamp and frame are read for the datagram's header.
"""

from __future__ import annotations

from collections import deque
from functools import partial
from struct import Struct
from typing import Any, Callable, Deque, Dict, List, NamedTuple, Optional, Protocol, Tuple, TypeVar

from udp_bridge.io.link import Link
from udp_bridge.sender.repair import Mode
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.header import NANOS, BadMessage
from udp_bridge.wire.message import Address, TopicKey
from udp_bridge.wire.typed import typed_prefix
from udp_bridge.wire.types import MSG_TYPES, TYPED, MessageType

from .log import Log
from .slots import Slot, given_back

_Key = TypeVar("_Key")

MAX_SUBSCRIPTIONS = 64
"""Subscriptions, and leases of each, at most: a hostile peer must not fill the ROS graph."""
IDLE_S = 10.0
"""A lease that was not renewed for so long may lose its slot; gateways renew each second."""
MAX_WAIT_NANOS = 100_000_000
"""How long to wait at most when nothing is due: a request may have arrived by then."""
_HEADER = Struct("<iII")
"""sec, nanosec and the size of frame_id, behind the 4 bytes of the encapsulation."""


class Subscription(NamedTuple):
    """A ROS subscription."""

    is_stamped: bool
    """Whether its messages begin with a std_msgs/Header."""
    end: Callable[[], object]


class SubscriptionFactory(Protocol):
    """Makes ROS subscriptions."""

    def type_of(self, topic: str) -> str:
        """Return the full type name of a published topic; empty when there is no publisher."""

    def subscribe(
        self, row: MessageType, topic: str, take: Callable[[bytes], None]
    ) -> Subscription:
        """Have `take` called with the CDR of each message, in the thread of `turn`.

        Raises any exception of ROS.
        """

    def now_nanos(self) -> int:
        """Return ROS time."""

    def get_logger(self) -> Any:
        """Return a logger with `info`, `warning` and `error`."""


class RosSample(NamedTuple):
    """A message of ROS on its way to a peer."""

    link: str
    stamp_nanos: Optional[int]
    """None when the message has no stamp; it then gets the time of sending."""
    body: bytes
    ros_type: str = ""
    """Full name of the type, where it is known."""


def stamped_sample(body: bytes, ros_type: str = "") -> Optional[RosSample]:
    """Return a message that begins with a std_msgs/Header; None if it is too short."""
    if len(body) < 4 + _HEADER.size:
        return None
    sec, nanosec, size = _HEADER.unpack_from(body, 4)
    frame = body[4 + _HEADER.size :][: size - 1].decode("utf-8", "replace")
    return RosSample(frame, sec * NANOS + nanosec, body, ros_type)


class Lease:
    """One peer's lease on one topic: expiry, rate limit, and the sample that waits for its time.

    A rate limit never loses the last message, which may be a stop command: the newest sample is
    held until it is due.
    """

    def __init__(self) -> None:
        self.renewed_nanos = 0
        self._expires_nanos: Optional[int] = None
        self._period_nanos = 0
        self._due_nanos = 0
        self._held: Optional[RosSample] = None

    def renew(self, subscribe: Subscribe, now_nanos: int) -> None:
        """Set expiry and rate anew."""
        self.renewed_nanos = now_nanos
        rate = subscribe.max_rate_hz
        self._period_nanos = int(NANOS / rate) if rate > 0 else 0
        lease_nanos = subscribe.lease_s * NANOS
        self._expires_nanos = now_nanos + lease_nanos if lease_nanos else None

    def has_expired(self, now_nanos: int) -> bool:
        """Return whether the lease has run out."""
        return self._expires_nanos is not None and now_nanos >= self._expires_nanos

    def offer(self, sample: RosSample) -> None:
        """Hold the newest sample until it is due."""
        self._held = sample

    def take(self, now_nanos: int) -> Optional[RosSample]:
        """Return the sample to send now, if there is one."""
        if self._held is None or now_nanos < self._due_nanos:
            return None
        sample, self._held = self._held, None
        self._due_nanos = now_nanos + self._period_nanos
        return sample

    def wait_nanos(self, now_nanos: int) -> int:
        """Return the time until `take` returns a sample, as far as it is known."""
        if self._held is None:
            return MAX_WAIT_NANOS
        return max(0, self._due_nanos - now_nanos)


class LeasedSubscriptions:
    """Subscribes to the topics that peers request and sends them the messages.

    Parameters
    ----------
    ros
        Makes subscriptions; its clock stamps messages without a stamp.
    is_published
        Tells whether the bridge itself publishes a topic.
    is_known
        Tells whether an address may still receive streams.
    repair
        Repair mode of all that is sent.
    on_message
        Called with the topic of each message received and the message, in the thread of `turn`.
    """

    def __init__(
        self,
        ros: SubscriptionFactory,
        *,
        is_published: Callable[[str], bool],
        is_known: Callable[[Address], bool] = lambda _: True,
        repair: Optional[Mode] = None,
        on_message: Callable[[str, RosSample], object] = lambda *_: None,
    ) -> None:
        self.sent = 0
        """Messages handed to the link."""
        self._ros = ros
        self._is_published, self._is_known = is_published, is_known
        self._log = Log(ros.get_logger())
        self._on_message = on_message
        self._repair = repair
        self._requests: Deque[Tuple[Subscribe, str, Address]] = deque(maxlen=1024)
        self._subscriptions: Dict[TopicKey, Subscription] = {}
        self._prefixes: Dict[TopicKey, bytes] = {}  # before the CDR of Typed messages
        self._leases: Dict[TopicKey, Dict[Address, Lease]] = {}
        self._complaints: Dict[TopicKey, str] = {}

    def put(self, subscribe: Subscribe, topic: str, sender: Address) -> None:
        """Queue the request of a peer; from any thread, never blocks."""
        self._requests.append((subscribe, topic, sender))

    @property
    def topics(self) -> List[TopicKey]:
        """Topics that are subscribed to."""
        return list(self._subscriptions)

    def turn(self, link: Link, now_nanos: int) -> float:
        """Do what is due; return the seconds until something else may be.

        Parameters
        ----------
        link
            Sends the messages.
        now_nanos
            A monotonic clock.
        """
        while self._requests:
            self._serve(link, *self._requests.popleft(), now_nanos)
        wait_nanos = MAX_WAIT_NANOS
        for key, sender, lease in self._all_leases():
            if lease.has_expired(now_nanos):
                self._end(key, sender, "the lease ran out")
                continue
            if not self._is_known(sender):
                self._end(key, sender, "the subscriber's address is no longer validated")
                continue
            sample = lease.take(now_nanos)
            if sample is not None:
                self._send(link, key, sender, sample)
            wait_nanos = min(wait_nanos, lease.wait_nanos(now_nanos))
        return wait_nanos / NANOS

    def _all_leases(self) -> List[Tuple[TopicKey, Address, Lease]]:
        return [
            (key, sender, lease)
            for key, leases in self._leases.items()
            for sender, lease in leases.items()
        ]

    def _serve(
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
                link.enable_repair(*key, self._repair)
        leases = self._leases.setdefault(key, {})
        if sender not in leases and len(leases) >= MAX_SUBSCRIPTIONS:
            slots = [_slot(peer, {peer: lease}) for peer, lease in leases.items()]
            slot = given_back(slots, sender[0], now_nanos / NANOS, idle_s=IDLE_S)
            if slot is None:
                return
            del leases[slot.key]
        leases.setdefault(sender, Lease()).renew(subscribe, now_nanos)

    def _has_freed_slot(self, sender: Address, now_nanos: int) -> bool:
        """End the subscription whose slot a sender may take; return whether there is one."""
        slots = [_slot(key, leases) for key, leases in self._leases.items()]
        slot = given_back(slots, sender[0], now_nanos / NANOS, idle_s=IDLE_S)
        if slot is not None:
            for peer in list(self._leases[slot.key]):
                self._end(slot.key, peer, "replaced by another subscription")
        return slot is not None

    def _subscribe(self, row: MessageType, topic: str, sender: Address, now_nanos: int) -> str:
        """Subscribe; return the reason of a failure, or an empty text."""
        if self._is_published(topic):
            return f"{row.name} comes from the bridge itself"
        is_full = len(self._subscriptions) >= MAX_SUBSCRIPTIONS
        if is_full and not self._has_freed_slot(sender, now_nanos):
            return f"there are {MAX_SUBSCRIPTIONS} subscriptions, which is the most"
        key = (row.number, topic)
        try:
            if row.number == TYPED:
                if not (ros_type := self._ros.type_of(topic)):
                    return "no publisher, so its type is not known yet"
                row = row._replace(ros_type=ros_type)
                self._prefixes[key] = typed_prefix(ros_type)
            take = partial(self._take, key, str(row.ros_type))
            self._subscriptions[key] = self._ros.subscribe(row, topic, take)
        except Exception as error:
            return " ".join(str(error).split())
        self._log.info(f"{topic}: {row.ros_type} subscribed to for {sender[0]}:{sender[1]}")
        return ""

    def _end(self, key: TopicKey, sender: Address, why: str) -> None:
        leases = self._leases.get(key, {})
        if leases.pop(sender, None) is None or leases:
            return
        del self._leases[key]
        self._subscriptions.pop(key).end()
        self._prefixes.pop(key, None)
        self._log.info(f"{key[1]}: no longer subscribed to: {why}")

    def _take(self, key: TopicKey, ros_type: str, body: bytes) -> None:
        sample: Optional[RosSample] = RosSample("", None, body, ros_type)
        if self._subscriptions[key].is_stamped:
            sample = stamped_sample(body, ros_type)
        if sample is None:
            return
        prefix = self._prefixes.get(key, b"")
        for lease in self._leases.get(key, {}).values():
            lease.offer(sample._replace(body=prefix + body) if prefix else sample)
        self._on_message(key[1], sample)

    def _send(self, link: Link, key: TopicKey, to: Address, sample: RosSample) -> None:
        stamp_nanos = sample.stamp_nanos
        if stamp_nanos is None:
            stamp_nanos = self._ros.now_nanos()
        try:
            link.send(*key, sample.link, stamp_nanos, sample.body, to)
            self.sent += 1
        except BadMessage as error:  # TooLarge is a BadMessage
            if self._complaints.get(key) != str(error):
                self._complaints[key] = str(error)
                self._log.error(f"{key[1]}: can't be sent: {error}")


def _slot(key: _Key, leases: Dict[Address, Lease]) -> Slot[_Key]:
    """Return the slot that some leases hold together: that of the peer that renewed last."""
    peer, lease = max(leases.items(), key=lambda row: row[1].renewed_nanos)
    return Slot(key, peer[0], lease.renewed_nanos / NANOS)
