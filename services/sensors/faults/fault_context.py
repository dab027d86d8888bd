# SPDX-License-Identifier: Apache-2.0
"""What a fault may know when a reading comes, and what it keeps for the next one.

Rule: all that a successor has to be told of the past of faults is in `Past`. No reading changes one
that was handed out: each has a copy of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from groundlink.messages.base import Reading
from groundlink.scenario.faults import Fault
from services.sensors.noise.random_streams import RandomStreams


class FaultHistory(NamedTuple):
    """What faults keep of earlier readings, each by the tick of its begin."""

    held: dict[int, Reading]
    """What a stuck sensor repeats."""

    events: dict[int, int]
    """Of a lower rate, the number of the last event for which a reading came."""

    def of(self, faults: Iterable[Fault]) -> FaultHistory:
        """Return a copy of what these faults have kept."""
        ticks = {fault.begin_tick for fault in faults}
        return FaultHistory(
            {tick: reading for tick, reading in self.held.items() if tick in ticks},
            {tick: number for tick, number in self.events.items() if tick in ticks},
        )


@dataclass
class FaultContext:
    """What faults may know, besides the reading, and where they tell how late it comes."""

    faults: tuple[Fault, ...]
    """Those in effect."""

    sim_nanos: int
    """When the reading was measured."""

    streams: RandomStreams
    past: FaultHistory
    late_ticks: int = 0
