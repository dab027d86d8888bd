# SPDX-License-Identifier: Apache-2.0
"""Overview of a run from its bus: processes with host, state, rates and counters.

Health messages, changes of presence and wall time are arguments. The result is plain data, which
`groundlink top` shows or prints as JSON.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec

from groundlink.bus.core_topics import GATEWAY, REPLAY, TIME_KEEPERS
from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import Health

from .mission_monitor import MissionMonitor
from .run_monitor import RunMonitor, keeps_rate

SILENT_SECONDS = 2.5
"""A present process without a health message for this long is silent."""

BEATS_FOR_RATE = 11
"""Rates are averages over the last ten seconds."""

LINK_PREFIXES = ("wire_", "link_", "peer_")
"""Prefixes of the gateway's counters of the link."""


@dataclass
class _Process:
    """One process, as known from its messages."""

    present: bool = False
    was_present: bool = False
    heard_seconds: float | None = None
    health: Health | None = None
    restarts: int = 0
    """Restarts since this overview started: changes of host or pid."""

    beats: deque[tuple[float, int, int]] = field(
        default_factory=lambda: deque(maxlen=BEATS_FOR_RATE)
    )
    """Wall time, tick and readings of the last health messages."""

    def state(self, now_seconds: float) -> str:
        if not self.present:
            return "gone" if self.was_present else "missing"
        if self.heard_seconds is None:
            return "there"
        return "silent" if now_seconds - self.heard_seconds > SILENT_SECONDS else "alive"


class Overview:
    """Overview of a run.

    Parameters
    ----------
    declared_hz
        the processes of the scenario, with the rate of their readings or None.
    missions
        monitor of the vehicles.
    """

    def __init__(
        self,
        run: str,
        declared_hz: Mapping[str, float | None],
        missions: MissionMonitor | None = None,
    ) -> None:
        self._run = run
        self._declared_hz = declared_hz
        self._processes = {name: _Process() for name in declared_hz}
        self.monitor = RunMonitor()
        self.missions = missions or MissionMonitor()
        self.link_settings: Mapping[str, Mapping[str, float | bool]] = {}
        """Settings of the emulated link by direction."""

    def update(self, health: Health, now_seconds: float) -> None:
        """Process a health message."""
        self.monitor.update(health, now_seconds)
        process = self._processes.setdefault(health.process, _Process())
        last = process.health
        if last is not None and (last.pid, last.host) != (health.pid, health.host):
            process.restarts += 1
            process.beats.clear()
        readings = health.counters.get("readings", 0)
        if process.beats and (health.tick, readings) < process.beats[-1][1:]:
            process.beats.clear()
        process.beats.append((now_seconds, health.tick, readings))
        process.health, process.heard_seconds = health, now_seconds

    def presence_changed(self, name: str, present: bool) -> None:
        """Record that a process appeared or disappeared."""
        process = self._processes.setdefault(name, _Process())
        process.present, process.was_present = present, process.was_present or present

    @property
    def has_rates(self) -> bool:
        """Whether every present process has sent two health messages, so that rates are known."""
        present = [process for process in self._processes.values() if process.present]
        return bool(present) and all(len(process.beats) > 1 for process in present)

    def snapshot(self, now_seconds: float) -> dict[str, Any]:
        """Return the overview as plain data."""
        monitor = self.monitor
        return {
            "run": self._run,
            "sim_seconds": monitor.sim_seconds,
            "real_time_factor": self._real_time_factor(),
            "stalls": asdict(monitor.stalls),
            "processes": [
                self._row(name, process, now_seconds)
                for name, process in self._processes.items()
                if not self._is_replayed(name)
            ],
            "missions": [mission.to_builtins() for mission in self.missions.missions()],
            "streams": [
                msgspec.to_builtins(stream) | {"keeps_rate": keeps_rate(stream)}
                for stream in monitor.streams
            ],
            "link": {
                "settings": {way: dict(fields) for way, fields in self.link_settings.items()},
                "counters": self._link_counters(),
            },
        }

    def _is_replayed(self, name: str) -> bool:
        """Return whether a replay stands in for an absent process."""
        replay = self._processes.get(REPLAY)
        if replay is None or not replay.present or name == GATEWAY:
            return False
        return not self._processes[name].was_present

    def _row(self, name: str, process: _Process, now_seconds: float) -> dict[str, Any]:
        health = process.health
        since = None if process.heard_seconds is None else now_seconds - process.heard_seconds
        return {
            "name": name,
            "state": process.state(now_seconds),
            "host": health.host if health else None,
            "pid": health.pid if health else None,
            "tick": health.tick if health else None,
            "restarts": process.restarts,
            "heard_seconds_ago": since,
            "declared_hz": self._declared_hz.get(name),
            "measured_hz": _rate_hz(process) if self._declared_hz.get(name) else None,
            "counters": {
                counter: count
                for counter, count in (health.counters if health else {}).items()
                if not counter.startswith(LINK_PREFIXES)
            },
        }

    def _real_time_factor(self) -> float | None:
        """Return sim seconds for each wall second over the last messages of the time keeper."""
        for name in TIME_KEEPERS:
            process = self._processes.get(name)
            if process and process.present and len(process.beats) > 1:
                (first, from_tick, _), (last, to_tick, _) = process.beats[0], process.beats[-1]
                return (
                    (to_tick - from_tick) * TICK_SECONDS / (last - first) if last > first else None
                )
        return None

    def _link_counters(self) -> dict[str, int]:
        gateway = self._processes.get("gateway")
        counters = gateway.health.counters if gateway and gateway.health else {}
        return {n: count for n, count in counters.items() if n.startswith(LINK_PREFIXES)}


def _rate_hz(process: _Process) -> float | None:
    """Return readings for each second of sim time, from the last messages of a process."""
    if len(process.beats) < 2:
        return None
    (_, from_tick, first), (_, to_tick, last) = process.beats[0], process.beats[-1]
    ticks = to_tick - from_tick
    return (last - first) / (ticks * TICK_SECONDS) if ticks > 0 else None
