# SPDX-License-Identifier: Apache-2.0
"""Context of faults: what they can use besides the reading, and what they keep for the next one.

`FaultHistory` holds all that a successor process needs. Each reading gets a copy of its own.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from groundlink.messages.base import Reading
from groundlink.scenario.faults import Fault
from services.sensors.noise.random_streams import RandomStreams


class FaultHistory(NamedTuple):
    """What faults keep of earlier readings, by the tick at which each fault begins."""

    held: dict[int, Reading]
    """Readings that a stuck sensor repeats."""

    events: dict[int, int]
    """Numbers of the last events of a lower rate that had a reading."""

    def of(self, faults: Iterable[Fault]) -> "FaultHistory":
        """Return a copy for these faults."""
        ticks = {fault.begin_tick for fault in faults}
        return FaultHistory(
            {tick: reading for tick, reading in self.held.items() if tick in ticks},
            {tick: number for tick, number in self.events.items() if tick in ticks},
        )


@dataclass
class FaultContext:
    """What faults can use besides the reading; they add to `late_ticks`."""

    faults: tuple[Fault, ...]
    """Faults in effect."""

    sim_nanos: int
    """Instant of the measurement."""

    streams: RandomStreams
    past: FaultHistory
    late_ticks: int = 0
