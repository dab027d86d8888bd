# SPDX-License-Identifier: Apache-2.0
"""The run's authority: which episode it episodes, who is waited for, what it goes on with.

Rule: the only one that says what tick it is. Everything that changes a run happens here, between
two ticks; the loop around it is the process's own.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from contextlib import suppress

import msgspec
from msgspec.structs import replace

from groundlink.bus.core_topics import GATEWAY, PHYSICS
from groundlink.bus.queries import control_key, history_key, journal_key, scenario_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import process_names
from groundlink.core.errors import UserError
from groundlink.messages.control import Remove, Spawn
from groundlink.process import asset_exchange
from groundlink.run.journal import Journal, dumped, loaded, parts
from groundlink.scenario import Scenario
from groundlink.world import assets

from .control import Control
from .episode import Episode
from .health import HealthMonitor
from .peers import Peers
from .publishers import Publishers, declare_publishers, silent_publishers
from .restore import JournalArchive, JournalPlayer, Restoration, check_data, check_processes
from .stall_policy import START_SECONDS

PAUSED_SECONDS = 0.01
"""How often a run that is paused looks whether it shall go on."""

RESTORED_AT_ONCE = 200
"""Ticks between two looks at what others say; they take some tens of milliseconds."""


class PhysicsServer:
    """The run's authority: its episodes, the bus, and who is waited for.

    Parameters
    ----------
    saved, followed
        what it goes on from or does again, see `Source`.
    others
        processes beside the sensors without which a run does not begin, such as a recorder.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        bus: Bus,
        *,
        saved: Journal | None = None,
        followed: Journal | None = None,
        others: Sequence[str] = (),
    ) -> None:
        self._started, self._run, self._others = scenario, run, others
        self._followed = followed
        words = (GATEWAY,) if scenario.time.lockstep == "ros" else ()
        self._awaited = frozenset((*others, *words))
        self._awaited_until = math.inf
        self._peers = Peers(bus, run)
        self._health = HealthMonitor(bus, run, scenario.time)
        self._bus = bus
        self._obey(scenario)
        self._publishers = declare_publishers(bus, run, scenario)
        self._changes = 0
        self._archive = JournalArchive()
        self.episode = self._new_episode(scenario)
        self._worlds = dict(self.episode.worlds)
        self.control = Control(self.reset, self.change, self.restore)
        self._has_begun = self._is_restored = False
        self._restoration: Restoration | None = None
        if saved is not None:
            check_data(saved)
            self._restore(saved, scenario)
            # Those that it knows are to miss nothing.
            self._awaited |= saved.acks.keys() & process_names(saved.still_there()).keys()
        bus.serve(history_key(run), lambda name: self.episode.missed_by(name))
        bus.serve_content(control_key(run), self.control.answer)
        bus.serve(journal_key(run), self._journal_of)
        asset_exchange.serve(bus, run, lambda: self.episode.scenario)
        bus.serve(scenario_key(run), self._scenario_of)

    def _obey(self, scenario: Scenario) -> None:
        """Take commands for a scenario's vehicles, unless they come from a file."""
        if self._followed is None:
            self._peers.obey(scenario)

    def _scenario_of(self, world: str) -> list[bytes]:
        """Return the scenario of the world with this hash; of no hash, as it is now."""
        found = self._worlds.get(world) if world else self.episode.scenario
        return [] if found is None else [msgspec.msgpack.encode(found)]

    def _journal_of(self, asked: str) -> list[bytes]:
        """Return what a query of `journal_key` asks for, in parts."""
        with suppress(UserError):
            found = self.control.between_ticks(lambda: self._archive.journal(self.episode, asked))
            return [] if found is None else parts(dumped(found))
        return []

    def counters(self, now_seconds: float) -> dict[str, int]:
        """Return what a person who looks after the run wants to see."""
        return {
            **self._peers.counters(),
            "worlds": self._changes,
            **self._health.counters(self.episode, now_seconds),
        }

    def rest(self, seconds: float) -> None:
        """Do nothing for so long, or until somebody else has come further."""
        self._peers.wait(seconds)

    def hear(self) -> None:
        """Take in what other processes and people have said, and who has left."""
        self._peers.tell(self.episode)
        self.control.fulfil()

    def missing(self) -> list[str]:
        """Return who has to be there before the first state."""
        # In what was restored nobody can have said anything yet; they are asked when they hear it.
        absent = () if self._is_restored else self.episode.pacer.participants.missing(tick=0)
        return sorted({*absent, *self._peers.lacks(self._awaited)})

    def told(self, now_seconds: float) -> list[str]:
        """Return what is to be said of how the run goes; see `Watch.look`."""
        if self._restoration is not None:
            self._health.rest()
            return self._restoration.progress(now_seconds)
        if not self._has_begun:
            awaited = self._peers.lacks(self._awaited)
            return self._health.look_for(awaited, self.episode, now_seconds)
        if self.control.paused:
            self._health.rest()
            return []
        return self._health.look(self.episode, now_seconds)

    def wait_seconds(self, now_seconds: float) -> float:
        """Return how long to wait before the next step; 0 for not at all.

        The first state is published as soon as all hear it who are waited for.
        """
        if self._restoration is not None:
            return 0.0
        if now_seconds > self._awaited_until:
            self._awaited &= frozenset(self._others)
        if not self._has_begun and not self.missing():
            self._begin()
        if not self._has_begun:
            return 0.001
        if self.control.paused:
            self.episode.pacer.hold()
            return PAUSED_SECONDS
        return self.episode.pacer.wait_seconds(self.episode.tick + 1, now_seconds)

    def step(self) -> None:
        """Step one tick and publish what has become of the world, or restore some more of it."""
        if self._restoration is not None:
            self._restore_on(self._restoration)
            return
        self._player.tell(self.episode)
        if self.episode.world_hash not in self._worlds:
            self._go_on_in_this_world()
        self.episode.step()
        self.control.stepped(self.episode.tick)
        if self.episode.tick == self._player.until_tick:
            self.control.pause()

    def reset(self) -> None:
        """Begin another episode with everything at its start."""
        self._replace_episode(self._new_episode(self.episode.scenario))
        self.control.stepped(0)
        if self._has_begun:
            # Others are there; a fast run waits for their words on its first state.
            self._begin()

    def restore(self, content: bytes) -> None:
        """Begin to go on from where a saved run was; `content` is its file's.

        Raises
        ------
        UserError
            when that cannot be.
        """
        saved = loaded(content, "what was sent")
        if self._followed is not None:
            raise UserError("the run does again what a saved one did; start another one")
        check_processes(saved, self._started)
        check_data(saved)
        self._restore(saved, replace(saved.scenario, time=self._started.time))

    def _restore(self, saved: Journal, scenario: Scenario) -> None:
        episode = self._new_episode(scenario, silent_publishers(), epoch_nanos=saved.epoch_nanos)
        episode.begin(time.time_ns(), time.monotonic())
        self._restoration = Restoration(saved, episode)
        self.control.restoring_to = saved.tick
        self.control.warning = self.control.failure = ""

    def _restore_on(self, restoring: Restoration) -> None:
        """Restore some more; go on from there when all of it is done."""
        control, warning, failure = self.control, "", ""
        control.tick = restoring.episode.tick
        try:
            if not restoring.go_on(RESTORED_AT_ONCE):
                return
            warning = restoring.difference()
        except (ValueError, KeyError, UserError) as problem:
            what = f"there is no vehicle {problem}" if isinstance(problem, KeyError) else problem
            failure = f"the saved run cannot be done again here, at tick {control.tick}: {what}"
            if not self._has_begun:
                raise UserError(failure) from None
            restoring.episode.end()
            self.episode.pacer.hold()
        else:
            self._is_restored = True
            if self._started.time.mode == "realtime":
                self._awaited_until = time.monotonic() + START_SECONDS
            self._replace_episode(restoring.episode)
            self._go_on_in_this_world()
            if self._has_begun:
                self._begin()
        self._restoration = None
        control.warning, control.failure = warning, failure
        control.tick = self.episode.tick
        control.restoring_to = -1
        if said := warning or failure:
            print(f"{PHYSICS}: {said}", file=sys.stderr, flush=True)

    def _replace_episode(self, episode: Episode) -> None:
        self._archive.ends(self.episode)
        self.episode.end()
        self._health.begin_anew()
        self.episode = episode

    def change(self, wish: Spawn | Remove) -> None:
        """Put something into the world or take it out.

        Raises
        ------
        UserError
            when that cannot be.
        """
        if isinstance(wish, Spawn) and (
            lacking := assets.missing(asset_exchange.needed(wish.more))
        ):
            raise UserError(
                f"this machine lacks the data {lacking[0][:12]}; spawn meshes from the machine "
                "where physics runs"
            )
        self.episode.change(wish)
        self._go_on_in_this_world()

    def _go_on_in_this_world(self) -> None:
        """Hear, publish and serve what goes with the episode's world; before its next state."""
        episode = self.episode
        self._obey(episode.scenario)
        self._publishers = declare_publishers(
            self._bus, self._run, episode.scenario, self._publishers
        )
        episode.publish = self._publishers
        self._worlds |= episode.worlds
        self._changes += 1

    def _begin(self) -> None:
        self.episode.begin(time.time_ns(), time.monotonic())
        self._has_begun = True

    def _new_episode(
        self, scenario: Scenario, publish: Publishers | None = None, epoch_nanos: int | None = None
    ) -> Episode:
        if followed := self._followed:
            epoch_nanos = followed.epoch_nanos
        self._player = JournalPlayer(followed)
        return Episode(
            *(scenario, self._run, publish or self._publishers),
            others=self._others,
            wall_nanos=time.time_ns(),
            epoch_nanos=epoch_nanos,
        )

    def close(self) -> None:
        """End the simulation."""
        self.episode.end()
