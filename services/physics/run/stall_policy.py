# SPDX-License-Identifier: Apache-2.0
"""What becomes of a run that is held up: who is named when, and what the scenario has for it.

Rule: time comes in as an argument and lines for people come out. Nobody is named before the
scenario's deadline, nobody is named twice for the same silence, and whoever was named is named
again when it is back.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from groundlink.bus.core_topics import GATEWAY
from groundlink.core.errors import RunFailed
from groundlink.messages.missing_readings import Cause, Gaps, in_words
from groundlink.messages.stalls import Stalls, by_name
from groundlink.scenario.schema import Time

from .pacer import Pacer

UNBEARABLE: frozenset[Cause] = frozenset({"overloaded", "states lost", "restarted"})
"""Causes for which readings are missing that a run was to have: what faults take away is wanted."""

START_SECONDS = 60.0
"""A process that has not followed yet may take this long, whatever the deadline: it imports, builds
its world, compiles its shaders, all of them at once on a machine that may be busy."""


class StallPolicy:
    """Looks at how long a run has been waiting for whom.

    Parameters
    ----------
    time
        the scenario's: its deadline, its mode and what gives way on overload.
    """

    def __init__(self, time: Time) -> None:
        self._time = time
        self._since: dict[str, float] = {}
        self._named: dict[str, float] = {}
        self._past_seconds: dict[str, float] = {}
        self._now = 0.0
        self._tick = 0
        self._has_told_of_loss = False

    def look(
        self,
        pacer: Pacer,
        tick: int,
        now_seconds: float,
        *,
        holding: Collection[str],
        awaited: Collection[str] = (),
    ) -> list[str]:
        """Return what is to be said of those who hold up the step to `tick`.

        To be called at each step, or attempt of one: whoever lets a step pass begins anew.

        Parameters
        ----------
        holding
            of the parties of the pace.
        awaited
            who has to be there before the run begins, whatever the policy.

        Raises
        ------
        RunFailed
            when the policy is to end the run now.
        """
        self._now, self._tick = now_seconds, tick
        lines = []
        if holding or awaited or self._named:
            lines = self._named_now(pacer, tick, {*holding, *awaited}, awaited)
        else:
            self._since.clear()
        lines += self._bear(pacer, tick)
        return lines

    def _named_now(
        self, pacer: Pacer, tick: int, holding: Collection[str], awaited: Collection[str]
    ) -> list[str]:
        self._since = {name: self._since.get(name, self._now) for name in holding}
        lines = []
        for name in sorted(self._named.keys() - holding - pacer.participants.given_up):
            after = f"after {self._end(name):.1f} s"
            if pacer.participants.has_followed(name):
                lines.append(f"{self._back(name)} is back {after}")
            else:  # It has left, or has only just come.
                lines.append(f"waits no longer for {self._list([name])}, {after}")
        late = [name for name in sorted(holding) if self._held(name) >= self._time.deadline_s]
        due = [name for name in late if name not in awaited and self._is_due(pacer, name)]
        new = [name for name in late if name not in self._named]
        self._named |= {name: self._since[name] for name in new}
        waited = f"tick {tick} has waited {self._time.deadline_s:g} s for "
        if due and self._time.overload == "fail":
            raise RunFailed(f"{waited}{self._list(due)}, and `overload: fail` ends the run")
        if new:
            lines.append(waited + self._list(new))
        if due and self._goes_on:
            for name in due:
                pacer.participants.give_up(name)
            lines.append(f"goes on without {self._list(due)} until it is heard again")
        return lines

    def lacks(self, told: Gaps) -> None:
        """Take note that readings are missing.

        Raises
        ------
        RunFailed
            when the policy is to end the run then.
        """
        lacking: Counter[str] = Counter()
        for gap in told.gaps:
            lacking[gap.cause] += gap.readings if gap.cause in UNBEARABLE else 0
        if self._time.overload == "fail" and (said := in_words(lacking)):
            raise RunFailed(f"{told.sensor} lacks readings: {said}; `overload: fail` ends the run")

    def rest(self) -> None:
        """Begin to count anew: nothing was waited for, as time stood still."""
        self._since.clear()

    def begin_anew(self) -> None:
        """Forget who is silent: the run begins again."""
        self.rest()
        self._has_told_of_loss = False
        for name in list(self._named):
            self._end(name)

    def stalls(self, pacer: Pacer) -> Stalls:
        """Return all that is known of hold-ups up to the last look."""
        silent = {name: self._now - since for name, since in self._named.items()}
        for name, seconds in self._past_seconds.items():
            silent[name] = silent.get(name, 0.0) + seconds
        behind = pacer.behind_seconds(self._tick)
        return Stalls(tuple(sorted(self._named)), silent, pacer.stretched_seconds, behind)

    @property
    def _goes_on(self) -> bool:
        """Whether a run goes on without who is silent; in real time it always does."""
        return self._time.mode == "realtime" or self._time.overload == "skip"

    def _held(self, name: str) -> float:
        return self._now - self._since[name]

    def _is_due(self, pacer: Pacer, name: str) -> bool:
        return pacer.participants.has_followed(name) or self._held(name) >= START_SECONDS

    def _bear(self, pacer: Pacer, tick: int) -> list[str]:
        """Return a line when lost time is written off for the first time; end a run that may not.

        Raises
        ------
        RunFailed
            when time has stretched by more than the deadline and must not.
        """
        if self._time.mode != "realtime":
            return []
        gone = pacer.written_off_seconds
        if self._time.overload == "fail":
            if gone + pacer.behind_seconds(tick) > self._time.deadline_s:
                stretched = pacer.stretched_seconds
                total = sum(stretched.values())
                raise RunFailed(
                    f"time has stretched by {total:.1f} s ({by_name(stretched)}), and "
                    "`overload: fail` ends the run"
                )
        elif gone and not self._has_told_of_loss and self._time.catch_up:
            self._has_told_of_loss = True
            return [
                f"the run is {gone:.1f} s behind, more than `deadline_s`, and does not catch up "
                "with that: stamps stay behind the wall clock; `groundlink reset` begins anew"
            ]
        return []

    def _end(self, name: str) -> float:
        """Note down that a silence is over; return how long it was."""
        seconds = self._now - self._named.pop(name)
        self._past_seconds[name] = self._past_seconds.get(name, 0.0) + seconds
        return seconds

    def _back(self, name: str) -> str:
        """Return who is back; a gateway that skips ROS is, though ROS's word is not."""
        if self._time.overload == "skip" and self._list([name]) != name:
            return f"{name}, with ROS's word or without it,"
        return self._list([name])

    def _list(self, names: Collection[str]) -> str:
        gives_word = GATEWAY if self._time.lockstep == "ros" else ""
        return ", ".join(f"{n} (ROS's word)" if n == gives_word else n for n in names)
