# SPDX-License-Identifier: Apache-2.0
"""Effects of each kind of fault on a reading.

A function takes a reading and its context, and returns a reading or None. Random numbers are keyed
by the instant, so they are the same whenever the reading is made; `FaultHistory` keeps what a fault
needs of earlier readings. Faults act in the order of the table: first on the measurement, then on
the device, its clock, its output and the transport.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ, exact
from groundlink.core.frames import Floats
from groundlink.messages.base import Reading
from groundlink.messages.missing_readings import Cause
from groundlink.scenario import faults as specs
from services.sensors.noise.random_streams import RandomStreams

from .offsets import Offsets, changes_of, cover_of


class FaultHistory(NamedTuple):
    """What faults keep of earlier readings, by the tick at which each fault begins."""

    held: dict[int, Reading]
    """Readings that a stuck sensor repeats."""

    events: dict[int, int]
    """Numbers of the last events of a lower rate that had a reading."""

    def of(self, faults: Iterable[specs.Fault]) -> "FaultHistory":
        """Return a copy for these faults."""
        ticks = {fault.begin_tick for fault in faults}
        return FaultHistory(
            {tick: reading for tick, reading in self.held.items() if tick in ticks},
            {tick: number for tick, number in self.events.items() if tick in ticks},
        )


@dataclass
class FaultContext:
    """What faults can use besides the reading; they add to `late_ticks`."""

    faults: tuple[specs.Fault, ...]
    """Faults in effect."""

    sim_nanos: int
    """Instant of the measurement."""

    streams: RandomStreams
    past: FaultHistory
    late_ticks: int = 0


def _offset(reading: Reading, fault: specs.Disturbance, offsets: Offsets) -> Reading:
    """Add numbers to the fault's quantity."""
    changes = changes_of(type(reading))
    if not changes:
        return reading
    changed: Reading = changes[fault.quantity or next(iter(changes))](reading, offsets)
    return changed


def _constant(numbers: specs.Numbers, factor: float) -> Offsets:
    def offsets(measurements: int, components: int) -> Floats:
        return np.broadcast_to(np.multiply(numbers, factor), (measurements, components))

    return offsets


def _bias(fault: specs.Bias, reading: Reading, now: FaultContext) -> Reading:
    return _offset(reading, fault, _constant(fault.value, 1.0))


def _drift(fault: specs.Drift, reading: Reading, now: FaultContext) -> Reading:
    seconds = (now.sim_nanos - fault.begin_tick * TICK_NANOS) / NANOS
    return _offset(reading, fault, _constant(fault.per_s, seconds))


def _noise_burst(fault: specs.NoiseBurst, reading: Reading, now: FaultContext) -> Reading:
    generator = now.streams.at(_purpose(fault), now.sim_nanos)

    def offsets(measurements: int, components: int) -> Floats:
        drawn = generator.standard_normal((measurements, components))
        return np.multiply(drawn, fault.stddev)

    return _offset(reading, fault, offsets)


def _occluded_sector(fault: specs.OccludedSector, reading: Reading, now: FaultContext) -> Reading:
    begin, width = math.radians(fault.from_deg), math.radians(fault.width_deg)
    covered: Reading = cover_of(type(reading))(reading, begin, width)
    return covered


def _stuck(fault: specs.Stuck, reading: Reading, now: FaultContext) -> Reading:
    first = now.past.held.setdefault(fault.begin_tick, reading)
    return replace(first, stamp_nanos=reading.stamp_nanos)  # type: ignore[attr-defined]


def _time_jump(fault: specs.TimeJump, reading: Reading, now: FaultContext) -> Reading:
    error = int(exact(fault.offset_s) * NANOS)
    stamp: int = reading.stamp_nanos  # type: ignore[attr-defined]
    wrong = {"stamp_nanos": stamp + error, "clock_error_nanos": reading.clock_error_nanos + error}
    return replace(reading, **wrong)


def _rate_change(fault: specs.RateChange, reading: Reading, now: FaultContext) -> Reading | None:
    """Keep the first reading at or after each event of the lower rate."""
    # Stamps are rounded down to whole nanoseconds.
    since_nanos = now.sim_nanos + 1 - fault.begin_tick * TICK_NANOS
    event = math.floor(since_nanos * exact(fault.rate_hz) / NANOS)
    if event <= now.past.events.get(fault.begin_tick, -1):
        return None
    now.past.events[fault.begin_tick] = event
    return reading


def _drop(fault: specs.Drop, reading: Reading, now: FaultContext) -> Reading | None:
    lost = now.streams.at(_purpose(fault), now.sim_nanos).random() < fault.share
    return None if lost else reading


def _off(fault: specs.Off, reading: Reading, now: FaultContext) -> None:
    return None


def _delay(fault: specs.Delay, reading: Reading, now: FaultContext) -> Reading:
    now.late_ticks += math.ceil(exact(fault.delay_s) * TICK_RATE_HZ)
    return reading


EFFECTS: Mapping[type[specs.FaultSpec], Callable[[Any, Reading, FaultContext], Reading | None]] = {
    specs.OccludedSector: _occluded_sector,
    specs.Bias: _bias,
    specs.Drift: _drift,
    specs.NoiseBurst: _noise_burst,
    specs.Stuck: _stuck,
    specs.TimeJump: _time_jump,
    specs.RateChange: _rate_change,
    specs.Drop: _drop,
    specs.Off: _off,
    specs.Delay: _delay,
}
"""Function of each kind, in the order in which they act."""


class Removed(NamedTuple):
    """Stands for a reading that a fault removed."""

    by: Cause
    """Kind of the fault."""


def apply_faults(now: FaultContext, reading: Reading) -> Reading | Removed:
    """Apply all faults in effect to a reading."""
    for fault in sorted(now.faults, key=lambda fault: _RANKS[type(fault)]):
        changed = EFFECTS[type(fault)](fault, reading, now)
        if changed is None:
            return Removed(cast(Cause, fault.kind))
        reading = changed
    return reading


_RANKS = {kind: rank for rank, kind in enumerate(EFFECTS)}


def _purpose(fault: specs.FaultSpec) -> str:
    """Return the purpose of a fault's random numbers, which does not depend on its end."""
    return f"fault_{fault.kind}_{fault.begin_tick}"
