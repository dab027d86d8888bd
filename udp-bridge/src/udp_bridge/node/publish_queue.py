# SPDX-License-Identifier: Apache-2.0
"""From the bridge to ROS: a bounded queue for each topic, and the thread that publishes.

Rule: whatever ROS makes slow (creating a publisher, a large body, a subscriber that stalls) is done
behind a queue; it costs messages of these queues, which are counted, and no datagrams. The thread
that receives publishes itself only messages of a topic whose last one was quick and for which
nothing waits: to wake another thread takes longer. Bodies are published as the bytes that they are;
nothing here decodes them.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from functools import partial
from queue import SimpleQueue
from typing import (
    Any,
    Callable,
    Deque,
    Dict,
    NamedTuple,
    Optional,
    Protocol,
    Sequence,
    Tuple,
    Union,
)

from udp_bridge.wire.header import Buffer, Refused
from udp_bridge.wire.message import Address, Message
from udp_bridge.wire.typed import parse_typed
from udp_bridge.wire.types import MSG_TYPES, TYPED, MessageType

from .log import Log
from .message_class import NotInstalled
from .slots import UNKNOWN, Slot, given_back
from .topic_qos import TopicQos, published

MAX_TOPICS = 256
"""Publishers at most, so that a hostile sender can't fill the ROS graph; see `slots`."""
IDLE_S = 10.0
"""A topic on which nothing came for so long gives its place to another one."""
QUICK_SECONDS = 0.002
"""A topic of which a message took longer goes by the queue until one takes less there."""
OnFate = Callable[[Message, Address, bool], None]
Publish = Callable[[Buffer], object]
"""Publishes the body of a message, and raises whatever when it can't."""
_ENCAPSULATION = b"\x00\x01"
"""How little-endian CDR begins; a body of anything else would break its subscribers."""


class _NotPublishable(Refused):
    """ROS can't take a message that the bridge has received whole."""


class Publication(NamedTuple):
    """A publisher of ROS."""

    publish: Publish
    end: Callable[[], object]


class Ros(Protocol):
    """What an outlet needs of ROS."""

    def publisher(self, row: MessageType, topic: str, delivery: TopicQos) -> Publication:
        """Return a publisher of a topic, or raise whatever ROS says against it."""

    def get_logger(self) -> Any:
        """Return what has `info`, `warning` and `error`."""


class _Channel:
    """One topic of one ROS type: its queue, and its publisher once there is one.

    Parameters
    ----------
    row
        The type; of a Typed message the row names the ROS type of the body.
    offset
        Where the CDR begins in each body.
    """

    def __init__(self, row: MessageType, topic: str, sender: Address, offset: int = 0) -> None:
        self.sender = sender
        """Whose it is: the first known sender, or else the first one."""
        self.used_s = 0.0
        self.row = row
        self.topic = topic
        self.offset = offset
        self.delivery = published(row.name, topic)
        self.waiting: Deque[Tuple[Message, Address]] = deque()
        self.publication: Optional[Publication] = None
        self.refused_as = ""
        """Why ROS can't take messages of this topic; empty when it can."""
        self.has_complained = False
        self.is_publishing = False
        self.took_s = math.inf
        """How long ROS took with the last message that it was given."""
        self.latest: Dict[Address, bytes] = {}
        """Of a latched topic: what each sender had published last."""

    def is_quick(self) -> bool:
        """Tell whether a message may be published at once, before any other of its topic."""
        return (
            self.took_s <= QUICK_SECONDS
            and not self.waiting
            and not self.is_publishing
            and not self.delivery.is_latched
        )

    def is_news(self, body: bytes, sender: Address) -> bool:
        """Tell whether ROS lacks a body of a latched topic, and take note of it.

        The sender repeats it for receivers that come late; ROS does that for ours.
        """
        if self.latest.get(sender) == body:
            return False
        if len(self.latest) >= self.delivery.depth:
            self.latest.clear()
        self.latest[sender] = body
        return True

    def is_full(self) -> bool:
        """Tell whether the oldest message that waits has to give way."""
        if len(self.waiting) <= self.delivery.waiting:
            return False
        return sum(len(message.body) for message, _ in self.waiting) > self.delivery.waiting_bytes


class PublishQueue:
    """Publishes messages on a thread of its own.

    Parameters
    ----------
    ros
        Where publishers are created; its logger tells of first arrivals.
    on_fate
        Called once with each message, its sender, and whether it was published: `put` tells of
        those that are not taken and the thread that publishes of the rest.
    is_known
        Tells whether the address of a sender can't be forged.
    """

    def __init__(
        self,
        ros: Ros,
        on_fate: OnFate = lambda *_: None,
        is_known: Callable[[Address], bool] = lambda _: True,
    ) -> None:
        self._published_here = self._published_behind = 0  # each is counted by one thread
        self.dropped = 0
        """Messages that a newer one of their topic pushed out before they were published."""
        self.refusals: Dict[str, int] = {}
        """Messages that ROS can't take, by reason: `type_name` (a Typed body without a valid one),
        `type_not_installed`, `no_publisher`, `no_slot`, `not_cdr` and `not_published`."""
        self._ros = ros
        self._log = Log(ros.get_logger())
        self._on_fate, self._is_known = on_fate, is_known
        self._lock = threading.Lock()  # guards channels and what waits in them
        self._channels: Dict[Tuple[int, str, str], _Channel] = {}
        # Of each message that waits, its channel; a queue of C wakes its reader soonest.
        self._turn: SimpleQueue[Union[_Channel, Callable[[], object], None]] = SimpleQueue()
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="publish", daemon=True)
        self._thread.start()

    @property
    def published(self) -> int:
        """Messages handed to ROS."""
        return self._published_here + self._published_behind

    @property
    def topic_count(self) -> int:
        """Topics that have a publisher."""
        return sum(channel.publication is not None for channel in list(self._channels.values()))

    @property
    def refused(self) -> int:
        """Messages that ROS can't take."""
        return sum(self.refusals.values())

    def put(self, message: Message, sender: Address) -> None:
        """Publish a message, or queue it for that; from one thread, which is hardly held up.

        Parameters
        ----------
        message
            One of a ROS type, as it came; an empty topic means the type's default.
        sender
            Where it came from.
        """
        with self._lock:
            try:
                channel = self._channel(message, sender)
            except Refused as refused:
                self._refuse(refused.reason, message, sender)
                return
            if not channel.is_quick():
                channel.waiting.append((message, sender))
                if channel.is_full():
                    self._on_fate(*channel.waiting.popleft(), False)
                    self.dropped += 1
                else:
                    self._turn.put(channel)
                return
        if self._publish(channel, message, sender):
            self._published_here += 1

    def prepare(self, message: Message, sender: Address) -> bool:
        """Have a publisher for messages like this one; return whether it is new."""
        try:
            with self._lock:
                channel = self._channel(message, sender)
        except Refused:
            return False
        if channel.publication is not None:
            return False
        try:
            channel.publication = self._publisher(channel, message, sender)
        except Exception as error:
            self._complain(channel, error)
        return True

    def put_all(
        self, messages: Sequence[Message], sender: Address, then: Callable[[], object]
    ) -> None:
        """Publish all of these in their order, behind the queue, and call `then` on its thread."""

        def publish() -> None:
            for message in messages:
                try:
                    with self._lock:
                        channel = self._channel(message, sender)
                except Refused as refused:
                    self._refuse(refused.reason, message, sender)
                else:
                    self._published_behind += self._publish(channel, message, sender)
            then()

        self._turn.put(publish)

    def publishes(self, topic: str) -> bool:
        """Tell whether messages of the bridge go out on this topic."""
        with self._lock:
            return any(channel.topic == topic for channel in self._channels.values())

    def close(self) -> None:
        """End the thread; what waits is not published."""
        self._is_closed = True
        self._turn.put(None)
        self._thread.join()

    def _channel(self, message: Message, sender: Address) -> _Channel:
        """Return the channel of a message, a new one perhaps.

        Raises
        ------
        Refused
            When ROS can't take the message.
        """
        row, offset = MSG_TYPES[message.msg_type], 0
        if row.number == TYPED:
            ros_type, offset = parse_typed(message.body)
            row = row._replace(ros_type=ros_type)
        topic = message.topic or row.default_topic
        key = row.number, str(row.ros_type), topic
        channel = self._channels.get(key)
        now_s = time.monotonic()
        if channel is None:
            if len(self._channels) >= MAX_TOPICS and not self._has_given_back(sender, now_s):
                raise _NotPublishable("no_slot")
            channel = self._channels[key] = _Channel(row, topic, sender, offset)
        elif sender != channel.sender and not self._is_known(channel.sender):
            channel.sender = sender
        channel.used_s = now_s
        if channel.refused_as:
            raise _NotPublishable(channel.refused_as)
        if message.body[offset : offset + 2] != _ENCAPSULATION:
            raise _NotPublishable("not_cdr")
        return channel

    def _has_given_back(self, sender: Address, now_s: float) -> bool:
        """End the channel that gives its place to one of a sender; return whether there is any."""
        slots = [
            Slot(key, self._host(channel.sender), channel.used_s)
            for key, channel in self._channels.items()
        ]
        slot = given_back(slots, self._host(sender), now_s, idle_s=IDLE_S)
        if slot is not None:
            channel = self._channels.pop(slot.key)
            channel.refused_as = "no_slot"  # what waits in it finds no publisher
            self._turn.put(partial(self._end, channel))
        return slot is not None

    def _host(self, sender: Address) -> str:
        return sender[0] if self._is_known(sender) else UNKNOWN

    def _end(self, channel: _Channel) -> None:
        publication, channel.publication = channel.publication, None
        if publication is not None:
            publication.end()
            self._log.info(f"{channel.topic}: no longer published: its place was given to another")

    def _run(self) -> None:
        while (turn := self._turn.get()) is not None and not self._is_closed:
            if not isinstance(turn, _Channel):
                turn()
                continue
            with self._lock:
                turn.is_publishing = True
                message, sender = turn.waiting.popleft()
            self._published_behind += self._publish(turn, message, sender)
            turn.is_publishing = False

    def _publish(self, channel: _Channel, message: Message, sender: Address) -> bool:
        """Return whether a message was handed to ROS; it is not when ROS has it or refuses it."""
        if channel.refused_as:
            self._refuse(channel.refused_as, message, sender)
            return False
        try:
            publication = channel.publication
            if publication is None:
                publication = channel.publication = self._publisher(channel, message, sender)
            began_s = time.monotonic()
            is_news = not channel.delivery.is_latched or channel.is_news(
                bytes(message.body), sender
            )
            if is_news:
                body = message.body
                publication.publish(memoryview(body)[channel.offset :] if channel.offset else body)
                channel.took_s = time.monotonic() - began_s
        except Exception as error:
            self._complain(channel, error)
            self._refuse(channel.refused_as or "not_published", message, sender)
            return False
        self._on_fate(message, sender, True)
        return is_news

    def _complain(self, channel: _Channel, error: Exception) -> None:
        if channel.publication is None:
            is_missing = isinstance(error, NotInstalled)
            channel.refused_as = "type_not_installed" if is_missing else "no_publisher"
        if not channel.has_complained:
            channel.has_complained = True
            reason = " ".join(str(error).split())
            self._log.error(f"{channel.topic}: {channel.row.ros_type} can't be published: {reason}")

    def _refuse(self, reason: str, message: Message, sender: Address) -> None:
        self.refusals[reason] = self.refusals.get(reason, 0) + 1
        self._on_fate(message, sender, False)

    def _publisher(self, channel: _Channel, message: Message, sender: Address) -> Publication:
        publication = self._ros.publisher(channel.row, channel.topic, channel.delivery)
        frame = f", frame {message.link}" if message.link else ""
        self._log.info(
            f"{channel.topic}: {channel.row.ros_type} from {sender[0]}:{sender[1]}{frame}"
        )
        return publication
