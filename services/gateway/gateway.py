# SPDX-License-Identifier: Apache-2.0
"""Between the bus and the UDP Bridge: readings out, commands in.

Rule: holds no physics and no sensor; what it cannot carry it counts. Everything here happens on two
threads: the main one takes from the bus, the link's receiving one takes from the wire.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from groundlink.messages.base import (
    BadMessage,
    Clock,
    Command,
    Message,
    Reading,
    StreamReport,
    measured_nanos,
)
from groundlink.ros.base import Bases
from groundlink.ros.cdr import to_cdr
from groundlink.ros.streams import Outgoing, outgoing
from groundlink.scenario import Scenario
from services.gateway.lockstep.reply_mailbox import ReplyMailbox
from udp_bridge.io.link import Link
from udp_bridge.wire import control
from udp_bridge.wire.control import BarrierReply, LinkReport, RunCommand, Subscribe
from udp_bridge.wire.fragments import TooLarge
from udp_bridge.wire.header import BadMessage as BadHeader
from udp_bridge.wire.header import Refused
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.types import CONTROL, SUBSCRIBE

from .missing_readings import MissingReadingCounter
from .reports import PeerReports, peer_counters, with_pushed_out
from .rmw_zenoh import NoRmwZenohBridge, RmwZenohBridge
from .ros_subscriptions import LATCHED, RosSubscriptions
from .streams import wire_type
from .subscribers import Address, Subscribers, TopicKey

STALE_SLACK_NANOS = 100_000_000
"""A stream may be this much ahead of the clock that the gateway has heard."""


ToRos = tuple[TopicKey, Message]
"""A message with its place in ROS."""


class Gateway:
    """A run's door to ROS.

    Parameters
    ----------
    publish
        called with a key and a message when something has come from ROS.
    on_wish
        called when the peer wishes something of the run; must not block.
    words
        where to put what the peer says in lockstep; None where nobody waits for it.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        *,
        peer: Address,
        publish: Callable[[str, Message], object],
        on_wish: Callable[[RunCommand], object] = lambda wish: None,
        words: ReplyMailbox | None = None,
    ) -> None:
        self.streams: Mapping[str, Outgoing] = {s.key: s for s in outgoing(scenario, run)}
        self._place_in_ros = {s.key: (wire_type(s.message), s.topic) for s in self.streams.values()}
        self.peer = peer
        self._publish, self._on_wish, self._words = publish, on_wish, words
        self._scenario = scenario
        self.incoming = RosSubscriptions(scenario, run)
        self._has_wished = False
        self._bases = Bases(scenario, run)
        # What is not pushed may never arrive, and then nothing is wrong.
        rates = {self._place_in_ros[s.key]: s.declared_hz for s in self.streams.values() if s.push}
        for topic, message, declared_hz in self._bases.places:
            place = wire_type(message), topic
            rates[place] = rates.get(place, 0.0) + declared_hz
        self.places = frozenset({*self._place_in_ros.values(), *rates})
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
        """Wire type and topic of what hardly changes and is repeated for who comes late."""

        self.pushed: tuple[TopicKey, ...] = (*rates, *sorted(self.latched))
        """Wire type and topic of all that goes to ROS unasked."""

        self._subscriptions = Subscribers(self.places | self.latched)
        for place in self.pushed:
            self._subscriptions.push(place, peer)
        self.newest: dict[str, int] = {}
        """By stream: the stamp of the newest message that went to ROS."""

        self.missing_readings = MissingReadingCounter(scenario, run)
        self.clock_nanos: int | None = None
        """Stamp of the newest clock message; None before the first."""

        self.native: RmwZenohBridge | NoRmwZenohBridge = NoRmwZenohBridge()
        """Where what is pushed goes besides the wire."""

        self.epoch_nanos = 0
        self.life: int | None = None
        """Of which the newest clock message is."""

        self.counts = dict.fromkeys(("stale", "too_large", "commands", "from_ros", "refused"), 0)

    def forward(self, key: str, message: Message, link: Link) -> list[ToRos]:
        """Send a message of the bus, and what follows from it, to all that want it.

        Returns
        -------
        What the peer was sent.
        """
        if isinstance(message, Clock):
            self.note_time(message)
        elif self._is_stale(key, measured_nanos(message)):
            self.counts["stale"] += 1
            return []
        self.missing_readings.came(key, measured_nanos(message))
        told = [(self._place_in_ros[key], message)]
        following = self._bases.hear(key, message)
        told += [((wire_type(type(m)), topic), m) for topic, m, _ in following]
        return [(place, m) for place, m in told if self.peer in self._send(place, m, link)]

    def forward_again(self, told: Sequence[ToRos], link: Link) -> None:
        """Send to the peer what a predecessor of it may have got."""
        for place, message in told:
            self._send(place, message, link, to=[self.peer])

    def hear_native(self) -> None:
        """Take what has come from ROS besides the wire."""
        for message in self.native.arrived():
            self.take(message)

    def note_time(self, clock: Clock) -> bool:
        """Take note of what time it is; return whether a life of the run has begun."""
        has_begun = clock.life != self.life
        if has_begun:
            # Sim time begins again: nothing repeats itself.
            self.life = clock.life
            self.newest.clear()
            self._bases.restart()
        self.missing_readings.clock(clock)
        self.clock_nanos, self.epoch_nanos = clock.stamp_nanos, clock.epoch_nanos
        return has_begun

    def repeat(self, link: Link) -> None:
        """Send what is repeated every second: wishes for commands, and static transforms."""
        if self.clock_nanos is None and self._words is None:
            return
        now = self.clock_nanos or 0  # in lockstep time begins when ROS is heard
        for wish in self.incoming:
            if wish.msg_type in LATCHED and not self._has_wished:
                # The node may still serve the wish of a predecessor, and what is latched comes
                # only with a new one.
                link.send(SUBSCRIBE, wish.topic, "", now, wish.forget(), to=self.peer)
            link.send(SUBSCRIBE, wish.topic, "", now, wish.subscribe(), to=self.peer)
        self._has_wished = True
        if self.clock_nanos is None:
            return
        # What never changes has the stamp of the run's begin, so that repetitions are equal.
        for topic, told, _ in self._bases.still(self.epoch_nanos):
            self._send((wire_type(type(told)), topic), told, link)

    def on_message(self, message: WireMessage, sender: Address) -> None:
        """Take a message of the wire; called on the link's receiving thread."""
        try:
            if message.msg_type == SUBSCRIBE:
                wish = Subscribe.parse(message.body)
                if not self._subscriptions.request(sender, message.topic, wish, time.monotonic()):
                    self.counts["refused"] += 1
            elif message.msg_type == CONTROL:
                self._on_control(message, sender)
            elif self._words is None:
                self.take(message)
            elif sender == self.peer:
                self._words.put(message)
            else:
                self.counts["refused"] += 1
        except Refused:
            self.counts["refused"] += 1

    def take(self, message: WireMessage) -> tuple[str, Message] | None:
        """Publish on the bus what has come from ROS; return it with its key if it could be read."""
        try:
            key, taken = self.incoming.read(message, self.clock_nanos)
        except BadMessage:
            self.counts["refused"] += 1
            return None
        self._publish(key, taken)
        self.counts["commands" if isinstance(taken, Command) else "from_ros"] += 1
        return key, taken

    def report(
        self, link: Link, dropped: Mapping[str, int] = MappingProxyType({})
    ) -> tuple[list[StreamReport], dict[str, int]]:
        """Return what became of what was sent to the peer and back, and the gateway's counters.

        Parameters
        ----------
        dropped
            messages by key that newer ones pushed out before they were forwarded.
        """
        came = [(topic, report) for of, topic, _, report in link.arrivals() if of == self.peer]
        rows = self._reports.streams(link.accounts(self.peer), came)
        topics = {key: stream.topic for key, stream in self.streams.items()}
        pushed_out = {topics[key]: count for key, count in dropped.items() if key in topics}
        rows = [with_pushed_out(row, pushed_out) for row in rows]
        counts = self.counts | self.missing_readings.counters()
        return rows, counts | peer_counters(self._reports.link)

    def _send(
        self, place: TopicKey, message: Message, link: Link, *, to: Sequence[Address] | None = None
    ) -> Sequence[Address]:
        """Send a message to some, or to all that want it; return to whom."""
        stamp_nanos = measured_nanos(message)
        is_news = to is None
        if to is None:
            to = self._subscriptions.receivers(place, stamp_nanos, time.monotonic())
        if not to and not self.native.offers(place):
            return to
        try:
            cdr = to_cdr(message)
        except BadMessage:
            self.counts["refused"] += 1
            return ()
        msg_type, topic = place
        frame = getattr(message, "frame", "")
        if isinstance(message, Reading):  # on the wire stands what the sensor's clock says
            stamp_nanos += message.clock_error_nanos
        if is_news:
            self.native.publish(place, stamp_nanos, cdr)
        for receiver in to:
            try:
                link.send(msg_type, topic, frame, stamp_nanos, cdr, to=receiver)
            except TooLarge:
                self.counts["too_large"] += 1
            except BadHeader:
                self.counts["refused"] += 1
        return to

    def _is_stale(self, key: str, stamp_nanos: int) -> bool:
        """Return whether a stream repeats itself: a sensor came back and caught up.

        A stamp behind the newest one is new all the same when the clock has jumped back too.
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
        said = control.parse(message.body)
        if sender != self.peer:
            # Whoever subscribes may report, but time is the peer's alone.
            self.counts["refused"] += isinstance(said, RunCommand | BarrierReply)
        elif isinstance(said, BarrierReply) and self._words is not None:
            self._words.put_reply(said, message.topic)
        elif isinstance(said, RunCommand):
            self._on_wish(said)
        elif isinstance(said, LinkReport):
            self._reports.link = said
