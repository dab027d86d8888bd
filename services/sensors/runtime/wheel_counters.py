# SPDX-License-Identifier: Apache-2.0
"""64-bit counters of wheel encoders (section 3.3.4 of the paper).

A counter is a function of the wheel's angle, plus missed ticks and resets. The paper adds up
differences of angle and counts one up or down whenever they reach the encoder's resolution. Joint
angles never wrap, so the sum of the differences is the angle itself, and the count is the number of
passed lines of the disc. The lines are fixed on the disc, as on a real encoder: a line passed
forward counts up, and the same line passed backward counts down. The first line is half a
resolution away from angle zero. A wheel at rest at zero therefore does not flicker, both directions
count alike, and a counter differs from the angle by at most half a tick. (The paper's rule restarts
at the last count, which causes a backlash of one tick. The two rules differ by at most one tick.)

A wheel may have three errors: a relative scale error, drawn once per run (`scale_stddev`), an error
that repeats with each turn (`eccentricity_deg`), and slip, a random walk of the angle
(`slip_stddev`). The counter follows the angle with these errors.

The memory consists of missed ticks, resets and slip. No ticks are missed and no slip is added while
states are lost.
"""

import math

import msgspec

from groundlink.core.clock import NANOS, TICK_NANOS, exact
from groundlink.messages.base import BadBusMessage, State, floats
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.wheel_encoders import IncrementalEncoders
from services.sensors.noise.random_streams import RandomStreams

BLOCK_TICKS = 128
"""Number of ticks whose slip is drawn from one random stream."""


def wrapped(count: int) -> int:
    """Wrap a count to a signed 64-bit counter; for a difference, the shorter direction."""
    return (count + 2**63) % 2**64 - 2**63


class _Memory(msgspec.Struct, array_like=True):
    """Memory of all counters."""

    offsets: list[int]
    """Count of each wheel in excess of the lines that it has passed."""

    resets: int = 0
    """Number of resets done so far."""

    slipped: list[float] = msgspec.field(default_factory=list)
    """Slip of each wheel's counted angle in radians, without the scale error."""


class WheelCounters:
    """Counters of one vehicle's wheels for one `encoders` sensor."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: IncrementalEncoders) -> None:
        self._vehicle = vehicle.name
        model = vehicle.model
        self.names = tuple(shaft.name for shaft in model.counted)
        """Names of wheels, or of tracks, in the order of their counters."""

        # A track's wheels turn together, so any wheel gives the rotation of the sprocket.
        self._wheels = [shaft.wheels[0] for shaft in model.counted]
        self._gears = [
            model.wheels[shaft.wheels[0]].radius_m / shaft.radius_m for shaft in model.counted
        ]
        self._joints = len(model.wheels)

        self._lines_per_radian = spec.ticks_per_wheel_revolution / (2 * math.pi)
        self._signs = [-1 if name in spec.reversed_wheels else 1 for name in self.names]
        self._start_ticks = spec.start_ticks
        self._missed = spec.missed_ticks
        self._slip_stddev = spec.slip_stddev
        self._slips: tuple[int, list[list[float]]] = (-1, [])
        self._reset_ticks = [-int(-exact(s) * NANOS // TICK_NANOS) for s in spec.resets_s]
        self._streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        normal = self._streams.at("scale", 0).standard_normal(len(self.names))
        scales = (1 + spec.scale_stddev * normal).tolist()
        self._gears = [gear * scale for gear, scale in zip(self._gears, scales, strict=True)]
        self._eccentricity = math.radians(spec.eccentricity_deg)
        turns = self._streams.at("eccentricity", 0).random(len(self.names))
        self._phases = (2 * math.pi * turns).tolist()
        self.remember(b"")

    def remember(self, memory: bytes) -> None:
        """Restore the result of an earlier `memory()`; empty memory is that of a run's start."""
        if memory:
            self._memory = msgspec.msgpack.decode(memory, type=_Memory)
        else:
            count = len(self.names)
            self._memory = _Memory([self._start_ticks] * count, slipped=[0.0] * count)
        self.restart()

    def memory(self) -> bytes:
        """Return the part of the counters that the last state does not determine."""
        return msgspec.msgpack.encode(self._memory)

    def restart(self) -> None:
        """Forget earlier angles. Called after a jump in time or a loss of states."""
        self._angles: list[float] = []
        self._turned: list[float] = []
        self._before: tuple[list[float], list[int]] = ([], [])

    def advance(self, state: State) -> None:
        """Take the state of the next tick.

        Raises
        ------
        BadBusMessage
            when the state lacks a wheel of the vehicle.
        """
        vehicle = state.vehicles.get(self._vehicle)
        angles = [] if vehicle is None else floats(vehicle.joint_positions).tolist()
        if len(angles) != self._joints:
            raise BadBusMessage(
                f"state of tick {state.tick}: {len(angles)} joint positions of `{self._vehicle}`, "
                f"expected {self._joints}"
            )
        angles = [angles[i] * gear for i, gear in zip(self._wheels, self._gears, strict=True)]
        if self._eccentricity:
            angles = [
                angle + self._eccentricity * (math.sin(angle + phase) - math.sin(phase))
                for angle, phase in zip(angles, self._phases, strict=True)
            ]
        if self._slip_stddev:
            angles = self._slipped(state.tick, angles)
        last = self._angles or angles
        self._reset(state.tick, last)
        self._before = (last, list(self._memory.offsets))
        self._angles = angles
        if self._missed:
            self._miss(state.tick, last)

    def ticks(self, lead_nanos: int = 0) -> tuple[int, ...]:
        """Return the counters at an instant `lead_nanos` from the last state.

        `lead_nanos` lies within the last tick and is not positive. Counts between two states are
        interpolated linearly, because a wheel turns at constant speed within a tick.
        """
        angles, offsets = self._angles, self._memory.offsets
        if lead_nanos:
            share = 1 + lead_nanos / TICK_NANOS
            angles_before, offsets_before = self._before
            angles = [b + share * (now - b) for b, now in zip(angles_before, angles, strict=True)]
            pairs = zip(offsets_before, offsets, strict=True)
            offsets = [b + round(share * wrapped(now - b)) for b, now in pairs]
        return tuple(
            wrapped(sign * self._line(angle) + offset)
            for sign, angle, offset in zip(self._signs, angles, offsets, strict=True)
        )

    def _line(self, angle: float) -> int:
        return math.floor(angle * self._lines_per_radian + 0.5)

    def _reset(self, tick: int, angles: list[float]) -> None:
        """Reset the counters if a reset was due before this tick."""
        memory = self._memory
        while memory.resets < len(self._reset_ticks) and self._reset_ticks[memory.resets] < tick:
            memory.resets += 1
            memory.offsets = [
                wrapped(-sign * self._line(angle))
                for sign, angle in zip(self._signs, angles, strict=True)
            ]

    def _slipped(self, tick: int, angles: list[float]) -> list[float]:
        """Return the angles with each wheel's slip up to this tick."""
        block, row = divmod(tick, BLOCK_TICKS)
        if block != self._slips[0]:
            generator = self._streams.at("slip", block * BLOCK_TICKS)
            normal = generator.standard_normal((BLOCK_TICKS, len(angles)))
            self._slips = block, (self._slip_stddev * normal).tolist()
        last, self._turned = self._turned or angles, angles
        self._memory.slipped = [
            slipped + slip * math.sqrt(abs(now - before))
            for slipped, slip, now, before in zip(
                self._memory.slipped, self._slips[1][row], angles, last, strict=True
            )
        ]
        return [angle + slip for angle, slip in zip(angles, self._memory.slipped, strict=True)]

    def _miss(self, tick: int, last: list[float]) -> None:
        """Remove missed counts from the lines passed in this tick."""
        pairs = zip(self._angles, last, strict=True)
        steps = [self._line(now) - self._line(before) for now, before in pairs]
        generator = self._streams.at("missed_ticks", tick)
        missed = generator.binomial([abs(step) for step in steps], self._missed).tolist()
        self._memory.offsets = [
            wrapped(offset - sign * int(math.copysign(count, step)))
            for offset, sign, count, step in zip(
                self._memory.offsets, self._signs, missed, steps, strict=True
            )
        ]
