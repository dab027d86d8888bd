# SPDX-License-Identifier: Apache-2.0
"""Stall policy: when to report a process that stopped responding, and what to do about it.

Time comes in as an argument, log lines come out. A process is reported once it has held up the run
for the scenario's deadline, once per stall, and again when it responds.
"""

from collections import Counter
from collections.abc import Collection

from groundlink.bus.core_topics import GATEWAY
from groundlink.core.errors import RunFailed
from groundlink.messages.missing_readings import Cause, MissingReadings, in_words
from groundlink.messages.stalls import Stalls, by_name
from groundlink.scenario.schema import Time

from .pacer import StepPacer

FATAL_CAUSES: frozenset[Cause] = frozenset({"overloaded", "states lost", "restarted"})
"""Causes of missing readings that `overload: fail` does not accept; faults are intended."""

START_SECONDS = 60.0
"""Time that a process has for its first acknowledgement, whatever the deadline: it imports, builds
its world and compiles its shaders, at the same time as all others."""


class StallPolicy:
    """Applies a scenario's deadline and `overload` policy.

    Parameters
    ----------
    time
        gives the deadline, the time mode and the policy.
    """

    def __init__(self, time: Time) -> None:
        self._time = time
        self._since: dict[str, float] = {}
        self._reported: dict[str, float] = {}
        self._past_seconds: dict[str, float] = {}
        self._now = 0.0
        self._tick = 0
        self._has_reported_loss = False

    def check(
        self,
        pacer: StepPacer,
        tick: int,
        now_seconds: float,
        *,
        holding: Collection[str],
        awaited: Collection[str] = (),
    ) -> list[str]:
        """Return log lines on the processes that hold up the step to `tick`.

        To be called at each step or attempt of one: a stall ends with the next step.

        Parameters
        ----------
        holding
            participants that hold up the step.
        awaited
            processes that must be there before the run begins, whatever the policy.

        Raises
        ------
        RunFailed
            when the policy ends the run now.
        """
        self._now, self._tick = now_seconds, tick
        lines = []
        if holding or awaited or self._reported:
            lines = self._report(pacer, tick, {*holding, *awaited}, awaited)
        else:
            self._since.clear()
        return lines + self._check_lost_time(pacer, tick)

    def _report(
        self, pacer: StepPacer, tick: int, holding: Collection[str], awaited: Collection[str]
    ) -> list[str]:
        participants = pacer.participants
        self._since = {name: self._since.get(name, self._now) for name in holding}
        lines = []
        for name in sorted(self._reported.keys() - holding - participants.absent):
            after = f"after {self._end(name):.1f} s"
            if participants.has_followed(name):
                lines.append(f"{self._names([name])} is responding again {after}")
            else:  # It has left, or has only just joined.
                lines.append(f"stopped waiting for {self._names([name])} {after}")
        late = [name for name in sorted(holding) if self._held(name) >= self._time.deadline_s]
        due = [name for name in late if name not in awaited and self._is_due(pacer, name)]
        new = [name for name in late if name not in self._reported]
        self._reported |= {name: self._since[name] for name in new}
        waited = f"tick {tick} has waited {self._time.deadline_s:g} s for "
        if due and self._time.overload == "fail":
            raise RunFailed(f"{waited}{self._names(due)}; run aborted by `overload: fail`")
        if new:
            lines.append(waited + self._names(new))
        if due and self._goes_on:
            for name in due:
                participants.mark_absent(name)
            lines.append(f"continuing without {self._names(due)} until it responds")
        return lines

    def missing_readings(self, reported: MissingReadings) -> None:
        """Check gaps that a sensor has reported.

        Raises
        ------
        RunFailed
            when the policy ends the run for them.
        """
        lacking: Counter[str] = Counter()
        for gap in reported.gaps:
            lacking[gap.cause] += gap.readings if gap.cause in FATAL_CAUSES else 0
        if self._time.overload == "fail" and (causes := in_words(lacking)):
            raise RunFailed(
                f"{reported.sensor}: missing readings: {causes}; run aborted by `overload: fail`"
            )

    def pause(self) -> None:
        """Restart all measurements of waiting: time stood still."""
        self._since.clear()

    def reset(self) -> None:
        """End all stalls: a new episode begins."""
        self.pause()
        self._has_reported_loss = False
        for name in list(self._reported):
            self._end(name)

    def stalls(self, pacer: StepPacer) -> Stalls:
        """Return all stalls up to the last check."""
        silent = {name: self._now - since for name, since in self._reported.items()}
        for name, seconds in self._past_seconds.items():
            silent[name] = silent.get(name, 0.0) + seconds
        behind = pacer.behind_seconds(self._tick)
        return Stalls(tuple(sorted(self._reported)), silent, pacer.stretched_seconds, behind)

    @property
    def _goes_on(self) -> bool:
        """Whether the run continues without a stalled process; in real time it always does."""
        return self._time.mode == "realtime" or self._time.overload == "skip"

    def _held(self, name: str) -> float:
        return self._now - self._since[name]

    def _is_due(self, pacer: StepPacer, name: str) -> bool:
        return pacer.participants.has_followed(name) or self._held(name) >= START_SECONDS

    def _check_lost_time(self, pacer: StepPacer, tick: int) -> list[str]:
        """Return a line when lost time is written off for the first time.

        Raises
        ------
        RunFailed
            when time has stretched by more than the deadline, and the policy does not allow it.
        """
        if self._time.mode != "realtime":
            return []
        gone = pacer.written_off_seconds
        if self._time.overload == "fail":
            if gone + pacer.behind_seconds(tick) > self._time.deadline_s:
                stretched = pacer.stretched_seconds
                total = sum(stretched.values())
                raise RunFailed(
                    f"time has stretched by {total:.1f} s ({by_name(stretched)}); run aborted by "
                    "`overload: fail`"
                )
        elif gone and not self._has_reported_loss and self._time.catch_up:
            self._has_reported_loss = True
            return [
                f"the run is {gone:.1f} s behind, more than `deadline_s`, and does not catch up: "
                "stamps stay behind the wall clock. `groundlink reset` starts a new episode"
            ]
        return []

    def _end(self, name: str) -> float:
        """End a stall; return how long it was."""
        seconds = self._now - self._reported.pop(name)
        self._past_seconds[name] = self._past_seconds.get(name, 0.0) + seconds
        return seconds

    def _names(self, names: Collection[str]) -> str:
        waits_for_ros = GATEWAY if self._time.lockstep == "ros" else ""
        return ", ".join(f"{n} (waits for ROS)" if n == waits_for_ros else n for n in names)
