# SPDX-License-Identifier: Apache-2.0
"""Lockstep between a list of messages of the bus and a stand-in of the link."""

import pytest

from groundlink.core.backoff import FIRST_SECONDS
from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, Command, State
from groundlink.scenario.schema import Time
from services.gateway.bus_session import RunStatus
from services.gateway.carrier import say
from services.gateway.lockstep.lockstep import LIMIT_MS
from services.gateway.lockstep.reply_mailbox import ReplyMailbox
from udp_bridge.wire.lockstep import (
    RESTARTED,
    WAITING,
    Barrier,
    BarrierReply,
    ExpectedResponse,
    SentMessages,
)
from udp_bridge.wire.types import CONTROL

from .rig import CLOCK, COMMAND_KEY, ENCODERS, EPISODE, JOINTS, PEER, RUN, SENSORS, TWIST, Rig


@pytest.fixture
def rig() -> Rig:
    it = Rig()
    it.turn()
    it.says(-1)
    return it


def test_first_barrier_precedes_all_messages() -> None:
    it = Rig()
    it.clock(0)
    assert it.link.barriers == [
        Barrier(0, -1, LIMIT_MS, responses=(ExpectedResponse("/cmd_vel", "/clock", TWIST),))
    ]
    assert {kind for kind, *_ in it.link.sent} == {CONTROL}
    it.turn(0.1)
    assert len(it.link.barriers) == 2, "it is repeated"
    it.says(-1)
    it.turn()
    assert (CLOCK, "/clock", 0) in {row[:3] for row in it.link.sent}


def test_barrier_follows_all_sensors_and_messages(rig: Rig) -> None:
    rig.clock(0)
    rig.measured(0)
    rig.followed(0, *SENSORS[:3])
    assert rig.link.barriers[-1].tick == -1
    rig.link.is_busy = True
    rig.followed(0, SENSORS[3])
    assert rig.link.barriers[-1].tick == -1
    rig.link.is_busy = False
    rig.turn()
    barrier = rig.link.barriers[-1]
    assert (barrier.episode, barrier.tick) == (EPISODE, 0)
    assert set(barrier.sent) == {
        SentMessages(CLOCK, "/clock", 0, 1),
        SentMessages(ENCODERS, "/wheel_encoders", 0, 1),
        SentMessages(JOINTS, "/joint_states", 0, 1),
    }


def test_acknowledgements_of_another_episode_are_ignored(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(400, episode=EPISODE - 1)
    assert rig.link.barriers[-1].tick == -1


def test_the_tick_is_acknowledged_after_the_reply_and_its_commands(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(0, sent=(SentMessages(TWIST, "/cmd_vel", 0, 2),))
    rig.commands(1)
    rig.turn()
    assert rig.acks == []
    assert rig.published == []
    rig.commands(0)
    rig.turn()
    assert [key for key, _ in rig.published] == [COMMAND_KEY] * 2
    assert all(isinstance(one, Command) and one.stamp_nanos == 0 for _, one in rig.published)
    assert rig.acks == [Ack(EPISODE, 0, 0, commanded={"rover": 0}, commands={"rover": 2})]
    rig.clock(4)
    rig.followed(4)
    assert rig.link.barriers[-1].sent == (SentMessages(CLOCK, "/clock", 1, 1),)
    rig.commands(2)
    rig.says(4, sent=(SentMessages(TWIST, "/cmd_vel", 2, 1),))
    assert rig.published[-1][1].stamp_nanos == 4 * TICK_NANOS  # type: ignore[attr-defined]
    assert rig.acks[-1] == Ack(EPISODE, 4, 4, commanded={"rover": 4})


def test_replies_of_strangers_and_of_other_ticks_are_ignored(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(4)
    rig.says(0, state=WAITING, topic="/cmd_vel")
    rig.says(0, episode=EPISODE + 1)
    rig.gateway.on_message(rig.of_ros(BarrierReply(EPISODE, 0)), ("127.0.0.1", 9))
    rig.turn()
    assert rig.acks == []
    rig.says(0)
    rig.says(0)
    assert [ack.tick for ack in rig.acks] == [0]


def test_commands_that_are_lost_for_good_are_counted_and_said(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(0, lost=3, sent=(SentMessages(TWIST, "/cmd_vel", 0, 2),))
    rig.turn(LIMIT_MS / 1e3 + 0.1)
    assert [ack.tick for ack in rig.acks] == [0]
    assert (rig.lockstep.counts["lost_for_ros"], rig.lockstep.counts["lost_from_ros"]) == (3, 2)
    assert any("lost 3 messages to ROS and 2 from ROS" in line for line in rig.said)


def test_restarted_ros_node_gets_messages_and_barrier_again(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(0)
    rig.commands(0)  # of the predecessor; nobody will tell of it
    rig.clock(4)
    rig.measured(4)
    rig.followed(4)
    before = rig.link.barriers[-1]
    for _ in range(3):
        rig.says(4, state=RESTARTED)
    again = rig.link.barriers[-1]
    assert (again.episode, again.tick) == (EPISODE, 4)
    told = {(ENCODERS, "/wheel_encoders"): 0, (JOINTS, "/joint_states"): 0, (CLOCK, "/clock"): 1}
    assert {*before.sent} == {SentMessages(*place, first, 1) for place, first in told.items()}
    assert {*again.sent} == {SentMessages(*place, first + 1, 1) for place, first in told.items()}
    data = [row for row in rig.link.sent if row[0] != CONTROL]
    assert sorted(data[-3:]) == sorted(data[-6:-3])
    assert [ack.tick for ack in rig.acks] == [0]
    rig.commands(0)
    rig.says(4, sent=(SentMessages(TWIST, "/cmd_vel", 0, 1),))
    assert len(rig.published) == 1
    assert [ack.tick for ack in rig.acks] == [0, 4]


def test_reset_starts_over(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(0)
    rig.clock(4)
    rig.measured(4)
    rig.clock(0, episode=EPISODE + 1)
    rig.measured(4)  # of the episode that is over, by its stamp
    rig.followed(0, episode=EPISODE + 1)
    barrier = rig.link.barriers[-1]
    assert (barrier.episode, barrier.tick) == (EPISODE + 1, 0)
    assert barrier.sent == (SentMessages(CLOCK, "/clock", 2, 1),)
    assert rig.lockstep.counts["other_episodes"] == 1


def test_restarted_gateway_requests_the_status_of_physics() -> None:
    state = State(RUN, EPISODE, 0, 8, 8 * TICK_NANOS, "", {})
    it = Rig(resumed=RunStatus(Ack(EPISODE, 4, 4), state))
    it.heard_of_sensors = Ack(EPISODE, 8, 8)
    it.turn()
    it.says(-1)
    it.turn()
    it.turn()
    barrier = it.link.barriers[-1]
    assert (barrier.episode, barrier.tick) == (EPISODE, 8)
    it.says(8)
    assert [ack.tick for ack in it.acks] == [8]


def stands_at(rig: Rig, tick: int, acknowledged: int) -> None:
    """Let physics say where it stands once nothing has come for long."""
    state = State(RUN, EPISODE, 0, tick, tick * TICK_NANOS, "", {})
    rig.resumed = RunStatus(Ack(EPISODE, acknowledged, acknowledged), state)
    rig.turn(FIRST_SECONDS + 0.1)
    rig.turn()
    rig.turn()


def test_a_clock_that_the_bus_has_lost(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(0)
    rig.heard_of_sensors = Ack(EPISODE, 4, 4)
    stands_at(rig, 4, acknowledged=0)
    assert rig.link.barriers[-1].tick == 4


def test_a_command_and_an_acknowledgement_that_the_bus_has_lost(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.commands(1)
    rig.says(0, sent=(SentMessages(TWIST, "/cmd_vel", 1, 1),))
    assert len(rig.published) == 1
    stands_at(rig, 0, acknowledged=-1)
    assert [ack.tick for ack in rig.acks] == [0, 0]
    assert rig.published[0] == rig.published[1], "physics waits for it, too"


@pytest.mark.parametrize(("they_have_said", "asked"), [(0, 0), (-1, -1)])
def test_acknowledgements_of_sensors_that_the_bus_has_lost(
    rig: Rig, they_have_said: int, asked: int
) -> None:
    rig.heard_of_sensors = Ack(EPISODE, they_have_said, they_have_said)
    rig.clock(0)
    stands_at(rig, 0, acknowledged=-1)
    assert rig.link.barriers[-1].tick == asked


def test_what_physics_said_is_void_after_the_next_clock() -> None:
    it = Rig(resumed=RunStatus(Ack(EPISODE, -1, -1), State(RUN, EPISODE, 0, 0, 0, "", {})))
    it.heard_of_sensors = Ack(EPISODE, 4, 4)
    it.turn()
    it.says(-1)  # physics is asked, and nothing is missing
    it.clock(0)
    it.followed(0)
    it.says(0)
    it.clock(4)
    for _ in range(3):
        it.turn()
    assert it.link.barriers[-1].tick == 0, "no sensor has acknowledged tick 4"


def test_readings_that_came_before_physics_told_of_their_sensors_precede_the_barrier(
    rig: Rig,
) -> None:
    rig.clock(0)
    rig.followed(0)
    rig.says(0)
    rig.clock(4)
    rig.followed(4, *(name for name in SENSORS if name != "rover/encoders"))
    rig.heard_of_sensors = Ack(EPISODE, 4, 4)
    state = State(RUN, EPISODE, 0, 4, 4 * TICK_NANOS, "", {})
    rig.resumed = RunStatus(Ack(EPISODE, 0, 0), state)
    rig.turn(FIRST_SECONDS + 0.1)
    rig.turn()
    assert rig.asked_for[-1] == "rover/encoders"
    rig.measured(4)  # it was on its way while physics answered
    rig.turn()
    barrier = rig.link.barriers[-1]
    assert barrier.tick == 4
    assert SentMessages(ENCODERS, "/wheel_encoders", 0, 1) in barrier.sent


def test_answered_barrier_is_not_repeated() -> None:
    state = State(RUN, EPISODE, 0, 0, 0, "", {})
    it = Rig(resumed=RunStatus(Ack(EPISODE, -1, -1), state))
    it.clock(0)
    it.says(-1)
    it.turn()
    it.turn()
    assert it.link.barriers[-1].tick == -1, "no sensor has followed yet"


@pytest.mark.parametrize(
    ("reply", "line"),
    [
        (None, "127.0.0.1:7511 has not replied to the barrier of tick 0"),
        (
            BarrierReply(EPISODE, 0, WAITING),
            "127.0.0.1:7511 has been waiting for /cmd_vel since the barrier of tick 0",
        ),
    ],
)
def test_a_late_node_is_named_once(rig: Rig, reply: BarrierReply | None, line: str) -> None:
    rig.clock(0)
    rig.followed(0)
    if reply is not None:
        rig.gateway.on_message(rig.of_ros(reply, "/cmd_vel"), PEER)
    for _ in range(20):
        rig.turn(0.5)
    assert rig.said == [f"the ROS node at {line}"]
    rig.says(0)
    assert rig.said[1:] == ["simulation time advances again"]


def test_a_late_sensor_is_named(rig: Rig) -> None:
    rig.clock(0)
    rig.followed(0, *SENSORS[1:])
    rig.turn(6.0)
    assert rig.said == ["tick 0: waiting for rover/lidar before the barrier is sent"]


def test_skip_goes_on_without_ros_until_it_answers() -> None:
    it = Rig(Time(mode="fast", lockstep="ros", epoch="zero", overload="skip"))
    it.turn()
    it.says(-1)
    it.clock(0)
    it.followed(0)
    it.turn(6.0)
    assert [ack.tick for ack in it.acks] == [0]
    assert it.said[1:] == ["continuing without the ROS node until it responds"]
    it.clock(4)
    it.followed(4)
    assert [ack.tick for ack in it.acks] == [0, 4], "it is not waited for again"
    it.says(4)
    it.clock(8)
    it.followed(8)
    assert [ack.tick for ack in it.acks] == [0, 4], "it is back"
    assert it.said[2:] == ["the ROS node is responding again"]
    assert it.lockstep.counts["barriers_skipped"] == 2


def test_skip_goes_on_without_a_silent_sensor_before_ros_is_blamed() -> None:
    it = Rig(Time(mode="fast", lockstep="ros", epoch="zero", overload="skip"))
    it.turn()
    it.says(-1)
    it.clock(0)
    it.followed(0, *SENSORS[1:])
    it.turn(3.0)
    it.turn()
    assert it.link.barriers[-1].tick == 0


def test_a_topic_that_ros_does_not_get_cannot_be_answered() -> None:
    with pytest.raises(UserError, match=r"/cmd_vel cannot answer /odom.*expected one of /"):
        Rig(Time(mode="fast", lockstep="ros", answers={"/cmd_vel": "/odom"}))


def test_a_name_of_the_peer_forges_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    mailbox = ReplyMailbox()
    mailbox.put_reply(BarrierReply(1, 0, WAITING), "/a\ngateway: all is well\x1b[2K")
    say(mailbox.lacking("the node", 1, 0))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.isprintable()
