# SPDX-License-Identifier: Apache-2.0
"""Between the bus and the UDP Bridge: readings out, commands in.

Rule: holds no physics and no sensor; what it cannot carry it counts. Everything here happens on two
threads: the main one takes from the bus, the link's receiving one takes from the wire.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from groundlink.messages import BadMessage, Clock, Command, Message, StreamReport
from groundlink.ros_messages import to_cdr, transforms_to_cdr, twist_from_cdr
from groundlink.scenario import Scenario
from udp_bridge import control
from udp_bridge.control import LinkReport, Subscribe, TopicReport
from udp_bridge.fragments import TooLarge
from udp_bridge.header import Refused
from udp_bridge.link import Link
from udp_bridge.message import Message as WireMessage
from udp_bridge.types import CONTROL, SUBSCRIBE

from .reports import PeerReports, peer_counters
from .streams import (
    TF_MESSAGE,
    TF_STATIC_TOPIC,
    TWIST,
    Stream,
    command_keys,
    outgoing,
    static_transforms,
)
from .subscriptions import Address, Subscriptions

LEASE_SECONDS = 3
"""Of the gateway's own wishes; they are repeated every second."""

STALE_SLACK_NANOS = 100_000_000
"""A stream may be this much ahead of the clock that the gateway has heard."""


class Gateway:
    """A run's door to ROS.

    Parameters
    ----------
    publish_command
        called with a key and a Command when a Twist has come.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        *,
        peer: Address,
        publish_command: Callable[[str, Command], object],
    ) -> None:
        self.streams: Mapping[str, Stream] = {s.key: s for s in outgoing(scenario, run)}
        self.peer = peer
        self._publish_command = publish_command
        self._command_keys = command_keys(scenario, run)
        self._transforms = static_transforms(scenario)
        rates = {(s.msg_type, s.topic): s.declared_hz for s in self.streams.values()}
        self._reports = PeerReports(
            rates,
            stamps_follow_wall=scenario.time.mode == "realtime"
            and scenario.time.epoch == "wall"
            and scenario.time.factor == 1.0,
        )
        self._subscriptions = Subscriptions(frozenset((*rates, (TF_MESSAGE, TF_STATIC_TOPIC))))
        for stream in self.streams.values():
            if stream.push:
                self._subscriptions.push((stream.msg_type, stream.topic), peer)
        self._subscriptions.push((TF_MESSAGE, TF_STATIC_TOPIC), peer)
        self._newest: dict[str, int] = {}
        self.clock_nanos: int | None = None
        """Stamp of the newest clock message; None before the first."""

        self._epoch_nanos = 0

        self.counts = dict.fromkeys(("stale", "too_large", "commands", "refused"), 0)

    def forward(self, key: str, message: Message, link: Link) -> None:
        """Send a message of the bus to all that want it."""
        stream = self.streams[key]
        stamp: int = message.stamp_nanos  # type: ignore[attr-defined]
        if isinstance(message, Clock):
            self.clock_nanos, self._epoch_nanos = stamp, message.epoch_nanos
        elif self._is_stale(key, stamp):
            self.counts["stale"] += 1
            return
        frame = getattr(message, "frame", "")
        self._send(stream.msg_type, stream.topic, frame, stamp, lambda: to_cdr(message), link)

    def repeat(self, link: Link) -> None:
        """Send what is repeated every second: wishes for commands, and static transforms."""
        now = self.clock_nanos
        if now is None:
            return
        wish = Subscribe(TWIST, lease_s=LEASE_SECONDS).pack()
        for topic in self._command_keys:
            link.send(SUBSCRIBE, topic, "", now, wish, to=self.peer)
        # What never changes has the stamp of the run's begin, so that repetitions are equal.
        stamp = self._epoch_nanos
        self._send(
            TF_MESSAGE,
            TF_STATIC_TOPIC,
            "",
            stamp,
            lambda: transforms_to_cdr(self._transforms, stamp),
            link,
        )

    def on_message(self, message: WireMessage, sender: Address) -> None:
        """Take a message of the wire; called on the link's receiving thread."""
        try:
            if message.msg_type == TWIST:
                self._on_twist(message)
            elif message.msg_type == SUBSCRIBE:
                wish = Subscribe.parse(message.body)
                if not self._subscriptions.request(sender, message.topic, wish, time.monotonic()):
                    self.counts["refused"] += 1
            elif message.msg_type == CONTROL:
                self._on_report(message, sender)
            else:
                self.counts["refused"] += 1
        except (Refused, BadMessage):
            self.counts["refused"] += 1

    def report(self) -> tuple[list[StreamReport], dict[str, int]]:
        """Return what the peer has received, and the gateway's own counters."""
        return self._reports.streams(), self.counts | peer_counters(self._reports.link)

    def _send(
        self,
        msg_type: int,
        topic: str,
        frame: str,
        stamp_nanos: int,
        body: Callable[[], memoryview],
        link: Link,
    ) -> None:
        receivers = self._subscriptions.receivers((msg_type, topic), stamp_nanos, time.monotonic())
        if not receivers:
            return
        cdr = body()
        for receiver in receivers:
            try:
                link.send(msg_type, topic, frame, stamp_nanos, cdr, to=receiver)
            except TooLarge:
                self.counts["too_large"] += 1

    def _is_stale(self, key: str, stamp_nanos: int) -> bool:
        """Return whether a stream repeats itself: a sensor came back and caught up.

        A stamp behind the newest one is new all the same when the clock has jumped back too.
        """
        newest = self._newest.get(key)
        clock = self.clock_nanos
        if newest is not None and stamp_nanos <= newest:
            jumped_back = clock is not None and newest > clock + STALE_SLACK_NANOS
            if not jumped_back:
                return True
        self._newest[key] = stamp_nanos
        return False

    def _on_twist(self, message: WireMessage) -> None:
        key = self._command_keys.get(message.topic)
        if key is None or self.clock_nanos is None:
            raise BadMessage(f"no vehicle obeys {message.topic}")
        linear, angular = twist_from_cdr(message.body)
        self._publish_command(key, Command(self.clock_nanos, linear, angular))
        self.counts["commands"] += 1

    def _on_report(self, message: WireMessage, sender: Address) -> None:
        if sender != self.peer:
            return
        report = control.parse(message.body)
        if isinstance(report, TopicReport):
            self._reports.heard(message.topic, report)
        elif isinstance(report, LinkReport):
            self._reports.link = report
