# SPDX-License-Identifier: Apache-2.0
"""How well a run goes, as physics sees it: how fast, who holds it up, what it lacks.

Rule: here is what is heard and told of it; what becomes of it is the business of `stall_policy`.
"""

from __future__ import annotations

from collections.abc import Collection

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import GAPS
from groundlink.messages.base import Health
from groundlink.messages.missing_readings import Gaps
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Time

from .episode import Episode
from .shortfalls import ShortfallMonitor
from .stall_policy import StallPolicy
from .wall_clock import RealTimeFactorMeter


class HealthMonitor:
    """Looks after a run, through all of its episodes."""

    def __init__(self, bus: Bus, run: str, time: Time) -> None:
        self._stall_policy = StallPolicy(time)
        self._factor = RealTimeFactorMeter()
        self._gaps: BusInbox[Gaps] = BusInbox(depth=256)
        self._health: BusInbox[Health] = BusInbox(depth=256)
        self._shortfalls: ShortfallMonitor | None = None
        self._scenario: Scenario | None = None
        self._declared_hz: dict[str, float] = {}
        if time.mode == "realtime":
            self._shortfalls = ShortfallMonitor(time.factor)
            bus.subscribe(HEALTH.key_in(run), Health, self._health)
        if time.overload == "fail":
            bus.subscribe(GAPS.key_in(run), Gaps, self._gaps)

    def counters(self, episode: Episode, now_seconds: float) -> dict[str, int]:
        """Return the real-time factor since the last call, and who has held up the run."""
        factor = self._factor.since_last(episode.tick, now_seconds)
        held_up = self._stall_policy.stalls(episode.pacer).counters()
        return {"real_time_permille": round(1e3 * (factor or 0.0))} | held_up

    def look(self, episode: Episode, now_seconds: float) -> list[str]:
        """Return what is to be said, at each step or attempt of one; see `Patience.look`.

        Raises
        ------
        RunFailed
            when the run is to end now.
        """
        while len(self._gaps) and (arrived := self._gaps.get(seconds=0)):
            self._stall_policy.lacks(arrived[1])
        pacer = episode.pacer
        lines = self._stall_policy.look(pacer, episode.tick + 1, now_seconds, holding=pacer.holding)
        return lines + self._changed(episode, now_seconds)

    def _changed(self, episode: Episode, now_seconds: float) -> list[str]:
        """Return what is to be said of sensors that miss readings, and of the real-time factor."""
        if self._shortfalls is None:
            return []
        while len(self._health) and (arrived := self._health.get(seconds=0)):
            self._shortfalls.heard(arrived[1], now_seconds)
        if episode.scenario is not self._scenario:
            self._scenario = episode.scenario
            self._declared_hz = {
                f"{vehicle.name}/{sensor.name}": sensor.message_rate_hz
                for vehicle in episode.scenario.vehicles
                for sensor in vehicle.sensors
            }
        stretched = episode.pacer.stretched_seconds
        return self._shortfalls.look(episode.tick, now_seconds, self._declared_hz, stretched)

    def look_for(self, awaited: Collection[str], episode: Episode, now_seconds: float) -> list[str]:
        """Return what is to be said of those who have to be there before the run begins."""
        pacer, tick = episode.pacer, episode.tick
        missing = pacer.participants.missing(tick)
        return self._stall_policy.look(pacer, tick, now_seconds, holding=missing, awaited=awaited)

    def rest(self) -> None:
        """Take note that time stands still."""
        self._stall_policy.rest()
        if self._shortfalls is not None:
            self._shortfalls.rest()

    def begin_anew(self) -> None:
        """Take note that the run begins again."""
        self._stall_policy.begin_anew()
        if self._shortfalls is not None:
            self._shortfalls.rest()
