# SPDX-License-Identifier: Apache-2.0
"""An episode that was restored is the one that was saved to the bit."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.episode.control import Remove, Spawn
from groundlink.episode.journal import Journal, Platform, dumped, loaded
from groundlink.loader.additions import SpawnPlace, addition
from groundlink.messages.base import Ack, BusMessage, Command, State, WheelCommand, decode, encode
from groundlink.scenario import Scenario
from groundlink.scenario.lockstep_window import HISTORY_TICKS
from groundlink.scenario.ros_side import TrueMap
from groundlink.world import assets
from services.physics.run.episode import Episode
from services.physics.run.publishers import Publishers, silent_publishers
from services.physics.run.restore import (
    JournalArchive,
    JournalPlayer,
    Restoration,
    check_data,
    check_processes,
)

Mode = Literal["realtime", "fast"]


@contextmanager
def episode_of(
    scenario: Scenario,
    number: int = 5,
    epoch_nanos: int | None = None,
    publish: Publishers | None = None,
) -> Iterator[Episode]:
    episode = Episode(
        *(scenario, "run", publish or silent_publishers()),
        required=(),
        wall_nanos=number,
        epoch_nanos=epoch_nanos,
    )
    episode.begin(number, 0.0)
    yield episode
    episode.end()


def spawn(what: str, *at: float) -> Spawn:
    return Spawn(addition(what, at=SpawnPlace(*at), name=None, taken=(), ground=None)[1])


def drive(episode: Episode, until_tick: int) -> None:
    """Have an episode live through something of everything, up to a tick."""
    wheels = [wheel.name for wheel in episode.scenario.vehicles[0].model.wheels]
    while episode.tick < until_tick:
        tick, now = episode.tick, episode.epoch_nanos + episode.tick * TICK_NANOS
        if tick % 8 == 0:
            turn = 0.5 if tick % 160 < 80 else -0.7
            episode.command(
                "rover", Command(now + 9 * TICK_NANOS, (0.6, 0.0, 0.0), (0.0, 0.0, turn))
            )
        if tick == 250:
            episode.command("rover", WheelCommand(now - 3, dict.fromkeys(wheels, 2.0)))
        if tick == 100:
            episode.change(spawn("crate", -0.5, 0.0))
        if tick == 300:
            episode.change(spawn("box", 3.0, 2.0))
        if tick == 395:
            episode.change(Remove("box"))
        episode.step()


def states(episode: Episode) -> list[State]:
    """Return what a process that joins would hear, as if all episodes were one."""
    return [replace(decode(payload, State), episode=0) for payload in episode._history]


def restored(journal: Journal, number: int = 9, publish: Publishers | None = None) -> Episode:
    episode = Episode(
        *(journal.scenario, "run", publish or silent_publishers()),
        required=(),
        wall_nanos=number,
        epoch_nanos=journal.epoch_nanos,
    )
    episode.begin(0, 0.0)
    restoration = Restoration(journal, episode)
    while not restoration.advance(150):
        assert episode.tick % 150 == 0
    assert restoration.difference() == ""
    return episode


@pytest.fixture
def scenario(lab: Scenario) -> Scenario:
    rover = lab.vehicles[0]
    return replace(lab, vehicles=(rover,), time=replace(lab.time, mode="fast", epoch="zero"))


@pytest.mark.parametrize("saved_tick", [1, 300, 397, 400])
def test_restored_run_continues_as_the_saved_one(scenario: Scenario, saved_tick: int) -> None:
    with episode_of(scenario) as episode:
        drive(episode, saved_tick)
        journal = loaded(dumped(episode.journal()), "file")
        again = restored(journal)
        assert list(map(encode, states(again))) == list(map(encode, states(episode)))
        assert again.journal().entries == journal.entries
        drive(episode, 500)
        drive(again, 500)
        assert list(map(encode, states(again))) == list(map(encode, states(episode)))
        assert again.worlds == episode.worlds
        again.end()


def test_all_that_is_published_afterwards_is_the_same(scenario: Scenario) -> None:
    """Truth, vitals, bodies and the map have schedules and sums of their own."""
    scenario = replace(scenario, true_map=TrueMap(resolution_m=0.1, rate_hz=7.0))

    def heard() -> tuple[list[bytes], Publishers]:
        said: list[bytes] = []

        def publish(message: BusMessage) -> bytes:
            plain = message
            if hasattr(message, "episode"):
                plain = replace(message, episode=0)
            said.append(encode(plain))
            return encode(message)

        vehicles = {name: {"rover": publish} for name in ("truth", "wheels", "joints", "vitals")}
        return said, Publishers(publish, publish, publish, publish, **vehicles)

    said, publish = heard()
    with episode_of(scenario, publish=publish) as episode:
        drive(episode, 398)
        again = restored(episode.journal())
        said_again, again.publish = heard()
        said.clear()
        drive(episode, 500)
        drive(again, 500)
        assert said_again == said
        assert len(said) > 102
        again.end()


def test_late_command_acts_at_its_arrival_tick(scenario: Scenario) -> None:
    """As in real time: the stamp alone would have it act earlier."""
    with episode_of(scenario) as episode:
        drive(episode, 40)
        episode.command("rover", Command(33 * TICK_NANOS, (-1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        for _ in range(60):
            episode.step()
        again = restored(episode.journal())
        assert list(map(encode, states(again))) == list(map(encode, states(episode)))
        again.end()


def test_pending_commands_are_saved(scenario: Scenario) -> None:
    with episode_of(scenario) as episode:
        episode.command("rover", Command(200 * TICK_NANOS, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        for _ in range(100):
            episode.step()
        again = restored(episode.journal())
        for _ in range(200):
            again.step()
        assert abs(states(again)[-1].vehicles["rover"].poses()[0, 0]) > 0.1
        again.end()


@pytest.mark.parametrize("mode", ["realtime", "fast"])
def test_participants_continue_from_their_last_acks(scenario: Scenario, mode: Mode) -> None:
    with episode_of(replace(scenario, time=replace(scenario.time, mode=mode))) as episode:
        drive(episode, HISTORY_TICKS + 100)
        episode.acknowledged("rover/imu", Ack(5, HISTORY_TICKS + 50, HISTORY_TICKS + 40, b"memory"))
        episode.apply_acks()
        again = restored(episode.journal())
        first, *missed = again.history_for("rover/imu")
        assert decode(first, Ack) == Ack(9, HISTORY_TICKS + 50, HISTORY_TICKS + 40, b"memory")
        ticks = [decode(payload, State).tick for payload in missed]
        assert ticks == list(range(HISTORY_TICKS + 40, HISTORY_TICKS + 101))
        newcomers = again.history_for("rover/newcomer")
        assert len(newcomers) == (0 if mode == "realtime" else 1 + HISTORY_TICKS)
        assert {decode(payload, State).episode for payload in missed} == {9}
        again.end()


def test_time_goes_on_at_once_from_where_it_was(scenario: Scenario) -> None:
    realtime = replace(scenario, time=replace(scenario.time, mode="realtime"))
    with episode_of(realtime) as episode:
        drive(episode, 400)
        again = restored(episode.journal())
        again.begin(0, 0.5)
        assert again.pacer.wait_seconds(401, 0.5) == pytest.approx(TICK_SECONDS)
        again.end()


def test_ack_counts_after_its_command_arrived(scenario: Scenario) -> None:
    """Or a driver that is restored would take for sent what never came."""
    with episode_of(scenario) as episode:
        assert not episode.awaits_commands
        episode.acknowledged("rover/driver", Ack(5, 0, 0, b"", {"rover": 8}))
        episode.apply_acks()
        assert episode.awaits_commands
        assert episode.journal().acks == {}
        episode.command("rover", Command(8 * TICK_NANOS, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        episode.apply_acks()
        assert episode.journal().acks.keys() == {"rover/driver"}


def test_a_run_that_follows_another_does_the_same(scenario: Scenario) -> None:
    with episode_of(scenario) as episode, episode_of(scenario, 9) as again:
        drive(episode, 450)
        player = JournalPlayer(episode.journal())
        assert player.until_tick == 450
        while again.tick < 450:
            player.play(again)
            again.step()
        assert list(map(encode, states(again))) == list(map(encode, states(episode)))


def test_run_without_followed_journal_reports_no_result(scenario: Scenario) -> None:
    with episode_of(scenario) as episode:
        JournalPlayer(None).play(episode)
        assert episode.journal().entries == ()


def test_different_result_is_reported_with_its_cause(scenario: Scenario) -> None:
    with episode_of(scenario) as episode, episode_of(scenario, 9) as again:
        drive(episode, 20)
        saved = replace(episode.journal(), digest="of another state")
        for made_on, cause in (
            (saved.made_on, "though the machine is the same"),
            (Platform("abacus", {"python": "4.0"}), "it was saved with abacus, python 4.0"),
        ):
            restoration = Restoration(replace(saved, made_on=made_on), again)
            assert restoration.advance(100)
            assert restoration.difference() == (
                "the state restored at tick 20 differs from the saved one, "
                f"{cause}; the run continues from it"
            )


def test_restore_progress_is_reported_periodically(scenario: Scenario) -> None:
    with episode_of(scenario) as episode, episode_of(scenario, 9) as again:
        drive(episode, 20)
        restoration = Restoration(episode.journal(), again)
        assert restoration.progress(0.0) == ["restoring: tick 0 of 20"]
        restoration.advance(10)
        assert restoration.progress(1.0) == []
        assert restoration.progress(3.0) == ["restoring: tick 10 of 20"]


def test_the_journals_of_this_episode_and_the_last_are_kept(scenario: Scenario) -> None:
    archive = JournalArchive()
    with episode_of(scenario) as episode:
        drive(episode, 20)
        archive.ends(episode)
        ended = episode.journal()
    with episode_of(scenario, 9) as episode:
        drive(episode, 12)
        here = episode.journal()
        assert archive.journal(episode, "") == archive.journal(episode, "9") == here
        rest = archive.journal(episode, "9/1")
        assert rest == replace(here, entries=here.entries[1:], left_out=1)
        assert archive.journal(episode, "5") == ended
        assert archive.journal(episode, "5/2") == replace(
            ended, entries=ended.entries[2:], left_out=2
        )
        for nonsense in ("7", "x", "9/x", "/", "9//1"):
            assert archive.journal(episode, nonsense) is None


def test_an_episode_that_has_not_begun_has_no_journal(scenario: Scenario) -> None:
    episode = Episode(scenario, "run", silent_publishers(), required=(), wall_nanos=5)
    with pytest.raises(UserError, match="not begun"):
        episode.journal()
    JournalArchive().ends(episode)
    episode.end()


def test_a_world_whose_data_are_not_here_is_refused(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    with episode_of(scenario) as episode:
        drive(episode, 101)
        saved = episode.journal()
    check_data(saved)
    with pytest.raises(UserError, match="lacks its first 3 entries"):
        check_data(replace(saved, left_out=3))
    monkeypatch.setattr(assets, "missing", lambda digests: ["f" * 64])
    with pytest.raises(UserError, match=r"the host of physics lacks asset ffffffffffff of"):
        check_data(saved)


def test_a_run_of_other_sensors_or_another_seed_is_refused(scenario: Scenario) -> None:
    with episode_of(scenario) as episode:
        saved = episode.journal()
    check_processes(saved, replace(scenario, time=replace(scenario.time, mode="realtime")))
    name = scenario.sensor_names()[0]
    for other in (replace(scenario, seed=99), scenario.with_only(name)):
        with pytest.raises(UserError, match="start it with `groundlink up FILE`"):
            check_processes(saved, other)
