# SPDX-License-Identifier: Apache-2.0
"""The node's half of lockstep between a gateway and a ROS that the test plays; no DDS, no clock."""

from collections.abc import Callable, Hashable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from udp_bridge import Message
from udp_bridge.node import lockstep
from udp_bridge.node.lockstep import GIVE_UP_S, SETTLE_S, BarrierResponder
from udp_bridge.node.subscriptions import RosSample
from udp_bridge.wire import control
from udp_bridge.wire.lockstep import (
    DONE,
    INCOMPLETE,
    JOINED,
    RESTARTED,
    WAITING,
    Barrier,
    BarrierReply,
    ExpectedResponse,
    SentMessages,
)
from udp_bridge.wire.types import CONTROL, type_number

GATEWAY = ("127.0.0.1", 7510)
EPISODE = 77
ODOM, CLOCK, TWIST = map(type_number, ("Odometry", "Clock", "Twist"))
ANSWERS = (ExpectedResponse("/cmd_vel", "/odom", TWIST),)
GRAPH = (
    ExpectedResponse("/filtered", "/odom"),
    ExpectedResponse("/cmd_vel", "/filtered", TWIST),
    ExpectedResponse("/beat", "/clock"),
)
JOIN = tuple(ExpectedResponse("/cmd_vel", of, TWIST, JOINED) for of in ("/odom", "/clock"))
SAMPLE = RosSample("", None, b"")


class StandIn:
    """Node, publishers, subscriptions and link in one: what the half between them needs of each."""

    def __init__(self) -> None:
        self.published: list[Message] = []
        self.replies: list[BarrierReply] = []
        self.warnings: list[str] = []
        self.topics = [(TWIST, "/cmd_vel")]
        self._known: set[str] = set()
        self.is_busy = False
        """Whether publishing takes until `then` of the last messages is called."""
        self.then: Callable[[], Any] = lambda: None

    def info(self, line: str) -> None:
        pass

    def warning(self, line: str) -> None:
        self.warnings.append(line)

    def publishers(self, topic: str) -> frozenset[Hashable]:
        return frozenset({"controller"})

    def has_publisher(self, topic: str) -> bool:
        return True

    def has_subscriber(self, topic: str, is_own: bool) -> bool:
        return True

    def listen(self, topic: str, take: Callable[[RosSample], object]) -> object:
        return self

    def prepare(self, message: Message, sender: Any) -> bool:
        is_new = message.topic not in self._known
        self._known.add(message.topic)
        return is_new

    def publishes(self, topic: str) -> bool:
        return topic in self._known

    def put_all(self, messages: Sequence[Message], sender: Any, then: Callable[[], Any]) -> None:
        self.published += messages
        self.then = then
        if not self.is_busy:
            then()

    def enable_repair(self, *_: Any) -> None:
        pass

    def flush(self, _: float) -> bool:
        return True

    def sent_counts(self, _: Any) -> dict[tuple[int, str], int]:
        return {}

    def send(self, kind: int, topic: str, _: str, stamp: int, body: bytes, to: Any) -> None:
        assert (kind, to) == (CONTROL, GATEWAY)
        said = control.parse(body)
        assert isinstance(said, BarrierReply)
        self.replies.append(said)


class Rig:
    """A node's half of lockstep."""

    def __init__(self, ros: Any) -> None:
        self.now_s = 100.0
        self.ros = ros
        self.half = BarrierResponder(
            ros, ros, ros, log=ros, wake=lambda: None, drop=lambda *_: None
        )

    def told(
        self,
        tick: int,
        first: int,
        *,
        come: bool = True,
        responses: tuple[ExpectedResponse, ...] = ANSWERS,
        in_turn: bool = False,
    ) -> None:
        """Hear a Barrier that tells of an odometry and a clock with this number."""
        rows = () if tick < 0 else ((ODOM, "/odom"), (CLOCK, "/clock"))
        if come:
            for kind, topic in rows:
                message = Message(kind, topic, "", tick, first, b"\0\1\0\0")
                self.half.holds(message, GATEWAY)
        sent = tuple(SentMessages(kind, topic, first, 1) for kind, topic in rows)
        self._barrier = Barrier(EPISODE, tick, 4000, sent, responses, in_turn)
        self.half.take(self._barrier, GATEWAY, self.ros)

    def turn(self, seconds: float = 0.0) -> None:
        """Let time pass; the Barrier is repeated."""
        for _ in range(4):
            self.now_s += seconds / 4
            self.half.turn(self.ros)
        self.half.take(self._barrier, GATEWAY, self.ros)

    def numbers(self, topic: str) -> list[int]:
        return [one.seq_number for one in self.ros.published if one.topic == topic]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Rig:
    it = Rig(StandIn())
    clock = SimpleNamespace(monotonic=lambda: it.now_s, time_ns=lambda: 0)
    monkeypatch.setattr(lockstep, "time", clock)
    return it


def started_again(rig: Rig) -> None:
    """Send a Barrier with messages that an earlier node got, and send them again."""
    rig.told(8, first=5, come=False)
    rig.told(8, first=6)
    rig.turn(4 * SETTLE_S)


def test_a_node_from_the_start_replies_when_all_responses_are_there(rig: Rig) -> None:
    rig.told(-1, first=0)
    rig.turn()
    assert rig.ros.replies[-1].state == DONE
    rig.told(0, first=0)
    rig.turn(4 * SETTLE_S)
    assert rig.numbers("/odom") == [0]
    for _ in range(10):  # a controller may take its time
        rig.turn(GIVE_UP_S / 2)
    assert rig.ros.replies[-1].state == WAITING
    rig.half.received("/cmd_vel", SAMPLE)
    rig.turn()
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 0, DONE)
    assert rig.ros.warnings == ["lockstep: tick 0 waits for a message on /cmd_vel"]


def test_successor_requests_messages_sent_before_its_start(rig: Rig) -> None:
    rig.told(8, first=5, come=False)
    rig.turn(SETTLE_S)
    assert [reply.state for reply in rig.ros.replies] == [RESTARTED, RESTARTED]
    assert rig.ros.published == []


def test_what_comes_again_is_published_when_it_can_be_heard_and_has_to_be_answered(
    rig: Rig,
) -> None:
    rig.told(8, first=5, come=False)
    rig.told(8, first=6)
    rig.turn(0.9 * SETTLE_S)
    assert rig.ros.published == []
    rig.turn(2 * SETTLE_S)
    assert rig.numbers("/odom") == [6]
    assert rig.ros.replies[-1].state == WAITING
    rig.half.received("/cmd_vel", SAMPLE)
    rig.turn()
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 8, DONE)


def test_a_response_that_an_earlier_node_may_have_got_is_given_up(rig: Rig) -> None:
    started_again(rig)
    assert rig.numbers("/odom") == [6]
    rig.turn(GIVE_UP_S / 2)
    assert rig.ros.replies[-1].state == WAITING
    rig.turn(GIVE_UP_S / 2)
    rig.turn(1.0)
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 8, DONE)
    assert any("tick 8 continues without a message on /cmd_vel" in one for one in rig.ros.warnings)


def test_once_a_tick_was_answered_answers_are_awaited_for_as_long_as_it_takes(rig: Rig) -> None:
    started_again(rig)
    rig.half.received("/cmd_vel", SAMPLE)
    rig.turn()
    rig.told(16, first=7)
    rig.turn()
    assert rig.numbers("/odom") == [6, 7]
    for _ in range(10):
        rig.turn(GIVE_UP_S / 2)
    assert rig.ros.replies[-1].state == WAITING


def test_messages_that_end_late_do_not_answer_the_next_barrier(rig: Rig) -> None:
    rig.told(-1, first=0)
    rig.ros.is_busy = True
    rig.told(0, first=0)
    rig.turn(4 * SETTLE_S)
    rig.half.received("/cmd_vel", SAMPLE)
    rig.told(16, first=1, come=False)
    rig.ros.then()
    rig.turn()
    assert (rig.ros.replies[-1].tick, rig.ros.replies[-1].state) == (16, INCOMPLETE)


def begun_in_turn(rig: Rig, graph: tuple[ExpectedResponse, ...] = GRAPH) -> None:
    rig.told(-1, first=0, responses=graph, in_turn=True)
    rig.told(8, first=0, responses=graph, in_turn=True)
    rig.turn(4 * SETTLE_S)


def test_in_turn_a_message_follows_the_responses_of_the_whole_graph(rig: Rig) -> None:
    begun_in_turn(rig)
    assert [one.topic for one in rig.ros.published] == ["/odom"]
    rig.half.received("/filtered", SAMPLE)
    rig.turn()
    assert [one.topic for one in rig.ros.published] == ["/odom"]
    rig.half.received("/cmd_vel", SAMPLE)
    rig.turn()
    assert [one.topic for one in rig.ros.published] == ["/odom", "/clock"]
    assert rig.ros.replies[-1].state == WAITING
    rig.half.received("/beat", SAMPLE)
    rig.turn()
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 8, DONE)
    assert rig.ros.warnings == ["lockstep: tick 8 waits for a message on /filtered"]


def test_a_message_follows_at_once_after_one_that_a_node_only_keeps_to_join_it(rig: Rig) -> None:
    begun_in_turn(rig, JOIN)
    assert [one.topic for one in rig.ros.published] == ["/odom", "/clock"]
    assert rig.ros.replies[-1].state == WAITING
    rig.half.received("/cmd_vel", SAMPLE)
    rig.turn()
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 8, DONE)


def test_the_reply_does_not_wait_until_the_last_messages_that_cause_nothing_are_published(
    rig: Rig,
) -> None:
    begun_in_turn(rig, ANSWERS)
    rig.ros.is_busy = True
    rig.half.received("/cmd_vel", SAMPLE)
    rig.half.turn(rig.ros)
    assert [one.topic for one in rig.ros.published] == ["/odom", "/clock"]
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 8, DONE)
    rig.told(16, first=1, responses=ANSWERS, in_turn=True)
    rig.half.received("/cmd_vel", SAMPLE)
    rig.turn()
    last = rig.ros.replies[-1]
    assert (last.tick, last.state) == (16, INCOMPLETE), "a run is one Barrier ahead at most"


def test_messages_that_nothing_caused_are_logged_once_and_answer_nothing(rig: Rig) -> None:
    begun_in_turn(rig)
    for topic in ("/filtered", "/cmd_vel", "/beat", "/beat"):
        rig.half.received(topic, SAMPLE)
        rig.turn()
    rig.half.received("/beat", SAMPLE)
    rig.told(16, first=1, responses=GRAPH, in_turn=True)
    rig.turn()
    for topic in ("/filtered", "/cmd_vel"):
        rig.half.received(topic, SAMPLE)
        rig.turn()
    assert rig.ros.replies[-1].state == WAITING
    rig.half.received("/beat", SAMPLE)
    rig.turn()
    assert rig.ros.replies[-1] == BarrierReply(EPISODE, 16, DONE)
    (line,) = (line for line in rig.ros.warnings if "more than" in line)
    assert line.startswith("lockstep: tick 16: 2 messages on /beat more than")
