# SPDX-License-Identifier: Apache-2.0
"""Gateway: sends messages of the bus to ROS over the link, and publishes messages from ROS.

Messages that cannot be sent or read are counted. The main thread handles messages of the bus, the
receive thread of the link handles those of the wire.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from groundlink.messages.base import (
    BadBusMessage,
    BusMessage,
    Clock,
    Command,
    Reading,
    StreamReport,
    measured_nanos,
)
from groundlink.ros.base import Bases
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.streams import Outgoing, outgoing
from groundlink.scenario import Scenario
from services.gateway.lockstep.reply_mailbox import ReplyMailbox
from udp_bridge.io.link import Link
from udp_bridge.wire import control
from udp_bridge.wire.control import BarrierReply, LinkReport, RunCommand, Subscribe, WorldQuery
from udp_bridge.wire.fragments import TooLarge
from udp_bridge.wire.header import BadMessage as BadHeader
from udp_bridge.wire.header import Refused
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.types import CONTROL, SUBSCRIBE, TYPED

from .missing_readings import MissingReadingCounter
from .reports import PeerReports, peer_counters, with_pushed_out, with_type
from .rmw_zenoh import NoRmwZenohBridge, RmwZenohBridge
from .streams import LATCHED, RosSubscriptions, wire_body, wire_type
from .subscribers import Address, Subscribers, TopicKey

STALE_SLACK_NANOS = 100_000_000
"""A stream may be this much ahead of the newest clock message."""

ToRos = tuple[TopicKey, BusMessage]
"""A message with its wire type and topic."""


class Gateway:
    """Sends a run's streams to ROS and receives messages from there.

    Parameters
    ----------
    publish
        publishes a message from ROS on the bus, by its key.
    on_run_command, on_world_query
        called with each run command and world query of the peer; must not block.
    replies
        gets the messages of the peer in lockstep; None in other runs.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        *,
        peer: Address,
        publish: Callable[[str, BusMessage], object],
        on_run_command: Callable[[RunCommand], object] = lambda command: None,
        on_world_query: Callable[[WorldQuery], object] = lambda query: None,
        replies: ReplyMailbox | None = None,
    ) -> None:
        self.streams: Mapping[str, Outgoing] = {s.key: s for s in outgoing(scenario, run)}
        self._ros_topics = {s.key: (wire_type(s.message), s.topic) for s in self.streams.values()}
        self.typed = {
            topic_key: CODECS[self.streams[key].message].ros_type
            for key, topic_key in self._ros_topics.items()
            if topic_key[0] == TYPED
        }
        """ROS type of the streams that have no number on the wire."""

        self.peer = peer
        self._publish, self._replies = publish, replies
        self._on_run_command, self._on_world_query = on_run_command, on_world_query
        self._scenario = scenario
        self.subscriptions = RosSubscriptions(scenario, run)
        self._has_subscribed = False
        self._bases = Bases(scenario, run)
        # A stream that is not pushed may never be subscribed to, so no rate is expected of it.
        rates = {self._ros_topics[s.key]: s.declared_hz for s in self.streams.values() if s.push}
        for topic, message, declared_hz in self._bases.topics:
            topic_key = wire_type(message), topic
            rates[topic_key] = rates.get(topic_key, 0.0) + declared_hz
        self.topic_keys = frozenset({*self._ros_topics.values(), *rates})
        """Wire type and topic of every stream."""

        self._reports = PeerReports(
            rates,
            stamps_follow_wall=scenario.time.mode == "realtime"
            and scenario.time.epoch_nanos is None
            and scenario.time.factor == 1.0,
        )
        self.latched = frozenset(
            (wire_type(message), topic) for topic, message in self._bases.latched.items()
        )
        """Wire type and topic of what hardly changes and is repeated for late subscribers."""

        self.pushed: tuple[TopicKey, ...] = (*rates, *sorted(self.latched))
        """Wire type and topic of all that is sent without a subscription."""

        self._subscribers = Subscribers(self.topic_keys | self.latched)
        for topic_key in self.pushed:
            self._subscribers.push(topic_key, peer)
        self.newest: dict[str, int] = {}
        """By stream: stamp of the newest message that was sent to ROS."""

        self.missing_readings = MissingReadingCounter(scenario, run)
        self.clock_nanos: int | None = None
        """Stamp of the newest clock message; None before the first."""

        self.native: RmwZenohBridge | NoRmwZenohBridge = NoRmwZenohBridge()
        """Where pushed topics go besides the wire."""

        self.epoch_nanos = 0
        self.episode: int | None = None
        """Episode of the newest clock message."""

        self.counts = dict.fromkeys(("stale", "too_large", "commands", "from_ros", "refused"), 0)

    def forward(self, key: str, message: BusMessage, link: Link) -> list[ToRos]:
        """Send a message of the bus, and the messages derived from it, to all subscribers.

        Returns
        -------
        The messages that were sent to the peer.
        """
        if isinstance(message, Clock):
            self.note_time(message)
        elif self._is_stale(key, measured_nanos(message)):
            self.counts["stale"] += 1
            return []
        self.missing_readings.came(key, measured_nanos(message))
        messages = [(self._ros_topics[key], message)]
        derived = self._bases.receive(key, message)
        messages += [((wire_type(type(m)), topic), m) for topic, m, _ in derived]
        return [
            (topic_key, m)
            for topic_key, m in messages
            if self.peer in self._send(topic_key, m, link)
        ]

    def forward_again(self, messages: Sequence[ToRos], link: Link) -> None:
        """Send messages to the peer again, after it was restarted."""
        for topic_key, message in messages:
            self._send(topic_key, message, link, to=[self.peer])

    def receive_native(self) -> None:
        """Handle messages from ROS that did not come over the wire."""
        for message in self.native.arrived():
            self.take(message)

    def note_time(self, clock: Clock) -> bool:
        """Record the time of the run; return whether an episode has begun."""
        has_begun = clock.episode != self.episode
        if has_begun:
            # Simulation time begins again: earlier stamps are not repetitions.
            self.episode = clock.episode
            self.newest.clear()
            self._bases.restart()
        self.missing_readings.clock(clock)
        self.clock_nanos, self.epoch_nanos = clock.stamp_nanos, clock.epoch_nanos
        return has_begun

    def repeat(self, link: Link) -> None:
        """Send what is repeated every second: subscriptions to ROS topics and static transforms."""
        if self.clock_nanos is None and self._replies is None:
            return
        now = self.clock_nanos or 0  # in lockstep the run begins after the node has replied
        for each in self.subscriptions:
            if each.msg_type in LATCHED and not self._has_subscribed:
                # The node may still serve a predecessor's subscription, and sends latched messages
                # only for a new one.
                link.send(SUBSCRIBE, each.topic, "", now, each.unsubscribe(), to=self.peer)
            link.send(SUBSCRIBE, each.topic, "", now, each.subscribe(), to=self.peer)
        self._has_subscribed = True
        if self.clock_nanos is None:
            return
        # Static messages are stamped with the start of the run, so that repetitions are equal.
        for topic, message, _ in self._bases.still(self.epoch_nanos):
            self._send((wire_type(type(message)), topic), message, link)

    def on_message(self, message: WireMessage, sender: Address) -> None:
        """Handle a message of the wire; called on the link's receive thread."""
        try:
            if message.msg_type == SUBSCRIBE:
                request = Subscribe.parse(message.body)
                now = time.monotonic()
                if not self._subscribers.request(sender, message.topic, request, now):
                    self.counts["refused"] += 1
            elif message.msg_type == CONTROL:
                self._on_control(message, sender)
            elif self._replies is None:
                self.take(message)
            elif sender == self.peer:
                self._replies.put(message)
            else:
                self.counts["refused"] += 1
        except Refused:
            self.counts["refused"] += 1

    def take(self, message: WireMessage) -> tuple[str, BusMessage] | None:
        """Publish a message from ROS on the bus; return it with its key if it could be read."""
        try:
            key, taken = self.subscriptions.read(message, self.clock_nanos)
        except BadBusMessage:
            self.counts["refused"] += 1
            return None
        self._publish(key, taken)
        self.counts["commands" if isinstance(taken, Command) else "from_ros"] += 1
        return key, taken

    def report(
        self, link: Link, dropped: Mapping[str, int] = MappingProxyType({})
    ) -> tuple[list[StreamReport], dict[str, int]]:
        """Return the delivery of each topic to the peer and back, and the gateway's counters.

        Parameters
        ----------
        dropped
            by key: messages that newer ones replaced before they were forwarded.
        """
        came = [(topic, report) for of, topic, _, report in link.arrivals() if of == self.peer]
        rows = self._reports.streams(link.delivery_counts(self.peer), came)
        topics = {key: stream.topic for key, stream in self.streams.items()}
        pushed_out = {topics[key]: count for key, count in dropped.items() if key in topics}
        rows = [with_pushed_out(row, pushed_out) for row in rows]
        rows = [with_type(row, self.typed) for row in rows]
        counts = self.counts | self.missing_readings.counters()
        return rows, counts | peer_counters(self._reports.link)

    def _send(
        self,
        topic_key: TopicKey,
        message: BusMessage,
        link: Link,
        *,
        to: Sequence[Address] | None = None,
    ) -> Sequence[Address]:
        """Send a message to some receivers, or to all subscribers; return to whom."""
        stamp_nanos = measured_nanos(message)
        is_news = to is None
        if to is None:
            to = self._subscribers.receivers(topic_key, stamp_nanos, time.monotonic())
        if not to and not self.native.offers(topic_key):
            return to
        try:
            cdr = to_cdr(message)
        except BadBusMessage:
            self.counts["refused"] += 1
            return ()
        msg_type, topic = topic_key
        frame = getattr(message, "frame", "")
        if isinstance(message, Reading):  # the wire carries the time of the sensor's own clock
            stamp_nanos += message.clock_error_nanos
        if is_news:
            self.native.publish(topic_key, stamp_nanos, cdr)
        body = wire_body(topic_key, message, cdr)
        for receiver in to:
            try:
                link.send(msg_type, topic, frame, stamp_nanos, body, to=receiver)
            except TooLarge:
                self.counts["too_large"] += 1
            except BadHeader:
                self.counts["refused"] += 1
        return to

    def _is_stale(self, key: str, stamp_nanos: int) -> bool:
        """Return whether a stream repeats itself, as after a restart of its sensor.

        A stamp behind the newest one is new if the clock has jumped back, too.
        """
        newest = self.newest.get(key)
        clock = self.clock_nanos
        if newest is not None and stamp_nanos <= newest:
            jumped_back = clock is not None and newest > clock + STALE_SLACK_NANOS
            if not jumped_back:
                return True
        self.newest[key] = stamp_nanos
        return False

    def _on_control(self, message: WireMessage, sender: Address) -> None:
        body = control.parse(message.body)
        if sender != self.peer:
            # Other subscribers may report, but only the peer controls time and the world.
            self.counts["refused"] += isinstance(body, RunCommand | WorldQuery | BarrierReply)
        elif isinstance(body, BarrierReply) and self._replies is not None:
            self._replies.put_reply(body, message.topic)
        elif isinstance(body, RunCommand):
            self._on_run_command(body)
        elif isinstance(body, WorldQuery):
            self._on_world_query(body)
        elif isinstance(body, LinkReport):
            self._reports.link = body
