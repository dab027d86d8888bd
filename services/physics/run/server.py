# SPDX-License-Identifier: Apache-2.0
"""Physics server: which episode runs, which processes it waits for, and what it serves to them.

Everything that changes a run happens here, between two ticks.
"""

import math
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TypeVar

import msgspec
from msgspec.structs import replace

from groundlink.bus.core_topics import GATEWAY, PHYSICS
from groundlink.bus.queries import (
    control_key,
    history_key,
    journal_key,
    ruts_key,
    scenario_key,
    world_query_key,
)
from groundlink.bus.session import Bus
from groundlink.bus.topics import process_names
from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.control import Spawn, WorldChange
from groundlink.episode.journal import Journal, dumped, loaded, parts
from groundlink.process import asset_exchange
from groundlink.scenario import Scenario
from groundlink.scenario.additions import Addition
from groundlink.scene.loaded_world import has_world, is_other_world
from groundlink.world import assets

from .control import ANSWER_SECONDS, Control
from .episode import Episode
from .health import HealthMonitor
from .peers import Peers
from .publishers import BusPublishers, Publishers, silent_publishers
from .restore import JournalArchive, JournalPlayer, Restoration, check_data, check_processes
from .source import RunSource
from .stall_policy import START_SECONDS
from .world_loading import WorldSource
from .world_queries import WorldQueryAnswers

PAUSED_SECONDS = 0.01
"""How often a paused run looks for commands."""

COMMANDS_SECONDS = 0.001
"""How often to look for commands that have not come before their acknowledgement. They end no wait.
"""

RESTORED_AT_ONCE = 200
"""Ticks that are restored between two looks for messages; some tens of milliseconds."""

T = TypeVar("T")


class PhysicsServer:
    """The episodes of a run and their connections.

    Parameters
    ----------
    required
        processes besides the sensors that the run waits for, such as a recorder.

    Attributes
    ----------
    as_loaded
        scenario of the world that was loaded last: that of the start before the first.
    world_source
        where that world was loaded from.
    is_in_loaded_world
        whether any was loaded after the start.
    """

    def __init__(
        self, source: RunSource, run: str, bus: Bus, *, required: Sequence[str] = ()
    ) -> None:
        scenario, saved, self._followed = source
        self._started, self._required = scenario, required
        self._bus, self._run = bus, run
        self.as_loaded = scenario
        self.is_in_loaded_world = False
        self.world_source = WorldSource()
        self._awaited = frozenset(required)
        if scenario.time.lockstep == "ros":
            self._awaited |= {GATEWAY}
        self._awaited_until = math.inf
        self._peers = Peers(bus, run)
        self._health = HealthMonitor(bus, run, scenario.time)
        self._accept_commands(scenario)
        self._publishers = BusPublishers(bus, run, scenario)
        self._world_changes = 0
        self._archive = JournalArchive()
        self.episode = self._new_episode(scenario, self._publishers)
        self._worlds = dict(self.episode.worlds)
        self.control = Control(self)
        self._has_begun = self._is_restored = False
        self._restoration: Restoration | None = None
        if saved is not None:
            check_data(saved)
            self._start_to_restore(saved, scenario)
            # Processes that the saved run knew are to miss nothing.
            self._awaited |= saved.acks.keys() & process_names(saved.remaining_scenario()).keys()
        bus.serve(history_key(run), self._history_for)
        bus.serve_content(control_key(run), self.control.answer)
        bus.serve_content(world_query_key(run), WorldQueryAnswers(self).answer)
        bus.serve(journal_key(run), self._journal_of)
        bus.serve(ruts_key(run), self._ruts_of)
        asset_exchange.serve(bus, run, self._scenario)
        bus.serve(scenario_key(run), self._scenario_of)

    @property
    def first_scenario(self) -> Scenario:
        """Scenario with which the run was started."""
        return self._started

    def _accept_commands(self, scenario: Scenario) -> None:
        """Accept commands for a scenario's vehicles, unless they come from a file."""
        if self._followed is None:
            self._peers.accept_commands(scenario)

    def _history_for(self, process: str) -> list[bytes]:
        return self.episode.history_for(process)

    def _scenario(self) -> Scenario:
        return self.episode.scenario

    def _scenario_of(self, world: str) -> list[bytes]:
        """Return the scenario of the world with this hash; of no hash, the present one."""
        found = self._worlds.get(world) if world else self.episode.scenario
        return [] if found is None else [msgspec.msgpack.encode(found)]

    def _journal_of(self, asked: str) -> list[bytes]:
        """Return what a query of `journal_key` asks for, in parts."""
        with suppress(UserError):
            found = self.control.between_ticks(lambda: self._archive.journal(self.episode, asked))
            return [] if found is None else parts(dumped(found))
        return []

    def _ruts_of(self, digest: str) -> list[bytes]:
        """Return the tiles of ruts with a digest, in parts."""
        with suppress(UserError, ValueError):
            asked = bytes.fromhex(digest)
            found = self.control.between_ticks(lambda: self._ruts_with(asked))
            return [] if found is None else parts(found)
        return []

    def _ruts_with(self, digest: bytes) -> bytes | None:
        history = self.episode.rut_history
        return history.with_digest(digest) if history else None

    def counters(self, now_seconds: float) -> dict[str, int]:
        """Return the counters of the process's health messages."""
        return {
            **self._peers.counters(),
            "worlds": self._world_changes,
            **self._health.counters(self.episode, now_seconds),
        }

    def wait(self, seconds: float) -> None:
        """Wait for an acknowledgement, or this long."""
        self._bus.flush()
        if self.episode.awaits_commands:
            seconds = min(seconds, COMMANDS_SECONDS)
        self._peers.wait(seconds)

    def receive(self) -> None:
        """Process all messages and run commands that have come."""
        self._peers.deliver(self.episode)
        self.control.execute_pending()

    def missing(self) -> list[str]:
        """Return the processes that must be there before the first state."""
        # After a restoration no process can have acknowledged yet; they are asked by the state.
        absent = () if self._is_restored else self.episode.pacer.participants.missing(tick=0)
        return sorted({*absent, *self._peers.not_seen(self._awaited)})

    def log_lines(self, now_seconds: float) -> list[str]:
        """Return log lines on the health of the run; see `HealthMonitor.check`."""
        if self._restoration is not None:
            self._health.pause()
            return self._restoration.progress(now_seconds)
        if not self._has_begun:
            awaited = self._peers.not_seen(self._awaited)
            return self._health.check_start(awaited, self.episode, now_seconds)
        if self.control.paused:
            self._health.pause()
            return []
        return [*self._peers.log_lines(), *self._health.check(self.episode, now_seconds)]

    def wait_seconds(self, now_seconds: float) -> float:
        """Return how long to wait before the next step; 0 for not at all.

        Publishes the first state as soon as all awaited processes are there.
        """
        if self._restoration is not None:
            return 0.0
        if now_seconds > self._awaited_until:
            self._awaited &= frozenset(self._required)
        if not self._has_begun and not self.missing():
            self._begin()
        if not self._has_begun:
            return 0.001
        if self.control.paused:
            self._publishers.states.flush()
            self.episode.pacer.restart()
            return PAUSED_SECONDS
        return self.episode.pacer.wait_seconds(self.episode.tick + 1, now_seconds)

    def step(self) -> None:
        """Step one tick and publish the new state, or restore some more of a saved run."""
        if self._restoration is not None:
            self._continue_restoration(self._restoration)
            return
        self._player.play(self.episode)
        if self.episode.world_hash not in self._worlds:
            self._adopt_world()
        self.episode.step()
        self.control.stepped(self.episode.tick)
        if self.episode.tick == self._player.until_tick:
            self.control.pause()

    def reset(self) -> None:
        """Start a new episode of the present world, with moved solids back where they began."""
        entities = self.episode.entities
        scenario = entities.moved_back(self.episode.scenario)
        episode = self._new_episode(scenario, self._publishers)
        for group in entities.groups.values():
            episode.change(Spawn(Addition(), group))
        for name, description in entities.descriptions.items():
            episode.describe(name, description)
        self._start_over(episode)

    def reset_all(self) -> None:
        """Start a new episode of the world as it was loaded."""
        self._start_over(self._new_episode(self.as_loaded, self._publishers))

    def load(self, scenario: Scenario, source: WorldSource) -> None:
        """Start a new episode in another world, paused.

        Raises
        ------
        UserError
            when the run repeats a saved one.
        """
        self._refuse_if_repeating()
        self.is_in_loaded_world = True
        episode = self._new_episode(scenario, self._publishers)
        self.as_loaded, self.world_source = scenario, source
        self.control.pause()
        self._start_over(episode)

    def known_worlds(self) -> dict[str, Scenario]:
        """Return the scenarios of all worlds so far, by their hashes."""
        return dict(self._worlds)

    def refuse_without_world(self) -> None:
        """Refuse to go on while no world is loaded.

        Raises
        ------
        UserError
            without a world.
        """
        if not has_world(self.episode.scenario):
            raise UserError("no world is loaded. Fix: load one")

    def reset_state(self) -> None:
        """Put everything back where it began, without a new episode."""
        self.episode.reset_state()
        self._adopt_world()

    def _start_over(self, episode: Episode) -> None:
        is_same_world = episode.world_hash == self.episode.world_hash
        self._replace_episode(episode)
        if not is_same_world:
            self._adopt_world()
        self.control.stepped(0)
        if self._has_begun:
            # All processes are there; in a fast run they have to acknowledge the first state.
            self._begin()

    def refuse_while_restoring(self) -> None:
        """Refuse a change while a saved run is restored.

        Raises
        ------
        UserError
            while that goes on.
        """
        self.control.refuse_while_restoring()

    def between_ticks(self, do: Callable[[], T], *, seconds: float = ANSWER_SECONDS) -> T:
        """Have the loop call a function between two ticks; return what it returns."""
        return self.control.between_ticks(do, seconds=seconds)

    def change(self, command: WorldChange) -> None:
        """Add something to the world, remove or move it.

        Raises
        ------
        UserError
            when it cannot be added or moved, or is not there.
        """
        if isinstance(command, Spawn) and (
            lacking := assets.missing(asset_exchange.needed(command.more))
        ):
            raise UserError(
                f"this host lacks asset {lacking[0][:12]}. Fix: spawn meshes from the "
                "host where physics runs"
            )
        self.episode.change(command)
        self._adopt_world()

    def restore(self, content: bytes) -> None:
        """Start to restore a saved run from its file's content.

        Raises
        ------
        UserError
            when it does not fit this run.
        """
        saved = loaded(content, "what was sent")
        self._refuse_if_repeating()
        check_processes(saved, self._started)
        check_data(saved)
        time = replace(self._started.time, checkpoint_s=saved.scenario.time.checkpoint_s)
        self._start_to_restore(saved, replace(saved.scenario, time=time))

    def _refuse_if_repeating(self) -> None:
        if self._followed is not None:
            raise UserError(
                "the run repeats a saved one and takes no commands. Fix: start another run"
            )

    def _start_to_restore(self, saved: Journal, scenario: Scenario) -> None:
        self.is_in_loaded_world |= bool(saved.in_loaded_world)
        try:
            episode = self._new_episode(
                scenario, silent_publishers(), saved.epoch_nanos, saved.checkpoint or None
            )
        except (msgspec.MsgspecError, ValueError) as error:
            raise UserError(
                f"the saved run's checkpoint does not fit its scenario ({error}). Fix: record the "
                "run again with this version of Groundlink"
            ) from None
        episode.begin(time.time_ns(), time.monotonic())
        self._restoration = Restoration(saved, episode)
        self.control.restoring_to = saved.tick
        self.control.warning = self.control.failure = ""

    def _continue_restoration(self, restoration: Restoration) -> None:
        """Restore some more; when all is restored, continue from there."""
        control, warning, failure = self.control, "", ""
        control.tick = restoration.episode.tick
        try:
            if not restoration.advance(RESTORED_AT_ONCE):
                return
            warning = restoration.difference()
        except (ValueError, KeyError, UserError) as problem:
            what = f"there is no vehicle {problem}" if isinstance(problem, KeyError) else problem
            failure = f"the saved run cannot be replayed here, at tick {control.tick}: {what}"
            if not self._has_begun:
                raise UserError(failure) from None
            restoration.episode.end()
            self.episode.pacer.restart()
        else:
            self._is_restored = True
            if self._started.time.mode == "realtime":
                self._awaited_until = time.monotonic() + START_SECONDS
            self._replace_episode(restoration.episode)
            self._adopt_world()
            self._restored_world(restoration.first_scenario)
            if self._has_begun:
                self._begin()
        self._restoration = None
        control.warning, control.failure = warning, failure
        control.tick = self.episode.tick
        control.restoring_to = -1
        if line := warning or failure:
            print(f"{PHYSICS}: {line}", file=sys.stderr, flush=True)

    def _restored_world(self, first: Scenario) -> None:
        """Take over the world of a restored run; without one, time stands still."""
        if is_other_world(first, self.as_loaded):
            self.as_loaded, self.world_source = first, WorldSource()
        if not has_world(first):
            self.control.pause()

    def _replace_episode(self, episode: Episode) -> None:
        self._archive.ends(self.episode)
        self.episode.end()
        self._health.reset()
        self.episode = episode

    def _adopt_world(self) -> None:
        """Accept commands, publish and serve for the episode's world, before its next state."""
        episode = self.episode
        self._accept_commands(episode.scenario)
        self._publishers.declare(episode.scenario)
        episode.publish = self._publishers
        self._worlds |= episode.worlds
        self._world_changes += 1

    def _begin(self) -> None:
        self.episode.begin(time.time_ns(), time.monotonic())
        self._has_begun = True

    def _new_episode(
        self,
        scenario: Scenario,
        publishers: Publishers,
        epoch_nanos: int | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Episode:
        if self._followed is not None:
            epoch_nanos = self._followed.epoch_nanos
            checkpoint = self._followed.checkpoint or None
        self._player = JournalPlayer(self._followed)
        episode = Episode(
            *(scenario, self._run, publishers),
            required=self._required,
            wall_nanos=time.time_ns(),
            epoch_nanos=epoch_nanos,
            in_loaded_world=self.is_in_loaded_world,
            checkpoint=checkpoint,
        )
        if checkpoint is not None:
            episode.take_over(checkpoint.acks)
        return episode

    def close(self) -> None:
        """End the simulation."""
        self.episode.end()
