# SPDX-License-Identifier: Apache-2.0
"""The gateway between a run and ROS in lockstep: time goes on with ROS's word, and not before.

Rule: ROS is asked at each message of the clock, and gets the same data before the same question in
every run. At such a tick physics stands still until it is acknowledged here. All has been sent when
all sensors have acknowledged that tick and nothing waits for the link: a sensor's readings and its
acknowledgement take one way over the bus and wait in one inbox, so none overtakes the other; what
physics publishes at a tick goes before the state that sensors answer to. Then a Barrier tells ROS
what was sent, and is repeated until its BarrierReply has come with all commands that this tells of.
They are stamped with the tick, and the acknowledgement says so, so that all of them act in the next
one. Who says there that he has begun since then gets all of it again, and is asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from groundlink.bus.core_topics import GATEWAY, PHYSICS
from groundlink.core.backoff import Backoff
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Ack, Clock, Command, Message, Reading, State, measured_nanos
from groundlink.scenario import Scenario
from services.gateway.streams import answers
from udp_bridge.receiver.gathering import Tally
from udp_bridge.sender.repair import Resend
from udp_bridge.wire.lockstep import DONE, RESTARTED, Barrier, BarrierReply, SentMessages
from udp_bridge.wire.types import CONTROL

from .reply_mailbox import ReplyMailbox
from .sensor_progress import SensorProgress

if TYPE_CHECKING:
    from groundlink.bus.inbox import BusInbox
    from services.gateway.bus_session import Resumed
    from services.gateway.gateway import Gateway, ToRos
    from udp_bridge.io.link import Link
    from udp_bridge.wire.message import Message as WireMessage

REPEAT_SECONDS = 0.02
"""How long a BarrierReply may take before its Barrier is sent again."""

REMIND_SECONDS = 1.0
"""How often a Barrier that was answered is sent again: so the ROS side knows that time stands."""

LIMIT_MS = 4000
"""For so long what is lost on the link is sent again; people wait longer before they look."""

REPAIR = Resend(LIMIT_MS * 1_000_000)
"""Of all that goes to ROS and comes back: a message that is missing would change the run."""

FLUSH_SECONDS = 0.5


class Lockstep:
    """Asks ROS at each message of the clock and tells physics when it has answered.

    Parameters
    ----------
    acknowledge
        tells physics how far ROS is.
    resume
        returns where the run is, as told to a process; None before its first state.
    say
        prints a line for the user.

    Raises
    ------
    UserError
        when a topic is to be answered that ROS does not get.
    """

    def __init__(
        self,
        scenario: Scenario,
        gateway: Gateway,
        link: Link,
        words: ReplyMailbox,
        *,
        acknowledge: Callable[[Ack], object],
        resume: Callable[[str], Resumed | None],
        say: Callable[[str], object],
    ) -> None:
        self._time, self._gateway, self._link, self._words = scenario.time, gateway, link, words
        self._acknowledge, self._resume, self._say = acknowledge, resume, say
        self._answers = answers(scenario, gateway)
        self._clock_key = next(s.key for s in gateway.streams.values() if s.message is Clock)
        self._others = SensorProgress(scenario.sensor_names() or [PHYSICS])
        self._tally = Tally()
        self._forwarded: list[ToRos] = []
        self._told_of: list[ToRos] = []
        """What the present Barrier tells of."""
        self._resumed: Resumed | None = None
        self._told: tuple[BarrierReply, Sequence[WireMessage]] | None = None
        self._backoff, self._is_news = Backoff(0.0), True
        self._due: Clock | None = None
        self._last: Barrier | None = None
        self._asks = True
        self._barrier_nanos = 0
        self._life, self.tick = 0, -1
        self._since: float | None = None
        self._asked_since = self._sent_since = self._again_since = 0.0
        self._has_complained = self._is_absent = False
        self._commanded: dict[str, int] = {}
        self.counts = dict.fromkeys(
            ("barriers", "barriers_skipped", "lost_for_ros", "lost_from_ros", "other_lives"), 0
        )

    def listen(self, inbox: BusInbox[Message]) -> tuple[str, Message] | None:
        """Return what has arrived from the bus; wait for it, or for ROS."""
        if not self._asks:
            arrived = inbox.get(seconds=REPEAT_SECONDS)
            if arrived is None and self._resumed is not None:
                self._take_up(*self._resumed)
            return arrived
        self._words.wait(REPEAT_SECONDS)
        # Before ROS is there nobody is given anything.
        return inbox.get(seconds=0) if self._last is not None and self._last.tick >= 0 else None

    def hear(self, key: str, message: Message) -> None:
        """Take a message of the bus."""
        self._is_news = True
        match message:
            case Ack():
                self._others.told(key.partition("/ack/")[2], message.life, message.tick)
            case State():
                self._others.told(PHYSICS, message.life, message.tick)
            case Clock():
                self._hear_clock(key, message)
            case _ if self._is_of_now(message):
                self._forward(key, message)
            case _:
                self.counts["other_lives"] += 1

    def turn(self, now_seconds: float) -> None:
        """Ask ROS what is to be asked, and tell physics what it says."""
        if self._since is None:
            self._since = now_seconds
        if self._is_news or self._asks:
            self._backoff.reset(now_seconds)
            self._is_news = False
        elif self._backoff.is_due(now_seconds):
            self._resumed = self._resume(GATEWAY)
        if self._last is None:
            self._ask(Barrier(0, -1, LIMIT_MS, (), self._answers), 0, now_seconds)
        if self._due is not None and not self._asks and self._is_all_sent():
            due, self._due = self._due, None
            self._told_of, self._forwarded = self._forwarded, []
            barrier = Barrier(due.life, due.tick, LIMIT_MS, self._sent(), self._answers)
            self._ask(barrier, due.stamp_nanos, now_seconds)
        if self._asks or self._is_absent:
            self._look_for_word(now_seconds)
        if now_seconds - self._sent_since >= (REPEAT_SECONDS if self._asks else REMIND_SECONDS):
            self._send(now_seconds)
        self._be_patient(now_seconds)

    def _hear_clock(self, key: str, clock: Clock) -> None:
        if clock.life == self._life and clock.tick <= self.tick:
            return
        if clock.life != self._life:
            # What was sent of a life that is over and not told of is never told of.
            self._tally.tell(self._link.left(self._gateway.peer))
            self._forwarded.clear()
            self._life, self._commanded = clock.life, {}
        self.tick = clock.tick
        self._forward(key, clock)
        if behind := clock.tick % self._time.ack_ticks:
            # Where a run was restored: ROS is asked when all is there that it got then.
            self._acknowledge(Ack(clock.life, clock.tick - behind, clock.tick - behind))
            return
        self._due, self._since = clock, None
        if self._last is not None and self._last.tick >= 0:
            self._asks = False  # physics has gone on, or begins again

    def _forward(self, key: str, message: Message) -> None:
        if key in self._gateway.streams:
            self._forwarded += self._gateway.forward(key, message, self._link)
            self._link.flush(FLUSH_SECONDS)

    def _sent(self) -> tuple[SentMessages, ...]:
        """Return what was sent to ROS since this was asked last."""
        left = self._link.left(self._gateway.peer)
        sent = self._tally.since({k: n for k, n in left.items() if k in self._gateway.places})
        self._tally.tell(left)
        return sent

    def _is_of_now(self, message: Message) -> bool:
        """Return whether a reading is of this life: none is from before it, or after now."""
        now = self._gateway.clock_nanos
        if not isinstance(message, Reading) or now is None:
            return True
        stands = self._due is not None or self._asks
        until = now + (0 if stands else self._time.ack_ticks * TICK_NANOS)
        return self._gateway.epoch_nanos <= measured_nanos(message) <= until

    def _is_all_sent(self) -> bool:
        return not self._behind() and self._link.flush(FLUSH_SECONDS)

    def _behind(self) -> list[str]:
        """Return who has not acknowledged the tick that is due."""
        assert self._due is not None
        return self._others.behind(self._due.life, self._due.tick)

    def _ask(self, barrier: Barrier, stamp_nanos: int, now_seconds: float) -> None:
        self._last, self._barrier_nanos, self._asks = barrier, stamp_nanos, True
        self._asked_since = now_seconds
        self._send(now_seconds)
        if self._is_absent:
            self._skip()

    def _send(self, now_seconds: float) -> None:
        assert self._last is not None
        self._sent_since = now_seconds
        self._link.send(
            CONTROL, "", "", self._barrier_nanos, self._last.pack(), to=self._gateway.peer
        )

    def _look_for_word(self, now_seconds: float) -> None:
        assert self._last is not None
        said = self._words.of(self._last.life, self._last.tick)
        if said is not None and said[0].state == RESTARTED:
            self._send_again(now_seconds)
        if said is None or said[0].state != DONE:
            return
        word, _ = said
        is_late = now_seconds - self._asked_since > LIMIT_MS / 1e3
        missing = self._words.missing(word.sent)
        if missing and not is_late:
            return
        if self._is_absent:
            self._say("ROS's word is back")
        asked, self._asks, self._is_absent = self._asks, False, False
        if not asked:
            return  # too late: physics has gone on without it
        if word.tick < 0:
            self._resumed = self._resume(GATEWAY)
            return
        self.counts["barriers"] += 1
        self.counts["lost_for_ros"] += word.lost
        self.counts["lost_from_ros"] += missing
        if word.lost or missing:
            self._say(
                f"the link has lost {word.lost} messages to ROS and {missing} back for good, at "
                f"tick {word.tick}; this run is not like others"
            )
        self._told = word, self._words.take(word.sent)
        self._tell_physics(*self._told)

    def _send_again(self, now_seconds: float) -> None:
        """Ask anew, with all that was sent, a ROS side that has begun since then."""
        assert self._last is not None
        if now_seconds - self._again_since < REMIND_SECONDS:
            return  # it says so in answer to each copy
        self._again_since = self._asked_since = now_seconds
        self._gateway.forward_again(self._told_of, self._link)
        self._link.flush(LIMIT_MS / 1e3)
        self._last = self._last._replace(sent=self._sent())
        self._send(now_seconds)

    def _tell_physics(self, word: BarrierReply, messages: Sequence[WireMessage]) -> None:
        for message in messages:
            taken = self._gateway.take(message)
            if taken is not None and isinstance(taken[1], Command):
                self._commanded[taken[0].split("/")[2]] = word.tick
            elif taken is not None and taken[0].endswith("/command/joints"):
                self._commanded[taken[0].split("/")[2] + "/joints"] = word.tick
        self._acknowledge(Ack(word.life, word.tick, word.tick, commanded=dict(self._commanded)))

    def _take_up(self, ack: Ack, state: State) -> None:
        """Take up a run where it stands: the bus loses what comes while this is cut off.

        All that was heard has been taken by now.
        """
        self._resumed = None
        if state.tick % self._time.ack_ticks or ack.tick >= state.tick:
            return
        if state.life != self._life or state.tick > self.tick:
            # What was acknowledged to a predecessor, or while this was cut off, is not said again.
            self._others.all_told(state.life, state.tick)
            clock = Clock(state.stamp_nanos, state.epoch_nanos, state.tick, state.life)
            self._hear_clock(self._clock_key, clock)
        elif self._due is not None:
            for name in self._behind():
                if told := self._resume(name):
                    self._others.told(name, told.ack.life, told.ack.tick)
        elif self._told is not None:
            self._tell_physics(*self._told)

    def _be_patient(self, now_seconds: float) -> None:
        """Say who is waited for too long, and do without him where the scenario says so."""
        waits_for = self._waits_for()
        if not waits_for or self._since is None:
            if self._has_complained and not self._is_absent:
                self._say("time goes on")
            self._since, self._has_complained = None, False
            return
        waited, deadline = now_seconds - self._since, self._time.deadline_s
        skips = self._time.overload == "skip"
        if skips and self._due is not None and waited >= deadline / 2:
            # Physics does without these; it must not do without ROS because of them.
            self._others.do_without(self._behind())
        if waited < deadline:
            return
        if not self._has_complained:
            self._has_complained = True
            self._say(waits_for)
        if skips and self._asks and self._last is not None and self._last.tick >= 0:
            self._is_absent = True
            self._say("time goes on without ROS's word until it comes")
            self._skip()

    def _skip(self) -> None:
        """Let physics go on without a word of ROS, which is asked on."""
        assert self._last is not None
        self._asks = False
        self.counts["barriers_skipped"] += 1
        self._acknowledge(Ack(self._last.life, self._last.tick, self._last.tick))

    def _waits_for(self) -> str:
        """Return in a line what time stands still for; empty when it does not."""
        if not self._asks:
            behind = self._behind() if self._due is not None else []
            names = ", ".join(behind)
            return f"tick {self.tick} waits for {names}, before ROS is asked" if behind else ""
        assert self._last is not None
        node = "the ROS node at {}:{}".format(*self._gateway.peer)
        return self._words.lacking(node, self._last.life, self._last.tick)
