# SPDX-License-Identifier: Apache-2.0
"""BarrierResponder: a run whose time stands still until ROS has had its data and has answered.

Rule: what a gateway sends is held from its first Barrier on, and published when a Barrier says what
there is: all of it, in an order that does not depend on the way it took. Then the answers that the
Barrier asks for are counted, and when none is due any more a BarrierReply says so. The link's
thread hands over, the outlet's publishes, and the thread that calls `turn` looks at ROS and gives
the word.

Nothing is published before it can be heard: a publisher or a reader that is new is given
`SETTLE_S`, for DDS says of nobody that he is listening.

A node that is started in the midst of a run asks for what was sent to its predecessor, and
publishes all of it, perhaps once more. Who has answered already need not do so twice, as a timer
does not for an instant that was: so until one tick was answered, answers that do not come are given
up.
"""

from __future__ import annotations

import time
from threading import RLock
from typing import TYPE_CHECKING, Any, Callable, Dict, Set, Tuple

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
from udp_bridge.wire.message import Address
from udp_bridge.wire.types import CONTROL

from .responses import ResponseTracker
from .slots import Slot, given_back
from .topic_qos import published

if TYPE_CHECKING:
    from udp_bridge import Link, Message

    from .publish_queue import PublishQueue
    from .responses import RosGraph
    from .subscriptions import LeasedSubscriptions

SETTLE_S = 1.0
"""How long a publisher and its readers are given to find each other."""
LEASE_S = 10.0
"""A gateway that has sent no Barrier for so long is not in lockstep any more; it sends one a
second."""
GIVE_UP_S = 10.0
"""How long a node that took a predecessor's place waits for its first answers."""
PATIENCE_S = 3.0
"""After this long it is said what is waited for, and looked whether who has to answer has gone."""
MAX_GATEWAYS = 4
SILENT_S = 3.0
"""A gateway that has sent no Barrier for so long gives its place to another one; see `slots`."""
FLUSH_S = 0.2
"""How long answers may take to leave, in one turn."""


class _Run:
    """One gateway in lockstep: what is held, and how far its Barrier is."""

    def __init__(self, drop: Callable[[Message], object], now_s: float) -> None:
        self.buffer = BarrierBuffer(drop)
        self.announced = AnnouncedCounts()
        self.barrier: Barrier | None = None
        self.begun_s = now_s
        self.heard_s = now_s
        self.predecessors: tuple[SentMessages, ...] = ()
        """What the first Barrier tells of, which was sent before this node was here."""
        self.is_unsure = False
        """Whether a predecessor, of either end, may have got answers that are due to this node."""
        self.has_due = False
        """Whether its present Barrier has to be answered, and was not given up."""
        self.is_first = False
        """Of a life: its clock is not answered, for a timer of ROS only begins to count then."""
        self._life: int | None = None
        self.published_s: float | None = None
        self.is_handed = False
        self.word: BarrierReply | None = None
        self.lost = 0
        self.has_complained = False

    def take(self, barrier: Barrier, now_s: float) -> None:
        """Begin with another Barrier."""
        if barrier.tick >= 0 and (self.barrier is None or self.barrier.tick < 0):
            self.is_unsure = barrier.tick > 0 or bool(self.predecessors)
        self.barrier, self.begun_s = barrier, now_s
        self.is_first = barrier.tick == 0 or self._life not in (None, barrier.life)
        if barrier.tick >= 0:
            self._life = barrier.life
        self.published_s, self.is_handed, self.has_complained = None, False, False
        self.word, self.lost = None, 0

    def is_predecessors(self, barrier: Barrier) -> bool:
        """Return whether what a Barrier tells of was sent before this node was here."""
        if self.barrier is None and not self.predecessors:
            self.predecessors = barrier.sent
        return self.barrier is None and bool(barrier.sent) and barrier.sent == self.predecessors


class BarrierResponder:
    """The Barriers of all gateways.

    Parameters
    ----------
    log
        What has `info` and `warning`.
    wake
        Called, from any thread, when `turn` has something to do.
    drop
        Called with a message that nobody will publish, and its sender.
    """

    def __init__(
        self,
        graph: RosGraph,
        outlet: PublishQueue,
        inlet: LeasedSubscriptions,
        *,
        log: Any,
        wake: Callable[[], object],
        drop: Callable[[Message, Address], object],
    ) -> None:
        self._outlet, self._inlet, self._log = outlet, inlet, log
        self._wake, self._drop = wake, drop
        self._answers = ResponseTracker(graph)
        self._lock = RLock()  # guards runs
        self._runs: Dict[Address, _Run] = {}
        self._mended: Set[Tuple[int, str]] = set()
        self._settled_s = 0.0
        """When all publishers and readers that are known will have found each other."""

    def heard(self, topic: str) -> None:
        """Take note of a message of ROS; from any thread."""
        self._answers.heard(topic)

    def holds(self, message: Message, sender: Address) -> bool:
        """Take a message from the gateway if it waits for its Barrier."""
        run = self._runs.get(sender)
        if run is None:
            return False
        row = MSG_TYPES[message.msg_type]
        if published(row.name, message.topic).is_latched:
            return False
        with self._lock:
            run.buffer.put(message)
            barrier = run.barrier
            if barrier is not None and run.word is None and not run.is_handed:
                self._go_on(sender, run, barrier)
        return True

    def take(self, barrier: Barrier, sender: Address, link: Link) -> None:
        """Take a Barrier, or a copy of one; from the link's thread."""
        now_s = time.monotonic()
        with self._lock:
            run = self._runs.get(sender)
            if run is None:
                if len(self._runs) >= MAX_GATEWAYS and not self._has_given_back(sender, now_s):
                    return
                run = self._runs[sender] = _Run(lambda message: self._drop(message, sender), now_s)
                self._settled_s = now_s + SETTLE_S
                self._log.info(
                    f"in lockstep with {sender[0]}:{sender[1]}: time waits for "
                    + (", ".join(f"{a.topic} to {a.of}" for a in barrier.answers) or "nothing")
                )
            run.heard_s = now_s
            if run.is_predecessors(barrier):
                word = BarrierReply(barrier.life, barrier.tick, RESTARTED)
                link.send(CONTROL, "", "", time.time_ns(), word.pack(), sender)
                return
            known = run.barrier
            if known is None:
                run.announced.mark_announced(link.left(sender))
            if known is None or (known.life, known.tick) != (barrier.life, barrier.tick):
                run.take(barrier, now_s)
                if barrier.tick < 0:
                    for message in run.buffer.take_all():
                        self._drop(message, sender)
                self._answers.expect(barrier.answers)
                self._go_on(sender, run, barrier)
                if run.is_handed:
                    return
            self._tell(sender, run, link)

    def turn(self, link: Link) -> None:
        """Publish what may now be heard, and give the word where all is answered."""
        now_s = time.monotonic()
        with self._lock:
            for sender, run in list(self._runs.items()):
                if now_s - run.heard_s > LEASE_S:
                    self._end(sender, run)
                elif (barrier := run.barrier) is not None and run.word is None:
                    self._prepare(sender, run, barrier, link, now_s)
                    if run.published_s is not None:
                        self._answer(sender, run, barrier, link, now_s)
                    self._complain(run, barrier, now_s)

    def _go_on(self, sender: Address, run: _Run, barrier: Barrier) -> None:
        """Hand all to the outlet if it is there and can be heard; else `turn` will."""
        missing = run.buffer.missing(barrier.sent)
        if missing and time.monotonic() - run.begun_s < barrier.limit_ms / 1e3:
            return
        if barrier.sent and not self._can_be_heard(run, barrier):
            self._wake()
            return
        run.lost = missing
        messages = in_order(run.buffer.take(barrier.sent))
        run.has_due = self._answers.due(
            message.topic
            for message in messages
            if not run.is_first or MSG_TYPES[message.msg_type].name != "Clock"
        )
        run.is_handed = True
        self._outlet.put_all(messages, sender, lambda: self._published(run))

    def _can_be_heard(self, run: _Run, barrier: Barrier) -> bool:
        if time.monotonic() < self._settled_s:
            return False
        topics_held = {message.topic for message in run.buffer.samples(barrier.sent)}
        return all(map(self._outlet.publishes, topics_held)) and not self._answers.absent(
            topics_held
        )

    def _published(self, run: _Run) -> None:
        run.published_s = time.monotonic()
        self._wake()

    def _prepare(
        self, sender: Address, run: _Run, barrier: Barrier, link: Link, now_s: float
    ) -> None:
        """See to publishers, readers and subscriptions until what was told of can be heard."""
        for key in set(self._inlet.topics) - self._mended:
            link.mend(*key, Resend(barrier.limit_ms * 1_000_000))
            self._mended.add(key)
        if run.is_handed:
            return
        for message in run.buffer.samples(barrier.sent):
            if self._outlet.prepare(message, sender):
                self._settled_s = now_s + SETTLE_S
        if self._answers.look({sent.topic for sent in barrier.sent}, self._inlet.topics):
            self._settled_s = now_s + SETTLE_S
        self._go_on(sender, run, barrier)

    def _answer(
        self, sender: Address, run: _Run, barrier: Barrier, link: Link, now_s: float
    ) -> None:
        if now_s - run.begun_s > PATIENCE_S:
            self._answers.forgive(now_s)
        self._give_up(run, barrier, now_s)
        if self._answers.owed() or not link.flush(FLUSH_S):
            return
        left = {
            key: count
            for key, count in link.left(sender).items()
            if MSG_TYPES[key[0]].ros_type is not None
        }
        run.word = BarrierReply(
            barrier.life, barrier.tick, DONE, run.lost, run.announced.unannounced(left)
        )
        run.announced.mark_announced(left)
        run.is_unsure = run.is_unsure and not run.has_due
        self._tell(sender, run, link)

    def _give_up(self, run: _Run, barrier: Barrier, now_s: float) -> None:
        """Go on without answers that a predecessor may have got."""
        assert run.published_s is not None
        topic = self._answers.owed()
        if topic and run.is_unsure and now_s - run.published_s > GIVE_UP_S:
            self._answers.give_up()
            run.has_due = False
            self._log.warning(
                f"lockstep: tick {barrier.tick} goes on without a message on {topic}, which may "
                "have gone to a predecessor; this run is not like others"
            )

    def _tell(self, sender: Address, run: _Run, link: Link) -> None:
        """Say how far a gateway's Barrier is."""
        assert run.barrier is not None
        word, topic = run.word, ""
        if word is None:
            topic = self._waits_for(run, run.barrier)
            state = WAITING if topic else INCOMPLETE
            word = BarrierReply(run.barrier.life, run.barrier.tick, state, run.lost)
        link.send(CONTROL, topic, "", time.time_ns(), word.pack(), sender)

    def _waits_for(self, run: _Run, barrier: Barrier) -> str:
        if run.is_handed:
            return self._answers.owed()
        if run.buffer.missing(barrier.sent):
            return ""
        return self._answers.absent({sent.topic for sent in barrier.sent})

    def _complain(self, run: _Run, barrier: Barrier, now_s: float) -> None:
        if run.has_complained or now_s - run.begun_s < PATIENCE_S:
            return
        if topic := self._waits_for(run, barrier):
            run.has_complained = True
            what = "a message" if run.is_handed else "somebody who publishes, or listens,"
            self._log.warning(f"lockstep: tick {barrier.tick} waits for {what} on {topic}")

    def _has_given_back(self, sender: Address, now_s: float) -> bool:
        """End the run that gives its place to a gateway's; return whether there is any."""
        slots = [Slot(address, address[0], run.heard_s) for address, run in self._runs.items()]
        slot = given_back(slots, sender[0], now_s, idle_s=SILENT_S)
        if slot is not None:
            self._end(slot.key, self._runs[slot.key])
        return slot is not None

    def _end(self, sender: Address, run: _Run) -> None:
        del self._runs[sender]
        self._outlet.put_all(in_order(run.buffer.take_all()), sender, lambda: None)
        self._log.info(f"no longer in lockstep with {sender[0]}:{sender[1]}")
