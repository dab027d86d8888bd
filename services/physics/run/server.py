# SPDX-License-Identifier: Apache-2.0
"""The run's authority: which life it lives, who is waited for, what it goes on with.

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
from .episode import Life
from .health import Watch
from .peers import Company
from .publishers import Outlets, outlets, unheard
from .restore import Archive, Following, Restoring, check_data, check_processes
from .stall_policy import START_SECONDS

PAUSED_SECONDS = 0.01
"""How often a run that is paused looks whether it shall go on."""

RESTORED_AT_ONCE = 200
"""Ticks between two looks at what others say; they take some tens of milliseconds."""


class Physics:
    """The run's authority: its lives, the bus, and who is waited for.

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
        self._company = Company(bus, run)
        self._watch = Watch(bus, run, scenario.time)
        self._bus = bus
        self._obey(scenario)
        self._outlets = outlets(bus, run, scenario)
        self._changes = 0
        self._archive = Archive()
        self.life = self._new_life(scenario)
        self._worlds = dict(self.life.worlds)
        self.control = Control(self.reset, self.change, self.restore)
        self._has_begun = self._is_restored = False
        self._restoring: Restoring | None = None
        if saved is not None:
            check_data(saved)
            self._restore(saved, scenario)
            # Those that it knows are to miss nothing.
            self._awaited |= saved.acks.keys() & process_names(saved.still_there()).keys()
        bus.serve(history_key(run), lambda name: self.life.missed_by(name))
        bus.serve_content(control_key(run), self.control.answer)
        bus.serve(journal_key(run), self._journal_of)
        asset_exchange.serve(bus, run, lambda: self.life.scenario)
        bus.serve(scenario_key(run), self._scenario_of)

    def _obey(self, scenario: Scenario) -> None:
        """Take commands for a scenario's vehicles, unless they come from a file."""
        if self._followed is None:
            self._company.obey(scenario)

    def _scenario_of(self, world: str) -> list[bytes]:
        """Return the scenario of the world with this hash; of no hash, as it is now."""
        found = self._worlds.get(world) if world else self.life.scenario
        return [] if found is None else [msgspec.msgpack.encode(found)]

    def _journal_of(self, asked: str) -> list[bytes]:
        """Return what a query of `journal_key` asks for, in parts."""
        with suppress(UserError):
            found = self.control.between_ticks(lambda: self._archive.journal(self.life, asked))
            return [] if found is None else parts(dumped(found))
        return []

    def counters(self, now_seconds: float) -> dict[str, int]:
        """Return what a person who looks after the run wants to see."""
        return {
            **self._company.counters(),
            "worlds": self._changes,
            **self._watch.counters(self.life, now_seconds),
        }

    def rest(self, seconds: float) -> None:
        """Do nothing for so long, or until somebody else has come further."""
        self._company.wait(seconds)

    def hear(self) -> None:
        """Take in what other processes and people have said, and who has left."""
        self._company.tell(self.life)
        self.control.fulfil()

    def missing(self) -> list[str]:
        """Return who has to be there before the first state."""
        # In what was restored nobody can have said anything yet; they are asked when they hear it.
        absent = () if self._is_restored else self.life.pace.parties.missing(tick=0)
        return sorted({*absent, *self._company.lacks(self._awaited)})

    def told(self, now_seconds: float) -> list[str]:
        """Return what is to be said of how the run goes; see `Watch.look`."""
        if self._restoring is not None:
            self._watch.rest()
            return self._restoring.progress(now_seconds)
        if not self._has_begun:
            awaited = self._company.lacks(self._awaited)
            return self._watch.look_for(awaited, self.life, now_seconds)
        if self.control.paused:
            self._watch.rest()
            return []
        return self._watch.look(self.life, now_seconds)

    def wait_seconds(self, now_seconds: float) -> float:
        """Return how long to wait before the next step; 0 for not at all.

        The first state is published as soon as all hear it who are waited for.
        """
        if self._restoring is not None:
            return 0.0
        if now_seconds > self._awaited_until:
            self._awaited &= frozenset(self._others)
        if not self._has_begun and not self.missing():
            self._begin()
        if not self._has_begun:
            return 0.001
        if self.control.paused:
            self.life.pace.hold()
            return PAUSED_SECONDS
        return self.life.pace.wait_seconds(self.life.tick + 1, now_seconds)

    def step(self) -> None:
        """Step one tick and publish what has become of the world, or restore some more of it."""
        if self._restoring is not None:
            self._restore_on(self._restoring)
            return
        self._following.tell(self.life)
        if self.life.world_hash not in self._worlds:
            self._go_on_in_this_world()
        self.life.step()
        self.control.stepped(self.life.tick)
        if self.life.tick == self._following.until_tick:
            self.control.pause()

    def reset(self) -> None:
        """Begin another life with everything at its start."""
        self._replace_life(self._new_life(self.life.scenario))
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
        life = self._new_life(scenario, unheard(), epoch_nanos=saved.epoch_nanos)
        life.begin(time.time_ns(), time.monotonic())
        self._restoring = Restoring(saved, life)
        self.control.restoring_to = saved.tick
        self.control.warning = self.control.failure = ""

    def _restore_on(self, restoring: Restoring) -> None:
        """Restore some more; go on from there when all of it is done."""
        control, warning, failure = self.control, "", ""
        control.tick = restoring.life.tick
        try:
            if not restoring.go_on(RESTORED_AT_ONCE):
                return
            warning = restoring.difference()
        except (ValueError, KeyError, UserError) as problem:
            what = f"there is no vehicle {problem}" if isinstance(problem, KeyError) else problem
            failure = f"the saved run cannot be done again here, at tick {control.tick}: {what}"
            if not self._has_begun:
                raise UserError(failure) from None
            restoring.life.end()
            self.life.pace.hold()
        else:
            self._is_restored = True
            if self._started.time.mode == "realtime":
                self._awaited_until = time.monotonic() + START_SECONDS
            self._replace_life(restoring.life)
            self._go_on_in_this_world()
            if self._has_begun:
                self._begin()
        self._restoring = None
        control.warning, control.failure = warning, failure
        control.tick = self.life.tick
        control.restoring_to = -1
        if said := warning or failure:
            print(f"{PHYSICS}: {said}", file=sys.stderr, flush=True)

    def _replace_life(self, life: Life) -> None:
        self._archive.ends(self.life)
        self.life.end()
        self._watch.begin_anew()
        self.life = life

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
        self.life.change(wish)
        self._go_on_in_this_world()

    def _go_on_in_this_world(self) -> None:
        """Hear, publish and serve what goes with the life's world; before its next state."""
        life = self.life
        self._obey(life.scenario)
        self._outlets = outlets(self._bus, self._run, life.scenario, self._outlets)
        life.publish = self._outlets
        self._worlds |= life.worlds
        self._changes += 1

    def _begin(self) -> None:
        self.life.begin(time.time_ns(), time.monotonic())
        self._has_begun = True

    def _new_life(
        self, scenario: Scenario, publish: Outlets | None = None, epoch_nanos: int | None = None
    ) -> Life:
        if followed := self._followed:
            epoch_nanos = followed.epoch_nanos
        self._following = Following(followed)
        return Life(
            *(scenario, self._run, publish or self._outlets),
            others=self._others,
            wall_nanos=time.time_ns(),
            epoch_nanos=epoch_nanos,
        )

    def close(self) -> None:
        """End the simulation."""
        self.life.end()
