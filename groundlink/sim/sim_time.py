# SPDX-License-Identifier: Apache-2.0
"""Sim time that a program advances: the scenario's clock, and the length of a step."""

from math import inf
from typing import Literal

from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.scenario import Scenario

Mode = Literal["fast", "lockstep"]


def as_stepped(scenario: Scenario, mode: Mode = "fast") -> Scenario:
    """Return a scenario whose sim time a program advances."""
    return replace(scenario, time=replace(scenario.time, mode=mode, lockstep="ros"))


def check_step(scenario: Scenario, seconds: float) -> int:
    """Return the ticks of a step.

    Raises
    ------
    UserError
        when it is no multiple of the period of the scenario's clock.
    """
    period = scenario.time.ack_ticks
    ticks = seconds * TICK_RATE_HZ
    if not period <= ticks < inf or abs(ticks / period - round(ticks / period)) > 1e-6:
        raise UserError(
            f"step: {seconds:g} s is no multiple of {period * TICK_SECONDS:g} s. Fix: choose one, "
            "or set `time.clock_rate_hz` of the scenario"
        )
    return round(ticks)
