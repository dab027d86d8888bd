# SPDX-License-Identifier: Apache-2.0
"""From the bridge to ROS: a bounded queue for each topic, and the thread that publishes.

Slow operations of ROS (creating a publisher, a large body, a stalled subscriber) happen behind the
queue. They cost queued messages, which are counted, and no datagrams. The receiving thread itself
publishes only on a topic whose last message was quick and whose queue is empty: waking another
thread takes longer. Bodies are published as bytes; nothing here decodes them.
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
from .topic_qos import TopicQos, publisher_qos

MAX_TOPICS = 256
"""Publishers at most, so that a hostile sender can't fill the ROS graph; see `slots`."""
IDLE_S = 10.0
"""A topic without messages for so long may lose its slot to another topic."""
QUICK_SECONDS = 0.002
"""A topic whose last message took longer uses the queue until a message takes less."""
OnResult = Callable[[Message, Address, bool], None]
Publish = Callable[[Buffer], object]
"""Publishes the body of a message; raises any exception of ROS."""
_ENCAPSULATION = b"\x00\x01"
"""First bytes of little-endian CDR; any other body would break subscribers."""


class _NotPublishable(Refused):
    """ROS can't take a message that the bridge received whole."""


class Publication(NamedTuple):
    """A ROS publisher."""

    publish: Publish
    end: Callable[[], object]


class PublisherFactory(Protocol):
    """Makes ROS publishers."""

    def publisher(self, row: MessageType, topic: str, qos: TopicQos) -> Publication:
        """Return a publisher of a topic; raises any exception of ROS."""

    def get_logger(self) -> Any:
        """Return a logger with `info`, `warning` and `error`."""


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
        """The owner of the slot: the first known sender, or else the first sender."""
        self.used_s = 0.0
        self.row = row
        self.topic = topic
        self.offset = offset
        self.qos = publisher_qos(row.name, topic, row.ros_type)
        self.waiting: Deque[Tuple[Message, Address]] = deque()
        self.publication: Optional[Publication] = None
        self.refused_as = ""
        """Why ROS can't take messages of this topic; empty when it can."""
        self.has_warned = False
        self.is_publishing = False
        self.took_s = math.inf
        """Time that ROS took to publish the last message."""
        self.latest: Dict[Address, bytes] = {}
        """Last body of each sender on a topic of repeated messages."""

    def is_quick(self) -> bool:
        """Return whether the receiving thread may publish the next message itself."""
        return (
            self.took_s <= QUICK_SECONDS
            and not self.waiting
            and not self.is_publishing
            and not self.qos.is_repeated
        )

    def is_new(self, body: bytes, sender: Address) -> bool:
        """Return whether a repeated body changed, and remember it.

        The sender repeats it for late receivers; in ROS, latching does that.
        """
        if self.latest.get(sender) == body:
            return False
        if len(self.latest) >= self.qos.depth:
            self.latest.clear()
        self.latest[sender] = body
        return True

    def is_full(self) -> bool:
        """Return whether the oldest queued message must be dropped."""
        if len(self.waiting) <= self.qos.waiting:
            return False
        return sum(len(message.body) for message, _ in self.waiting) > self.qos.waiting_bytes


class PublishQueue:
    """Publishes messages on a thread of its own.

    Parameters
    ----------
    ros
        Makes publishers; its logger reports the first message of each topic.
    on_result
        Called once with each message, its sender, and whether it was published, by `put` or by
        the publishing thread.
    is_known
        Returns whether the address of a sender is authentic.
    """

    def __init__(
        self,
        ros: PublisherFactory,
        on_result: OnResult = lambda *_: None,
        is_known: Callable[[Address], bool] = lambda _: True,
    ) -> None:
        self._published_here = self._published_behind = 0  # each is counted by one thread
        self.dropped = 0
        """Messages that a newer message of their topic displaced from the queue."""
        self.refusals: Dict[str, int] = {}
        """Messages that ROS can't take, by reason: `type_name` (a Typed body without a valid one),
        `type_not_installed`, `no_publisher`, `no_slot`, `not_cdr` and `not_published`."""
        self._ros = ros
        self._log = Log(ros.get_logger())
        self._on_result, self._is_known = on_result, is_known
        self._lock = threading.Lock()  # guards channels and their queues
        self._channels: Dict[Tuple[int, str, str], _Channel] = {}
        # The channel of each queued message; SimpleQueue wakes its reader fastest.
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
        """Publish a message or queue it; from one thread, which is never blocked for long.

        Parameters
        ----------
        message
            A message of a ROS type; an empty topic means the type's default.
        sender
            Its source.
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
                    self._on_result(*channel.waiting.popleft(), False)
                    self.dropped += 1
                else:
                    self._turn.put(channel)
                return
        if self._publish(channel, message, sender):
            self._published_here += 1

    def prepare(self, message: Message, sender: Address) -> bool:
        """Create the publisher of a message's topic; return whether it is new."""
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
            self._warn(channel, error)
        return True

    def put_all(
        self, messages: Sequence[Message], sender: Address, then: Callable[[], object]
    ) -> None:
        """Publish messages in their order on the publishing thread, then call `then` there."""

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
        """Return whether the bridge publishes a topic."""
        with self._lock:
            return any(channel.topic == topic for channel in self._channels.values())

    def close(self) -> None:
        """End the thread; queued messages are not published."""
        self._is_closed = True
        self._turn.put(None)
        self._thread.join()

    def _channel(self, message: Message, sender: Address) -> _Channel:
        """Return the channel of a message, which may be a new one.

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
            if len(self._channels) >= MAX_TOPICS and not self._has_freed_slot(sender, now_s):
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

    def _has_freed_slot(self, sender: Address, now_s: float) -> bool:
        """End the channel whose slot a sender may take; return whether there is one."""
        slots = [
            Slot(key, self._host(channel.sender), channel.used_s)
            for key, channel in self._channels.items()
        ]
        slot = given_back(slots, self._host(sender), now_s, idle_s=IDLE_S)
        if slot is not None:
            channel = self._channels.pop(slot.key)
            channel.refused_as = "no_slot"  # for messages that are still queued
            self._turn.put(partial(self._end, channel))
        return slot is not None

    def _host(self, sender: Address) -> str:
        return sender[0] if self._is_known(sender) else UNKNOWN

    def _end(self, channel: _Channel) -> None:
        publication, channel.publication = channel.publication, None
        if publication is not None:
            publication.end()
            self._log.info(f"{channel.topic}: no longer published: replaced by another topic")

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
        """Return whether a message was handed to ROS: not when unchanged, and not when refused."""
        if channel.refused_as:
            self._refuse(channel.refused_as, message, sender)
            return False
        try:
            publication = channel.publication
            if publication is None:
                publication = channel.publication = self._publisher(channel, message, sender)
            began_s = time.monotonic()
            is_new = not channel.qos.is_repeated or channel.is_new(bytes(message.body), sender)
            if is_new:
                body = message.body
                publication.publish(memoryview(body)[channel.offset :] if channel.offset else body)
                channel.took_s = time.monotonic() - began_s
        except Exception as error:
            self._warn(channel, error)
            self._refuse(channel.refused_as or "not_published", message, sender)
            return False
        self._on_result(message, sender, True)
        return is_new

    def _warn(self, channel: _Channel, error: Exception) -> None:
        if channel.publication is None:
            is_missing = isinstance(error, NotInstalled)
            channel.refused_as = "type_not_installed" if is_missing else "no_publisher"
        if not channel.has_warned:
            channel.has_warned = True
            reason = " ".join(str(error).split())
            self._log.error(f"{channel.topic}: {channel.row.ros_type} can't be published: {reason}")

    def _refuse(self, reason: str, message: Message, sender: Address) -> None:
        self.refusals[reason] = self.refusals.get(reason, 0) + 1
        self._on_result(message, sender, False)

    def _publisher(self, channel: _Channel, message: Message, sender: Address) -> Publication:
        publication = self._ros.publisher(channel.row, channel.topic, channel.qos)
        frame = f", frame {message.link}" if message.link else ""
        self._log.info(
            f"{channel.topic}: {channel.row.ros_type} from {sender[0]}:{sender[1]}{frame}"
        )
        return publication
