# SPDX-License-Identifier: Apache-2.0
"""Lockstep at the ROS end: the run's time waits until ROS has its data and has responded.

From its first Barrier on, a gateway's messages are held. A Barrier lists the messages that were
sent; all of them are then published, in an order that does not depend on the network. A
BarrierReply follows when ROS has responded as the Barrier requires. With `in_turn`, the next
message is published after all responses to those before, so nodes with several inputs get them in
one order; but at once after a message that no node works on, as one that is kept to be joined. The
link's thread hands messages over, the queue's thread publishes, and the thread that calls `turn`
watches ROS and replies.

Nothing is published before publishers and subscribers are matched: a new one is given `SETTLE_S`,
because DDS does not tell when a match is complete.

A node that is started during a run requests what was sent before its start and publishes all of it,
perhaps a second time. A ROS node that responded to the first copy need not respond again. So until
the first tick is completed, missing responses are given up after a timeout.
"""

from __future__ import annotations

import time
from collections import deque
from threading import RLock
from typing import TYPE_CHECKING, Any, Callable, Deque, Dict, List, Set

from udp_bridge import MSG_TYPES
from udp_bridge.receiver.barrier_buffer import AnnouncedCounts, BarrierBuffer, in_order
from udp_bridge.sender.repair import Resend
from udp_bridge.wire.lockstep import (
    DONE,
    INCOMPLETE,
    RESTARTED,
    WAITING,
    Barrier,
    BarrierReply,
    SentMessages,
)
from udp_bridge.wire.message import Address, TopicKey
from udp_bridge.wire.types import CONTROL, ROS_TYPES

from .responses import ResponseTracker
from .slots import Slot, given_back
from .topic_qos import publisher_qos

if TYPE_CHECKING:
    from udp_bridge import Link, Message

    from .lockstep_trace import LockstepTrace
    from .publish_queue import PublishQueue
    from .responses import RosGraph
    from .subscriptions import LeasedSubscriptions, RosSample

SETTLE_S = 1.0
"""Time that a new publisher and its subscribers get to be matched."""
LEASE_S = 10.0
"""A gateway without a Barrier for so long has left lockstep; it sends one each second."""
GIVE_UP_S = 10.0
"""How long a node that was started during a run waits for the first responses."""
WARN_S = 3.0
"""After this time the missing response is logged, and responders that have left are excused."""
MAX_GATEWAYS = 4
SILENT_S = 3.0
"""A gateway without a Barrier for so long may lose its slot; see `slots`."""
FLUSH_S = 0.2
"""Time in one turn for responses to leave the send queue."""


class _GatewayState:
    """One gateway in lockstep: its held messages and the progress of its Barrier."""

    def __init__(self, drop: Callable[[Message], object], now_s: float) -> None:
        self.buffer = BarrierBuffer(drop)
        self.announced = AnnouncedCounts()
        self.barrier: Barrier | None = None
        self.begun_s = now_s
        self.barrier_s = now_s
        self.sent_before_start: tuple[SentMessages, ...] = ()
        """Messages of the first Barrier, sent before this node started."""
        self.may_lack_responses = False
        """Whether responses may have gone to a process that ran before, at either end."""
        self.needs_responses = False
        """Whether the present Barrier requires responses that were not given up."""
        self.is_first_of_episode = False
        """The first Clock of an episode needs no response: a ROS timer begins to count at it."""
        self._episode: int | None = None
        self.published_s: float | None = None
        """When the last message was published; None while messages are queued."""
        self.is_queued = False
        """Whether all messages of the Barrier are here, and the first of them were queued."""
        self.waiting: Deque[Message] = deque()
        """Messages to publish after the responses to those before."""
        self.reply: BarrierReply | None = None
        self.lost = 0
        self.has_warned = False

    def take(self, barrier: Barrier, now_s: float) -> None:
        """Begin a new Barrier."""
        if barrier.tick >= 0 and (self.barrier is None or self.barrier.tick < 0):
            self.may_lack_responses = barrier.tick > 0 or bool(self.sent_before_start)
        self.barrier, self.begun_s = barrier, now_s
        self.is_first_of_episode = barrier.tick == 0 or self._episode not in (None, barrier.episode)
        if barrier.tick >= 0:
            self._episode = barrier.episode
        self.published_s, self.is_queued, self.has_warned = None, False, False
        self.waiting.clear()
        self.reply, self.lost = None, 0

    def was_sent_before_start(self, barrier: Barrier) -> bool:
        """Return whether the messages of a Barrier were sent before this node started."""
        if self.barrier is None and not self.sent_before_start:
            self.sent_before_start = barrier.sent
        return (
            self.barrier is None and bool(barrier.sent) and barrier.sent == self.sent_before_start
        )


class BarrierResponder:
    """Responds to the Barriers of all gateways.

    Parameters
    ----------
    log
        A logger with `info` and `warning`.
    wake
        Called from any thread when `turn` has something to do.
    drop
        Called with a message that will not be published, and its sender.
    trace
        Gets what ROS receives and answers; None for none.
    """

    def __init__(
        self,
        graph: RosGraph,
        queue: PublishQueue,
        subscriptions: LeasedSubscriptions,
        *,
        log: Any,
        wake: Callable[[], object],
        drop: Callable[[Message, Address], object],
        trace: LockstepTrace | None = None,
    ) -> None:
        self._trace, self._tick = trace, -1
        self._queue, self._subscriptions, self._log = queue, subscriptions, log
        self._wake, self._drop = wake, drop
        self._responses = ResponseTracker(graph, self.received)
        self._lock = RLock()  # guards gateways
        self._gateways: Dict[Address, _GatewayState] = {}
        self._repaired: Set[TopicKey] = set()
        self._with_surplus: Set[str] = set()  # topics whose messages without a cause were logged
        self._settled_s = 0.0
        """When all known publishers and subscribers will be matched."""

    def received(self, topic: str, sample: RosSample) -> None:
        """Note a message of ROS; from any thread."""
        if self._trace is not None:
            _, stamp_nanos, body, ros_type = sample
            self._trace.received(self._tick, topic, stamp_nanos, body, ros_type)
        self._responses.received(topic, sample)

    def holds(self, message: Message, sender: Address) -> bool:
        """Hold a message of a gateway in lockstep; return whether it is held."""
        gateway = self._gateways.get(sender)
        if gateway is None:
            return False
        row = MSG_TYPES[message.msg_type]
        if publisher_qos(row.name, message.topic).is_repeated:
            return False
        with self._lock:
            gateway.buffer.put(message)
            barrier = gateway.barrier
            if barrier is not None and gateway.reply is None and not gateway.is_queued:
                self._publish_if_complete(sender, gateway, barrier)
        return True

    def take(self, barrier: Barrier, sender: Address, link: Link) -> None:
        """Process a Barrier or a repeated one; from the link's thread."""
        now_s = time.monotonic()
        with self._lock:
            gateway = self._gateways.get(sender)
            if gateway is None:
                if len(self._gateways) >= MAX_GATEWAYS and not self._has_freed_slot(sender, now_s):
                    return
                gateway = self._gateways[sender] = _GatewayState(
                    lambda message: self._drop(message, sender), now_s
                )
                self._settled_s = now_s + SETTLE_S
                self._log.info(
                    f"in lockstep with {sender[0]}:{sender[1]}: time waits for "
                    + (", ".join(f"{a.topic} to {a.of}" for a in barrier.responses) or "nothing")
                )
            gateway.barrier_s = now_s
            if gateway.was_sent_before_start(barrier):
                reply = BarrierReply(barrier.episode, barrier.tick, RESTARTED)
                link.send(CONTROL, "", "", time.time_ns(), reply.pack(), sender)
                return
            known = gateway.barrier
            if known is None:
                gateway.announced.mark_announced(link.sent_counts(sender))
            if known is None or (known.episode, known.tick) != (barrier.episode, barrier.tick):
                gateway.take(barrier, now_s)
                self._tick = barrier.tick
                if barrier.tick < 0:
                    for message in gateway.buffer.take_all():
                        self._drop(message, sender)
                self._responses.expect(barrier.responses)
                self._publish_if_complete(sender, gateway, barrier)
                if gateway.is_queued:
                    return
                self._wake()
            self._send_reply(sender, gateway, link)

    def turn(self, link: Link) -> None:
        """Publish what can be delivered now, and reply where all responses are there."""
        now_s = time.monotonic()
        with self._lock:
            for sender, gateway in list(self._gateways.items()):
                if now_s - gateway.barrier_s > LEASE_S:
                    self._end(sender, gateway)
                elif (barrier := gateway.barrier) is not None and gateway.reply is None:
                    self._prepare(sender, gateway, barrier, link, now_s)
                    if gateway.published_s is not None:
                        self._reply_if_done(sender, gateway, barrier, link, now_s)
                    self._warn(gateway, barrier, now_s)

    def _publish_if_complete(
        self, sender: Address, gateway: _GatewayState, barrier: Barrier
    ) -> None:
        """Queue all messages if they are complete and can be delivered; else `turn` will."""
        missing = gateway.buffer.missing(barrier.sent)
        if missing and time.monotonic() - gateway.begun_s < barrier.limit_ms / 1e3:
            return
        if barrier.sent and not self._is_matched(gateway, barrier):
            return
        gateway.lost, gateway.is_queued = missing, True
        gateway.waiting = deque(in_order(gateway.buffer.take(barrier.sent)))
        gateway.needs_responses = False
        self._publish_batch(sender, gateway, barrier)

    def _publish_batch(self, sender: Address, gateway: _GatewayState, barrier: Barrier) -> None:
        """Publish the next messages, with `in_turn` until the first that a node works on."""
        self._report_surplus(barrier)
        messages: List[Message] = []
        gateway.published_s, is_worked_on = None, False
        while gateway.waiting and not (is_worked_on and barrier.in_turn):
            messages.append(message := gateway.waiting.popleft())
            if not gateway.is_first_of_episode or MSG_TYPES[message.msg_type].name != "Clock":
                is_worked_on = self._responses.published(message.topic, message.stamp_nanos)
        gateway.needs_responses |= bool(self._responses.due_topic())
        if self._trace is not None:
            for message in messages:
                self._trace.published(
                    barrier.tick, message.topic, message.stamp_nanos, message.body
                )
        self._queue.put_all(messages, sender, lambda: self._on_published(gateway, barrier))

    def _report_surplus(self, barrier: Barrier) -> None:
        """Log the first messages of a topic that nothing caused, and forget them."""
        for topic, count in self._responses.settle():
            if barrier.in_turn and topic not in self._with_surplus:
                self._with_surplus.add(topic)
                self._log.warning(
                    f"lockstep: tick {barrier.tick}: {count} messages on {topic} more than what "
                    "its node consumed; results are not reproducible"
                )

    def _is_matched(self, gateway: _GatewayState, barrier: Barrier) -> bool:
        if time.monotonic() < self._settled_s:
            return False
        topics_held = {message.topic for message in gateway.buffer.samples(barrier.sent)}
        return all(map(self._queue.publishes, topics_held)) and not self._responses.unmatched_topic(
            topics_held
        )

    def _on_published(self, gateway: _GatewayState, barrier: Barrier) -> None:
        if gateway.barrier is barrier:  # else a reset overtook the last messages of its episode
            gateway.published_s = time.monotonic()
        if not self._responses.due_topic():  # else the last response wakes
            self._wake()

    def _prepare(
        self, sender: Address, gateway: _GatewayState, barrier: Barrier, link: Link, now_s: float
    ) -> None:
        """Create publishers and subscriptions until the messages can be delivered."""
        for key in set(self._subscriptions.topics) - self._repaired:
            link.enable_repair(*key, Resend(barrier.limit_ms * 1_000_000))
            self._repaired.add(key)
        if gateway.is_queued:
            return
        for message in gateway.buffer.samples(barrier.sent):
            if self._queue.prepare(message, sender):
                self._settled_s = now_s + SETTLE_S
        if self._responses.update(
            {sent.topic for sent in barrier.sent}, self._subscriptions.topics
        ):
            self._settled_s = now_s + SETTLE_S
        self._publish_if_complete(sender, gateway, barrier)

    def _reply_if_done(
        self, sender: Address, gateway: _GatewayState, barrier: Barrier, link: Link, now_s: float
    ) -> None:
        if now_s - gateway.begun_s > WARN_S:
            self._responses.forgive_absent(now_s)
        self._give_up(gateway, barrier, now_s)
        if self._responses.due_topic():
            return
        if gateway.waiting:
            self._publish_batch(sender, gateway, barrier)
            if self._responses.due_topic() or gateway.waiting:
                return
            # Nothing else is due: the next Barrier's messages are published behind these anyway.
        self._report_surplus(barrier)
        if not link.flush(FLUSH_S):
            return
        left = {
            key: count for key, count in link.sent_counts(sender).items() if key[0] in ROS_TYPES
        }
        gateway.reply = BarrierReply(
            barrier.episode, barrier.tick, DONE, gateway.lost, gateway.announced.unannounced(left)
        )
        gateway.announced.mark_announced(left)
        gateway.may_lack_responses = gateway.may_lack_responses and not gateway.needs_responses
        self._send_reply(sender, gateway, link)

    def _give_up(self, gateway: _GatewayState, barrier: Barrier, now_s: float) -> None:
        """Continue without responses that may have gone to a process that ran before."""
        assert gateway.published_s is not None
        topic = self._responses.due_topic()
        if topic and gateway.may_lack_responses and now_s - gateway.published_s > GIVE_UP_S:
            self._responses.forgive_all()
            gateway.needs_responses = False
            self._log.warning(
                f"lockstep: tick {barrier.tick} continues without a message on {topic}, which may "
                "have gone to the node that ran before; results are not reproducible"
            )

    def _send_reply(self, sender: Address, gateway: _GatewayState, link: Link) -> None:
        """Send the state of a gateway's Barrier."""
        assert gateway.barrier is not None
        reply, topic = gateway.reply, ""
        if reply is None:
            topic = self._waits_for(gateway, gateway.barrier)
            state = WAITING if topic else INCOMPLETE
            reply = BarrierReply(gateway.barrier.episode, gateway.barrier.tick, state, gateway.lost)
        link.send(CONTROL, topic, "", time.time_ns(), reply.pack(), sender)

    def _waits_for(self, gateway: _GatewayState, barrier: Barrier) -> str:
        if gateway.is_queued:
            return self._responses.due_topic()
        if gateway.buffer.missing(barrier.sent):
            return ""
        return self._responses.unmatched_topic({sent.topic for sent in barrier.sent})

    def _warn(self, gateway: _GatewayState, barrier: Barrier, now_s: float) -> None:
        if gateway.has_warned or now_s - gateway.begun_s < WARN_S:
            return
        if topic := self._waits_for(gateway, barrier):
            gateway.has_warned = True
            what = "a message" if gateway.is_queued else "a publisher or a subscriber"
            self._log.warning(f"lockstep: tick {barrier.tick} waits for {what} on {topic}")

    def _has_freed_slot(self, sender: Address, now_s: float) -> bool:
        """End lockstep with the gateway whose slot a sender may take; return whether it exists."""
        slots = [
            Slot(address, address[0], gateway.barrier_s)
            for address, gateway in self._gateways.items()
        ]
        slot = given_back(slots, sender[0], now_s, idle_s=SILENT_S)
        if slot is not None:
            self._end(slot.key, self._gateways[slot.key])
        return slot is not None

    def _end(self, sender: Address, gateway: _GatewayState) -> None:
        del self._gateways[sender]
        self._queue.put_all(in_order(gateway.buffer.take_all()), sender, lambda: None)
        self._log.info(f"no longer in lockstep with {sender[0]}:{sender[1]}")
