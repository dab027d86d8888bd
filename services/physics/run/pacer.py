# SPDX-License-Identifier: Apache-2.0
"""When physics may take its next step: by the wall clock and by its participants' progress.

Time and acknowledgements come in as arguments. A pacer returns how long to wait; it does not wait
itself. `stall_policy` decides what to do about a participant that holds up the run.
"""

from collections.abc import Sequence
from math import inf

from groundlink.bus.core_topics import GATEWAY, PHYSICS, RECORDER
from groundlink.bus.topics import driver_names
from groundlink.messages.base import Ack
from groundlink.scenario import Scenario
from groundlink.scenario.route import DRIVER_WINDOW_TICKS

from .participants import Participants, barriers, window
from .wall_clock import NoWallClock, WallClock

SLOW_AT_ONCE_SECONDS = 0.2
"""Lateness that is made up for at once where time may stretch: ages of data hardly show it."""

SKIP_AT_ONCE_SECONDS = 3.0
"""Lateness that is made up for at once where time may not stretch: more than a busy machine keeps
one process from running. The 1,200 states that then come at once are below the 4,096 that a
sensor's process buffers."""

RETRY_SECONDS = 0.01
"""Longest wait for an acknowledgement, which ends the wait when it comes. With a tenth of it,
waiting took as much processor time as stepping."""


class StepPacer:
    """Grants steps.

    Parameters
    ----------
    wall_clock
        says when a tick is due.
    participants
        the processes that have to follow.

    Attributes
    ----------
    holding
        participants that made the last call of `wait_seconds` return a wait.
    stretched_seconds
        wall time that the run has lost, caught up with or not, by the process that caused it.
    """

    def __init__(self, wall_clock: WallClock, participants: Participants) -> None:
        self._wall_clock, self.participants = wall_clock, participants
        self._held: dict[str, float] = {}
        self.holding: Sequence[str] = ()
        self._held_from = 0.0
        self.stretched_seconds: dict[str, float] = {}

    def wait_seconds(self, tick: int, now_seconds: float) -> float:
        """Return how long to wait at `now_seconds` before stepping to `tick`; 0 for not at all."""
        late = self._wall_clock.late_seconds(tick, now_seconds)
        missing = self.participants.missing(tick) if late >= 0 else ()
        self._blame(missing, now_seconds)
        if late <= 0:
            self._held.clear()
        if lost := self._wall_clock.lost_seconds(tick, now_seconds):
            self._charge(lost)
        return max(-late, RETRY_SECONDS if missing else 0.0)

    def behind_seconds(self, tick: int) -> float:
        """Return the wall time that the run has still to catch up with at a tick."""
        return self._wall_clock.debt_seconds(tick)

    @property
    def written_off_seconds(self) -> float:
        """Wall time that the run has lost and does not catch up with."""
        return self._wall_clock.written_off_seconds

    def restart(self) -> None:
        """Make the next tick due when it is asked for: time stood still."""
        self._wall_clock.restart()
        self.holding = ()

    def _blame(self, missing: Sequence[str], now_seconds: float) -> None:
        """Charge each process that held up a due step with an equal share of the time."""
        for process in self.holding:
            share = (now_seconds - self._held_from) / len(self.holding)
            self._held[process] = self._held.get(process, 0.0) + share
        self.holding, self._held_from = missing, now_seconds

    def _charge(self, seconds: float) -> None:
        """Add lost time to its causes; time that no process held up was lost by physics itself."""
        held = sum(self._held.values())
        scale = min(1.0, seconds / held) if held else 0.0
        causes = {process: scale * share for process, share in self._held.items()}
        if seconds > held:
            causes[PHYSICS] = seconds - held
        for process, share in causes.items():
            self.stretched_seconds[process] = self.stretched_seconds.get(process, 0.0) + share
        self._held.clear()


def pacer_for(scenario: Scenario, episode: int, required: Sequence[str]) -> StepPacer:
    """Return the pacer of a scenario's time mode.

    Parameters
    ----------
    required
        processes besides its sensors and drivers that a run in lockstep waits for.
    """
    time = scenario.time
    ahead = window(time.window_ticks)
    if time.mode == "realtime":
        present = (*scenario.sensor_names(), RECORDER) if time.waits else ()
        at_once, most = (
            (SLOW_AT_ONCE_SECONDS, time.deadline_s) if time.waits else (SKIP_AT_ONCE_SECONDS, inf)
        )
        if not time.catch_up:
            most = 0.0
        wall_clock = WallClock(time.factor, at_once, slew=time.catch_up, most_debt_seconds=most)
        return StepPacer(wall_clock, Participants(dict.fromkeys(present, ahead), episode=episode))
    allowances = dict.fromkeys((*scenario.sensor_names(), *required), ahead)
    allowances |= dict.fromkeys(driver_names(scenario), window(DRIVER_WINDOW_TICKS))
    if time.lockstep == "ros":
        allowances[GATEWAY] = barriers(time.ack_ticks)
    participants = Participants(allowances, needed=allowances, of_others=ahead, episode=episode)
    if time.lockstep == "ros":
        # The gateway acknowledges nothing before it has the first state.
        participants.acknowledged(GATEWAY, Ack(episode, -1, -1))
    wall_clock = (
        NoWallClock() if time.mode == "fast" else WallClock(time.factor, SLOW_AT_ONCE_SECONDS)
    )
    return StepPacer(wall_clock, participants)
