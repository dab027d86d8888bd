# SPDX-License-Identifier: Apache-2.0
"""A run without its processes: a pace, its stall policy, and sensors."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.loader import load
from groundlink.messages.base import Ack
from groundlink.scenario.schema import Time
from services.physics.run.pacer import pacer_for
from services.physics.run.stall_policy import StallPolicy

LAB = load(Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml")
SENSORS = LAB.sensor_names()
LIDAR = "rover/lidar"
EPISODE = 5
STEP_SECONDS = 50e-6
"""That a step of physics takes."""


class Paced:
    """Physics as its loop runs it, on a machine where nothing else takes time."""

    def __init__(self, time: Time, *, required: Sequence[str] = ()) -> None:
        self.time = time
        self.pacer = pacer_for(replace(LAB, time=time), EPISODE, required)
        self.stall_policy = StallPolicy(time)
        self.lines: list[str] = []
        self.now = 100.0
        self.tick = 0
        self._followed = dict.fromkeys((*SENSORS, *required), -1.0)

    @classmethod
    def joined(cls, time: Time, *, required: Sequence[str] = ()) -> Self:
        """Return a run that all have joined."""
        run = cls(time, required=required)
        run.join()
        return run

    def join(self) -> None:
        """Let all have said that they are there, and the first state be told."""
        for name in self._followed:
            self._say(name, -1)
        assert self.pacer.participants.missing(0) == []
        self.pacer.wait_seconds(0, self.now)

    def run(
        self, seconds: float, *, times_real: Mapping[str, float] | None = None, pause: float = 0.0
    ) -> None:
        """Go on for wall seconds; after a pause in which physics was not let run.

        Parameters
        ----------
        times_real
            how many times as fast as real time some can follow, 0 for not at all; all others are
            at each state at once.
        """
        times_real = times_real or {}
        until = self.now + seconds
        self.now += pause
        while self.now < until:
            wait = self.pacer.wait_seconds(self.tick + 1, self.now)
            self.lines += self.stall_policy.check(
                self.pacer, self.tick + 1, self.now, holding=self.pacer.holding
            )
            self.tick += wait == 0
            passed = wait or STEP_SECONDS
            self.now += passed
            for name in self._followed:
                self._follow(name, passed * times_real.get(name, 1e9) / TICK_SECONDS)

    @property
    def sim_seconds(self) -> float:
        return self.tick * TICK_SECONDS

    @property
    def stretched(self) -> dict[str, float]:
        return self.pacer.stretched_seconds

    def lag_ticks(self, name: str) -> float:
        return self.tick - self._followed[name]

    def _follow(self, name: str, ticks: float) -> None:
        before = self._followed[name]
        self._followed[name] = min(before + ticks, float(self.tick))
        every = self.time.ack_ticks
        word = int(self._followed[name]) // every * every
        if word > before:
            self._say(name, word)

    def _say(self, name: str, tick: int) -> None:
        self.pacer.participants.acknowledged(name, Ack(EPISODE, tick, tick))
