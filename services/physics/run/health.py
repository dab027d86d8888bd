# SPDX-License-Identifier: Apache-2.0
"""Health of a run as physics sees it: its speed, stalled processes and missing readings."""

from collections.abc import Collection

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import MISSING_READINGS
from groundlink.messages.base import Health
from groundlink.messages.missing_readings import MissingReadings
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Time

from .episode import Episode
from .shortfalls import ShortfallMonitor
from .stall_policy import StallPolicy
from .wall_clock import RealTimeFactorMeter


class HealthMonitor:
    """Monitors a run through all of its episodes."""

    def __init__(self, bus: Bus, run: str, time: Time) -> None:
        self._stall_policy = StallPolicy(time)
        self._factor = RealTimeFactorMeter()
        self._missing: BusInbox[MissingReadings] = BusInbox(depth=256)
        self._health: BusInbox[Health] = BusInbox(depth=256)
        self._shortfalls: ShortfallMonitor | None = None
        self._is_told_of_ruts = False
        self._scenario: Scenario | None = None
        self._declared_hz: dict[str, float] = {}
        if time.mode == "realtime":
            self._shortfalls = ShortfallMonitor(time.factor)
            bus.subscribe(HEALTH.key_in(run), Health, self._health)
        if time.overload == "fail":
            bus.subscribe(MISSING_READINGS.key_in(run), MissingReadings, self._missing)

    def counters(self, episode: Episode, now_seconds: float) -> dict[str, int]:
        """Return the real-time factor since the last call, all stalls, and the tiles of ruts."""
        factor = self._factor.since_last(episode.tick, now_seconds)
        stalls = self._stall_policy.stalls(episode.pacer).counters()
        ruts = {"rut_tiles": episode.ruts.count} if episode.ruts else {}
        return {"real_time_permille": round(1e3 * (factor or 0.0))} | stalls | ruts

    def check(self, episode: Episode, now_seconds: float) -> list[str]:
        """Return log lines, at each step or attempt of one; see `StallPolicy.check`.

        Raises
        ------
        RunFailed
            when the run is to end now.
        """
        while len(self._missing) and (arrived := self._missing.get(seconds=0)):
            self._stall_policy.missing_readings(arrived[1])
        pacer = episode.pacer
        lines = self._stall_policy.check(
            pacer, episode.tick + 1, now_seconds, holding=pacer.holding
        )
        return [*lines, *self._check_shortfalls(episode, now_seconds), *self._check_ruts(episode)]

    def _check_ruts(self, episode: Episode) -> list[str]:
        if self._is_told_of_ruts or episode.ruts is None or not episode.ruts.is_full:
            return []
        self._is_told_of_ruts = True
        return [f"terrain: {episode.ruts.count} tiles of ruts are full; further ruts do not stay"]

    def _check_shortfalls(self, episode: Episode, now_seconds: float) -> list[str]:
        if self._shortfalls is None:
            return []
        while len(self._health) and (arrived := self._health.get(seconds=0)):
            self._shortfalls.received(arrived[1], now_seconds)
        if episode.scenario is not self._scenario:
            self._scenario = episode.scenario
            self._declared_hz = {
                f"{vehicle.name}/{sensor.name}": sensor.message_rate_hz
                for vehicle in episode.scenario.vehicles
                for sensor in vehicle.sensors
            }
        stretched = episode.pacer.stretched_seconds
        return self._shortfalls.check(episode.tick, now_seconds, self._declared_hz, stretched)

    def check_start(
        self, awaited: Collection[str], episode: Episode, now_seconds: float
    ) -> list[str]:
        """Return log lines on processes that must be there before the run begins."""
        pacer, tick = episode.pacer, episode.tick
        missing = pacer.participants.missing(tick)
        return self._stall_policy.check(pacer, tick, now_seconds, holding=missing, awaited=awaited)

    def pause(self) -> None:
        """Restart all measurements of time: it stood still."""
        self._stall_policy.pause()
        if self._shortfalls is not None:
            self._shortfalls.pause()

    def reset(self) -> None:
        """Forget stalls and ruts: a new episode begins."""
        self._is_told_of_ruts = False
        self._stall_policy.reset()
        if self._shortfalls is not None:
            self._shortfalls.pause()
