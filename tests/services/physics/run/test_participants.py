# SPDX-License-Identifier: Apache-2.0
import pytest

from groundlink.episode.checkpoint import Checkpoint
from groundlink.messages.base import Ack
from groundlink.scenario.route import COMMAND_AHEAD_TICKS, DRIVER_PERIOD_TICKS, DRIVER_WINDOW_TICKS
from services.physics.run.participants import (
    CheckpointAcks,
    Participants,
    PendingAcks,
    barriers,
    window,
)

EPISODE = 7


@pytest.fixture
def participants() -> Participants:
    """Return what a run in lockstep waits for."""
    allowances = dict.fromkeys(("rover/imu", "rover/lidar"), window(100))
    return Participants(allowances, needed=allowances, of_others=window(50), episode=EPISODE)


@pytest.fixture
def present() -> Participants:
    """Return what a run in real time waits for."""
    return Participants(dict.fromkeys(("rover/imu", "rover/lidar"), window(100)), episode=EPISODE)


def ack(participants: Participants, process: str, tick: int, episode: int = EPISODE) -> None:
    participants.acknowledged(process, Ack(episode, tick, tick))


def test_nothing_moves_before_all_that_are_needed_have_joined(participants: Participants) -> None:
    assert participants.missing(0) == ["rover/imu", "rover/lidar"]
    ack(participants, "rover/imu", -1)
    assert participants.missing(1) == ["rover/lidar"]
    ack(participants, "rover/lidar", -1)
    assert participants.missing(1) == []
    assert not participants.has_followed("rover/imu")
    ack(participants, "rover/imu", 0)
    assert participants.has_followed("rover/imu")


def test_physics_is_at_most_a_window_ahead(participants: Participants) -> None:
    ack(participants, "rover/imu", 1000)
    ack(participants, "rover/lidar", 50)
    assert participants.missing(150) == []
    assert participants.missing(151) == ["rover/lidar"]
    ack(participants, "rover/lidar", 51)
    assert participants.missing(151) == []


def test_others_are_waited_for_while_they_are_there(participants: Participants) -> None:
    ack(participants, "rover/imu", 1000)
    ack(participants, "rover/lidar", 1000)
    ack(participants, "viewer", 10)
    assert participants.missing(60) == []
    assert participants.missing(61) == ["viewer"]
    participants.left("viewer")
    assert participants.missing(61) == []


def test_required_participant_is_awaited_after_it_left(participants: Participants) -> None:
    ack(participants, "rover/imu", 1000)
    ack(participants, "rover/lidar", 10)
    participants.left("rover/lidar")
    assert participants.missing(500) == ["rover/lidar"]


def test_acks_of_other_episodes_are_ignored(participants: Participants) -> None:
    ack(participants, "rover/imu", 1000, episode=EPISODE - 1)
    assert "rover/imu" in participants.missing(1)


def test_in_real_time_those_are_waited_for_that_are_there_and_matter(present: Participants) -> None:
    assert present.missing(10**6) == []
    ack(present, "gateway", 5)
    ack(present, "rover/imu", 5)
    assert present.missing(105) == []
    assert present.missing(106) == ["rover/imu"]
    present.left("rover/imu")
    assert present.missing(106) == []


def test_abandoned_participant_counts_again_after_its_next_ack(
    participants: Participants, present: Participants
) -> None:
    for some in (participants, present):
        ack(some, "rover/imu", 1000)
        ack(some, "rover/lidar", 5)
        some.mark_absent("rover/lidar")
        assert some.missing(500) == []
        assert some.absent == {"rover/lidar"}
        ack(some, "rover/lidar", 6)
        assert some.absent == set()
        assert some.missing(500) == ["rover/lidar"]
    present.mark_absent("rover/lidar")
    present.left("rover/lidar")
    assert present.absent == set(), "who has left is not silent"
    participants.mark_absent("rover/lidar")
    participants.left("rover/lidar")
    assert participants.missing(500) == [], "it was given up, and is still needed"
    assert participants.absent == {"rover/lidar"}


def test_removed_participant_is_not_awaited(participants: Participants) -> None:
    for name in ("rover/imu", "rover/lidar", "viewer"):
        ack(participants, name, 0)
    participants.mark_absent("rover/lidar")
    participants.only(("rover/imu",))
    assert participants.missing(500) == ["rover/imu", "viewer"]
    assert participants.absent == set()


def test_a_step_in_which_a_drivers_command_acts_waits_for_that_command() -> None:
    allowances = {"rover/driver": window(DRIVER_WINDOW_TICKS)}
    participants = Participants(allowances, needed=allowances, episode=EPISODE)
    assert participants.missing(1)
    for answered in range(-DRIVER_PERIOD_TICKS, 80, DRIVER_PERIOD_TICKS):
        ack(participants, "rover/driver", answered)
        due = answered + DRIVER_PERIOD_TICKS
        assert not participants.missing(due), "it never sees the state to answer"
        acts = due + COMMAND_AHEAD_TICKS  # the tick that the command for `due` is stamped with
        assert not participants.missing(acts)
        assert participants.missing(acts + 1)


def test_step_waits_for_the_reply_to_its_barrier() -> None:
    """What was commanded by the barrier acts in the step after it, and never in another one."""
    participants = Participants({"gateway": barriers(4)}, needed=("gateway",), episode=EPISODE)
    ack(participants, "gateway", -1)
    assert not participants.missing(0), "the first state has to be told"
    for barrier in range(0, 40, 4):
        assert participants.missing(barrier + 1)
        ack(participants, "gateway", barrier)
        assert not any(participants.missing(tick) for tick in range(barrier + 1, barrier + 5))


def test_reply_counts_after_its_commands_arrived() -> None:
    pending = PendingAcks()
    first = Ack(EPISODE, -8, -1)
    pending.add("rover/driver", first)
    assert list(pending.take_complete()) == [("rover/driver", first)]
    ack = Ack(EPISODE, 8, 8, commanded={"rover": 16, "second": 12})
    pending.add("gateway", ack)
    pending.add("rover/imu", Ack(EPISODE, 50, 40))
    assert [name for name, _ in pending.take_complete()] == ["rover/imu"]
    pending.commanded("rover", 16)
    pending.commanded("second", 8)
    assert list(pending.take_complete()) == []
    pending.commanded("second", 12)
    pending.commanded("second", 11)
    assert list(pending.take_complete()) == [("gateway", ack)]
    assert list(pending.take_complete()) == []


def test_an_acknowledgement_waits_for_all_commands_with_its_stamp() -> None:
    pending = PendingAcks()
    ack = Ack(7, 5, 5, commanded={"rover": 5, "tank": 3}, commands={"rover": 2})
    for vehicle, tick in (("tank", 3), ("rover", 4), ("rover", 5)):
        pending.commanded(vehicle, tick)
        pending.add("gateway", ack)
        assert list(pending.take_complete()) == []
    pending.commanded("rover", 5)
    assert list(pending.take_complete()) == [("gateway", ack)]
    pending.commanded("rover", 6)
    pending.add("gateway", ack)
    assert list(pending.take_complete()) == [("gateway", ack)], "a newer one follows all of them"


def test_checkpoint_is_complete_when_all_have_published_what_is_before_it() -> None:
    acks = CheckpointAcks()
    acks.acknowledged("imu", Ack(1, 8, 8))
    acks.add(Checkpoint(tick=10, memory=b"", acks={}), ["imu", "lidar", "gateway"])
    acks.add(Checkpoint(tick=20, memory=b"", acks={}), ["imu", "lidar"])
    for process, tick, settled in (
        ("imu", 12, 12),  # the first that counts
        ("imu", 22, 22),
        ("lidar", 16, 4),  # has a revolution under way
        ("lidar", 24, 20),
        ("recorder", 24, 24),
    ):
        assert acks.complete == []
        acks.acknowledged(process, Ack(1, tick, settled))
    acks.left("gateway")
    first, second = acks.complete
    assert first.acks == {"imu": Ack(1, 12, 12), "lidar": Ack(1, 24, 20)}
    assert second.acks == {"imu": Ack(1, 22, 22), "lidar": Ack(1, 24, 20)}
    assert (first.serves_from_tick, second.serves_from_tick) == (24, 24)
