# SPDX-License-Identifier: Apache-2.0
"""Checks of the lockstep window: how far physics may be ahead of the other processes.

The window must be at least a period of the clock, since the gateway reports its progress with each
clock message. It is limited so that a crashed sensor can restart without a gap. A restarted sensor
resumes where its oldest measurement in progress began (a revolution, an exposure, or a message that
a fault delays), and physics keeps only its last `HISTORY_TICKS` states.
"""

import math
from collections.abc import Iterable

from groundlink.core.clock import TICK_RATE_HZ

from .every_sensor import SensorSpec
from .faults import Delay
from .schema import Time

HISTORY_TICKS = 1024
"""Number of states that physics keeps for sensors that rejoin."""


def window_mistake(time: Time, sensors: Iterable[SensorSpec]) -> str | None:
    """Return the problem of the window of a lockstep run, or None."""
    window = time.window_ticks
    if window < TICK_RATE_HZ / time.clock_rate_hz:
        return (
            f"{window} is less than a period of the clock; expected {TICK_RATE_HZ}/clock_rate_hz "
            "or more"
        )
    for sensor in sensors:
        most = HISTORY_TICKS - 2 - math.ceil(TICK_RATE_HZ * _under_way_s(sensor))
        if window > most:
            return (
                f"{window} and a measurement of `{sensor.name}` are more than the {HISTORY_TICKS} "
                f"ticks that are kept for its restart; expected {most} or less"
            )
    return None


def _under_way_s(sensor: SensorSpec) -> float:
    """Return the longest time from the start of a measurement to its publication, in seconds."""
    late_s = max((fault.delay_s for fault in sensor.faults if isinstance(fault, Delay)), default=0)
    return late_s + sensor.measuring_s
