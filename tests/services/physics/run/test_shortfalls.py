# SPDX-License-Identifier: Apache-2.0
"""What the log says of a run that falls short, and how often."""

import pytest

from groundlink.messages.base import Health
from groundlink.messages.missing_readings import COUNTER_PREFIX
from services.physics.run.shortfalls import ShortfallMonitor

CAMERA = "rover/camera"
DECLARED = {CAMERA: 30.0}


class Run:
    """A run, second by second: a camera of 30 Hz that misses some readings, and a clock."""

    def __init__(self, factor: float = 1.0) -> None:
        self.shortfalls = ShortfallMonitor(factor)
        self.lines: list[str] = []
        self.now, self.tick = 100.0, 0
        self.stretched: dict[str, float] = {}
        self.begin(pid=1)

    def begin(self, pid: int) -> None:
        self._pid, self._readings = pid, 0
        self._missing: dict[str, int] = {}

    def go(
        self,
        seconds: int,
        *,
        missing: int = 0,
        cause: str = "",
        speed: float = 1.0,
        says: bool = True,
    ) -> None:
        for _ in range(seconds):
            self.now += 1.0
            self.tick += round(400 * speed)
            self._readings += 30 - missing
            if missing:
                name = COUNTER_PREFIX + cause
                self._missing[name] = self._missing.get(name, 0) + missing
            if says:
                counters = {"readings": self._readings} | self._missing
                self.shortfalls.received(Health(CAMERA, self._pid, self.tick, counters), self.now)
            for ask in (0.0, 0.4):
                self.lines += self.shortfalls.check(
                    self.tick, self.now + ask, DECLARED, self.stretched
                )


def test_healthy_run_reports_nothing() -> None:
    run = Run()
    run.go(100)
    run.go(100, missing=1, cause="overloaded")
    assert run.lines == []


def test_missing_readings_and_recovery_are_each_reported_once() -> None:
    run = Run()
    run.go(20)
    run.go(60, missing=8, cause="overloaded")
    [low] = run.lines
    assert low.startswith("rover/camera: 26.")
    assert "of 30 Hz (machine overloaded: readings missing in the last 10 s: " in low
    assert low.endswith(" overloaded)")
    run.go(60)
    assert len(run.lines) == 2
    assert run.lines[1].startswith("rover/camera: 30 Hz again after ")
    assert run.lines[1].endswith(" s, 480 readings missing")


@pytest.mark.parametrize("cause", ["off", "drop", "rate_change", "not there"])
def test_requested_drops_are_no_shortfall(cause: str) -> None:
    run = Run()
    run.go(60, missing=20, cause=cause)
    assert run.lines == []


def test_restart_is_reported_with_its_missing_readings() -> None:
    run = Run()
    run.go(20)
    run.go(5, says=False)
    assert run.lines == ["rover/camera: no readings for 4 s: its process does not respond"]
    run.begin(pid=2)
    run.go(1, missing=30, cause="restarted")
    run.go(1, missing=126 - 30, cause="restarted")
    assert len(run.lines) == 1
    run.go(30)
    assert len(run.lines) == 2
    assert run.lines[1].startswith("rover/camera: 30 Hz again after ")
    assert run.lines[1].endswith(" s, 126 readings missing")


def test_a_long_crash_is_over_when_its_cost_is_known() -> None:
    run = Run()
    run.go(20)
    run.go(40, says=False)
    run.begin(pid=2)
    run.go(1)
    run.go(1, missing=1200, cause="restarted")
    run.go(30)
    assert len(run.lines) == 2
    assert run.lines[1].endswith(" s, 1200 readings missing")


def test_a_bad_start_is_no_shortfall() -> None:
    run = Run()
    run.go(3, missing=10, cause="overloaded")
    run.go(30)
    assert run.lines == []


def test_slow_time_is_reported_with_its_cause() -> None:
    run = Run(factor=0.5)
    run.go(30, speed=0.5)
    assert run.lines == []
    run.stretched = {CAMERA: 3.0, "physics": 0.5}
    run.go(30, speed=0.3)
    [low] = run.lines
    assert low.startswith("machine overloaded: real-time factor 0.4")
    assert "of 0.5 in the last 10 s (rover/camera 3.0 s, physics 0.5 s)" in low
    run.go(30, speed=0.5)
    assert len(run.lines) == 2
    assert run.lines[1].startswith("real-time factor is 0.5 again after ")


def test_a_pause_is_no_shortfall() -> None:
    run = Run()
    run.go(30)
    run.shortfalls.pause()
    run.now += 5.0
    run.go(30)
    assert run.lines == []


def test_sensor_at_its_limit_is_reported_once() -> None:
    run = Run()
    run.go(20)
    for _ in range(10):
        run.go(15, missing=6, cause="overloaded")
        run.go(15, missing=2, cause="overloaded")
    assert len(run.lines) == 1


def test_looks_between_two_health_messages_cost_nothing() -> None:
    """Physics looks at every step."""
    run = Run()
    run.go(60)
    for _ in range(1000):
        run.shortfalls.check(run.tick, run.now + 0.5, DECLARED, {})
    assert len(run.shortfalls._ticks) <= 12


def test_an_unknown_process_is_not_judged() -> None:
    run = Run()
    run.shortfalls.received(Health("gateway", 9, 0, {"gap_overloaded": 50}), run.now)
    run.go(20)
    assert run.lines == []
