# SPDX-License-Identifier: Apache-2.0
"""Gateway in lockstep with ROS: simulation time advances only after the ROS node has replied.

Physics waits at every `ack_ticks`-th tick until the gateway acknowledges it. The gateway forwards
the readings of the tick, sends a barrier that lists them, and repeats it until the ROS node replies
and all commands that the reply lists have arrived. These are stamped with the tick and published;
then the tick is acknowledged. So ROS gets the same data before the same barrier in every run.

The readings of a tick are complete when all sensors have acknowledged it: a sensor's readings and
acknowledgements arrive in order in one inbox, and physics publishes its own streams before the
state that sensors acknowledge. `states` has the table of states and events.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial

from msgspec import UNSET

from groundlink.bus.core_topics import GATEWAY, PHYSICS
from groundlink.bus.inbox import BusInbox
from groundlink.bus.topics import joint_stream
from groundlink.core.backoff import Backoff
from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, BusMessage, Clock, Command, Reading, State, measured_nanos
from groundlink.ros.node_graph import answers
from groundlink.ros.streams import answers_mistake
from groundlink.scenario import Scenario
from services.gateway.bus_session import RunStatus
from services.gateway.gateway import Gateway, ToRos
from udp_bridge.io.link import Link
from udp_bridge.receiver.barrier_buffer import AnnouncedCounts
from udp_bridge.sender.repair import Resend
from udp_bridge.wire.lockstep import (
    DONE,
    JOINED,
    RESTARTED,
    Barrier,
    BarrierReply,
    ExpectedResponse,
    SentMessages,
)
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.types import CONTROL

from .reply_mailbox import ReplyMailbox
from .states import (
    AWAITING_REPLY,
    STEPPING,
    WITHOUT_ROS,
    LockstepAction,
    LockstepEvent,
    LockstepMachine,
    LockstepState,
)

REPEAT_SECONDS = 0.02
"""Interval at which a barrier is sent while its reply is awaited."""

REMIND_SECONDS = 1.0
"""Interval at which it is sent otherwise: the ROS node then knows that the gateway is there."""

LIMIT_MS = 4000
"""How long lost messages are sent again; a user waits longer before looking for the cause."""

REPAIR = Resend(LIMIT_MS * 1_000_000)
"""Repair of all topics, both ways: a missing message would change the run."""

FLUSH_SECONDS = 0.5


class SensorProgress:
    """Ticks that the sensors of a run have acknowledged; of physics in a run without sensors."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._reached: dict[str, tuple[int, int]] = {}
        self._left_out: set[str] = set()

    def reached(self, name: str, episode: int, tick: int) -> None:
        """Record how far a sensor has come."""
        self._reached[name] = episode, tick
        self._left_out.discard(name)

    def leave_out(self, names: Iterable[str]) -> None:
        """Stop waiting for sensors until they respond again."""
        self._left_out |= set(names)

    def behind(self, episode: int, tick: int) -> list[str]:
        """Return the sensors that have not reached a tick."""
        reached = self._reached.items()
        there = {name for name, known in reached if known[0] == episode and known[1] >= tick}
        return [name for name in self._names if name not in there | self._left_out]


@dataclass
class _SentBarrier:
    """The newest barrier, with what was sent before it."""

    barrier: Barrier
    stamp_nanos: int
    messages: list[ToRos]
    began_seconds: float = 0.0
    """When its messages were sent last."""

    sent_seconds: float = 0.0
    resent_seconds: float = 0.0
    """When messages were sent again last, of this barrier or an earlier one."""


@dataclass
class _Wait:
    """How long the run has been waiting, and whether the user knows."""

    since: float | None = None
    is_reported: bool = False


@dataclass
class _Replied:
    """A reply of the ROS node with its commands."""

    reply: BarrierReply
    missing: int
    messages: Sequence[WireMessage] = ()


@dataclass
class _Clock:
    """What is known of the run's time."""

    episode: int = 0
    tick: int = -1
    due: Clock | None = None
    """The tick at which physics waits and whose barrier was not sent yet."""

    commanded: dict[str, int] = field(default_factory=dict)
    """By vehicle: the tick of its newest command."""


class Lockstep:
    """Sends a barrier at each tick at which physics waits, and acknowledges the reply to physics.

    Parameters
    ----------
    acknowledge
        publishes an acknowledgement to physics.
    resume
        returns where the run stands, as last acknowledged by a process; None before its first
        state.
    say
        prints a line for the user.

    Raises
    ------
    UserError
        when the scenario expects answers to a topic that ROS does not get.
    """

    def __init__(
        self,
        scenario: Scenario,
        gateway: Gateway,
        link: Link,
        replies: ReplyMailbox,
        *,
        acknowledge: Callable[[Ack], object],
        resume: Callable[[str], RunStatus | None],
        say: Callable[[str], object],
    ) -> None:
        self._time, self._gateway, self._link, self._replies = scenario.time, gateway, link, replies
        self._acknowledge, self._resume, self._say = acknowledge, resume, say
        self._clock_key = next(s.key for s in gateway.streams.values() if s.message is Clock)
        self._sensors = SensorProgress(scenario.sensor_names() or [PHYSICS])
        self._machine, self._announced = LockstepMachine(), AnnouncedCounts()
        self._forwarded: list[ToRos] = []
        """What was sent to ROS since the last barrier."""

        self._now = 0.0
        self._clock, self._wait = _Clock(), _Wait()
        self._sent = _SentBarrier(
            Barrier(
                *(0, -1, LIMIT_MS, ()),
                expected_responses(scenario, gateway),
                in_turn=bool(scenario.time.nodes),
            ),
            *(0, []),
        )
        self._replied: _Replied | None = None
        self._physics_answer: Callable[[], object] | None = None
        """Takes in what physics said, once all messages that came before were handled."""

        self._backoff, self._is_news = Backoff(0.0), True
        self._actions: dict[LockstepAction, Callable[[], object]] = {
            LockstepAction.SEND_FIRST_BARRIER: self._send_first_barrier,
            LockstepAction.SEND_BARRIER: self._send_next_barrier,
            LockstepAction.SEND_BARRIER_AND_SKIP: self._send_next_barrier_and_skip,
            LockstepAction.RESEND_READINGS: self._resend_readings,
            LockstepAction.ACKNOWLEDGE: self._acknowledge_reply,
            LockstepAction.ACKNOWLEDGE_AGAIN: self._acknowledge_again,
            LockstepAction.SKIP: self._skip,
            LockstepAction.ASK_PHYSICS: self._ask_physics,
            LockstepAction.ASK_FOR_SENSORS: self._ask_for_sensors,
            LockstepAction.REPORT_RETURN: lambda: self._say("the ROS node is responding again"),
            LockstepAction.WAIT: lambda: None,
        }
        self.counts = dict.fromkeys(
            ("barriers", "barriers_skipped", "lost_for_ros", "lost_from_ros", "other_episodes"), 0
        )

    @property
    def state(self) -> LockstepState:
        """The current state."""
        return self._machine.state

    @property
    def tick(self) -> int:
        """The newest tick of the clock."""
        return self._clock.tick

    def listen(self, inbox: BusInbox[BusMessage]) -> tuple[str, BusMessage] | None:
        """Return the next message of the bus; wait for it, or for the ROS node."""
        if self.state in AWAITING_REPLY:
            self._replies.wait(REPEAT_SECONDS)
            # Messages are not taken before the ROS node is there to get them.
            return inbox.get(seconds=0) if self._sent.barrier.tick >= 0 else None
        arrived = inbox.get(seconds=REPEAT_SECONDS)
        if arrived is None and self._physics_answer is not None:
            take_in, self._physics_answer = self._physics_answer, None
            take_in()
        return arrived

    def handle(self, key: str, message: BusMessage) -> None:
        """Handle a message of the bus."""
        self._is_news = True
        match message:
            case Ack():
                self._sensors.reached(key.partition("/ack/")[2], message.episode, message.tick)
            case State():
                self._sensors.reached(PHYSICS, message.episode, message.tick)
            case Clock():
                self._handle_clock(key, message)
            case _ if self._is_current(message):
                self._forward(key, message)
            case _:
                self.counts["other_episodes"] += 1

    def turn(self, now_seconds: float) -> None:
        """Look for events other than messages of the bus."""
        self._now = now_seconds
        if self._wait.since is None:
            self._wait.since = now_seconds
        if self._is_news or not self._machine.expects(LockstepEvent.SILENCE):
            self._backoff.reset(now_seconds)
            self._is_news = False
        elif self._backoff.is_due(now_seconds):
            self._handle(LockstepEvent.SILENCE)
        if self._machine.expects(LockstepEvent.OPENED):
            self._handle(LockstepEvent.OPENED)
        if self._machine.expects(LockstepEvent.ALL_SENT) and self._is_all_sent():
            self._handle(LockstepEvent.ALL_SENT)
        if self._machine.expects(LockstepEvent.REPLY):
            self._look_for_reply()
        is_awaited = self.state in AWAITING_REPLY
        interval = REPEAT_SECONDS if is_awaited else REMIND_SECONDS
        if now_seconds - self._sent.sent_seconds >= interval:
            self._send_barrier()
        self._report_wait()

    def _handle(self, event: LockstepEvent) -> None:
        self._actions[self._machine.take(event)]()

    def _handle_clock(self, key: str, clock: Clock) -> None:
        known = self._clock
        if clock.episode == known.episode and clock.tick <= known.tick:
            return
        if clock.episode != known.episode:
            # Messages of the episode before that no barrier has listed are never listed.
            self._announced.mark_announced(self._link.sent_counts(self._gateway.peer))
            self._forwarded.clear()
            known.episode, known.commanded = clock.episode, {}
        known.tick = clock.tick
        self._physics_answer = None  # physics has gone on since
        self._forward(key, clock)
        if behind := clock.tick % self._time.ack_ticks:
            # A restored run begins between two barriers: ROS got all of this before it was saved.
            self._acknowledge(Ack(clock.episode, clock.tick - behind, clock.tick - behind))
            return
        known.due, self._wait.since = clock, None
        self._handle(LockstepEvent.CLOCK)

    def _forward(self, key: str, message: BusMessage) -> None:
        if key in self._gateway.streams:
            self._forwarded += self._gateway.forward(key, message, self._link)
            self._link.flush(FLUSH_SECONDS)

    def _is_current(self, message: BusMessage) -> bool:
        """Return whether a reading is of this episode: neither before its start nor after now."""
        now = self._gateway.clock_nanos
        if not isinstance(message, Reading) or now is None:
            return True
        is_stepping = self.state in STEPPING
        until = now + (self._time.ack_ticks * TICK_NANOS if is_stepping else 0)
        return self._gateway.epoch_nanos <= measured_nanos(message) <= until

    def _is_all_sent(self) -> bool:
        return not self._behind() and self._link.flush(FLUSH_SECONDS)

    def _behind(self) -> list[str]:
        """Return the sensors that have not acknowledged the tick that is due."""
        due = self._clock.due
        return self._sensors.behind(due.episode, due.tick) if due is not None else []

    def _look_for_reply(self) -> None:
        sent = self._sent
        found = self._replies.of(sent.barrier.episode, sent.barrier.tick)
        if found is None:
            return
        reply, _ = found
        if reply.state == RESTARTED and self._now - self._sent.resent_seconds >= REMIND_SECONDS:
            self._handle(LockstepEvent.NODE_RESTARTED)  # later copies answer copies of the barrier
        if reply.state == DONE:
            missing = self._replies.missing(reply.sent)
            if not missing or self._now - sent.began_seconds > LIMIT_MS / 1e3:
                if sent.barrier.tick >= 0 and self.state in AWAITING_REPLY:
                    self._replied = _Replied(reply, missing)
                self._handle(LockstepEvent.REPLY)

    def _send_first_barrier(self) -> None:
        self._sent.began_seconds = self._now
        self._send_barrier()

    def _send_next_barrier(self) -> None:
        due, self._clock.due = self._clock.due, None
        assert due is not None
        messages, self._forwarded = self._forwarded, []
        sent, before = self._newly_sent(), self._sent
        barrier = before.barrier._replace(episode=due.episode, tick=due.tick, sent=sent)
        self._sent = _SentBarrier(
            *(barrier, due.stamp_nanos, messages, self._now), resent_seconds=before.resent_seconds
        )
        self._send_barrier()

    def _send_next_barrier_and_skip(self) -> None:
        self._send_next_barrier()
        self._skip()

    def _send_barrier(self) -> None:
        sent = self._sent
        sent.sent_seconds = self._now
        body, peer = sent.barrier.pack(), self._gateway.peer
        self._link.send(CONTROL, "", "", sent.stamp_nanos, body, to=peer)

    def _newly_sent(self) -> tuple[SentMessages, ...]:
        """Return the ranges of messages that were sent to ROS since the last call."""
        left = self._link.sent_counts(self._gateway.peer)
        sent = self._announced.unannounced(
            {k: n for k, n in left.items() if k in self._gateway.topic_keys}
        )
        self._announced.mark_announced(left)
        return sent

    def _resend_readings(self) -> None:
        self._sent.resent_seconds = self._sent.began_seconds = self._now
        self._gateway.forward_again(self._sent.messages, self._link)
        self._link.flush(LIMIT_MS / 1e3)
        self._sent.barrier = self._sent.barrier._replace(sent=self._newly_sent())
        self._send_barrier()

    def _acknowledge_reply(self) -> None:
        assert self._replied is not None
        reply, missing = self._replied.reply, self._replied.missing
        self.counts["barriers"] += 1
        self.counts["lost_for_ros"] += reply.lost
        self.counts["lost_from_ros"] += missing
        if reply.lost or missing:
            self._say(
                f"the link lost {reply.lost} messages to ROS and {missing} from ROS at tick "
                f"{reply.tick}; results are not reproducible"
            )
        self._replied.messages = self._replies.take(reply.sent)
        self._acknowledge_again()

    def _acknowledge_again(self) -> None:
        if self._replied is None:
            return
        reply, commanded = self._replied.reply, self._clock.commanded
        counts: Counter[str] = Counter()
        for message in self._replied.messages:
            taken = self._gateway.take(message)
            if taken is not None and isinstance(taken[1], Command):
                counts[taken[0].split("/")[2]] += 1
            elif taken is not None and "/command/joints" in taken[0]:
                vehicle = taken[0].split("/")[2]
                counts[f"{vehicle}/{joint_stream(taken[0])}"] += 1
        commanded |= dict.fromkeys(counts, reply.tick)
        several = {name: count for name, count in counts.items() if count > 1}
        self._acknowledge(
            Ack(
                *(reply.episode, reply.tick, reply.tick),
                commanded=dict(commanded),
                commands=several or UNSET,
            )
        )

    def _skip(self) -> None:
        barrier = self._sent.barrier
        self.counts["barriers_skipped"] += 1
        self._acknowledge(Ack(barrier.episode, barrier.tick, barrier.tick))

    def _ask_physics(self) -> None:
        if status := self._resume(GATEWAY):
            self._physics_answer = partial(self._catch_up, *status)

    def _ask_for_sensors(self) -> None:
        acks = {name: found.ack for name in self._behind() if (found := self._resume(name))}

        def take_in() -> None:
            for name, ack in acks.items():
                self._sensors.reached(name, ack.episode, ack.tick)

        # Readings that came before the answer may still be in the inbox.
        self._physics_answer = take_in

    def _catch_up(self, ack: Ack, state: State) -> None:
        """Continue where physics says that the run stands, after all received messages.

        The bus loses messages while this process is disconnected.
        """
        if state.tick % self._time.ack_ticks or ack.tick >= state.tick:
            return
        if state.episode == self._clock.episode and state.tick <= self._clock.tick:
            self._handle(LockstepEvent.STILL_WAITING)
            return
        self._sensors.reached(PHYSICS, state.episode, state.tick)
        clock = Clock(state.stamp_nanos, state.epoch_nanos, state.tick, state.episode)
        self._handle_clock(self._clock_key, clock)
        # Sensors do not repeat acknowledgements that a predecessor of this process got.
        self._ask_for_sensors()

    def _report_wait(self) -> None:
        """Tell the user what the run has been waiting for; skip it where the scenario says so."""
        reason, wait, deadline = self._waits_for(), self._wait, self._time.deadline_s
        if not reason or wait.since is None:
            if wait.is_reported and self.state not in WITHOUT_ROS:
                self._say("simulation time advances again")
            wait.since, wait.is_reported = None, False
            return
        waited, skips = self._now - wait.since, self._time.overload == "skip"
        if skips and waited >= deadline / 2:
            # Physics skips these sensors; it must not skip the ROS node because of them.
            self._sensors.leave_out(self._behind())
        if waited < deadline:
            return
        if not wait.is_reported:
            wait.is_reported = True
            self._say(reason)
        if skips and self._machine.expects(LockstepEvent.OVERDUE):
            self._say("continuing without the ROS node until it responds")
            self._handle(LockstepEvent.OVERDUE)

    def _waits_for(self) -> str:
        """Return in a line what physics is waiting for; empty while it is stepping."""
        barrier = self._sent.barrier
        if self.state in AWAITING_REPLY:
            node = "the ROS node at {}:{}".format(*self._gateway.peer)
            return self._replies.lacking(node, barrier.episode, barrier.tick)
        names = ", ".join(self._behind())
        return f"tick {self.tick}: waiting for {names} before the barrier is sent" if names else ""


def expected_responses(scenario: Scenario, gateway: Gateway) -> tuple[ExpectedResponse, ...]:
    """Return the messages that the ROS node must send before it replies to a barrier.

    Raises
    ------
    UserError
        when one of them answers a topic that is neither sent to ROS nor published there.
    """
    if mistake := answers_mistake(scenario):
        raise UserError(mistake)
    types = {each.topic: each.msg_type for each in gateway.subscriptions}
    if scenario.time.nodes:
        return tuple(
            ExpectedResponse(
                *(each.topic, each.of, types.get(each.topic, 0)),
                every=JOINED if each.is_joined else each.every,
            )
            for each in answers(scenario.time.nodes)
        )
    return tuple(
        ExpectedResponse(topic, of, types.get(topic, 0))
        for topic, of in scenario.time.answers.items()
    )
