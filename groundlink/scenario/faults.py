# SPDX-License-Identifier: Apache-2.0
"""What can be wrong with a sensor on purpose, and for how long.

Rule: one class a kind of fault; the tag is the kind. A fault is in effect for whole ticks, from the
first at or after its begin: for the readings measured (stamped) from that tick on and before its
end. What it does to them is in `services/sensors/faults/effects.py`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, ClassVar, NamedTuple, get_args

import msgspec
import yaml
from msgspec import Meta

from groundlink.core.clock import TICK_RATE_HZ, exact
from groundlink.core.fields import NonNegative, Positive, Spec

Degrees = Annotated[float, Meta(ge=-360, le=360)]

Numbers = float | tuple[float, ...]
"""One for all components of a quantity, or one for each."""

MAX_DELAY_SECONDS = 1.0
"""What physics remembers for a sensor that is started again covers readings this old."""


EACH_WHEEL = ("one for each wheel",)
"""Components of what a vehicle's wheels have."""


class Quantity(NamedTuple):
    """Something that a reading says in numbers, which can be wrong by numbers."""

    unit: str
    components: tuple[str, ...] = ()
    """Names of its numbers; none for a single one."""

    field: str = ""
    """Field of the message that holds them, where a fault simply adds to it."""


@lru_cache(maxsize=1024)
def _tick(begin_s: float, more_s: float) -> int:
    """Return the first tick at or after the sum of two times; asked for at every reading."""
    return -int(-(exact(begin_s) + exact(more_s)) * TICK_RATE_HZ // 1)


class FaultSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """What every fault has."""

    at_s: NonNegative = 0.0
    """Sim time of its begin."""

    for_s: Positive | None = None
    """How long it lasts; none: to the end of the run."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, float) and not math.isfinite(number):
                    raise ValueError(f"`{name}` is {number}; expected a finite number")

    def __str__(self) -> str:
        """Return it as a scenario has it."""
        facts = {k: v for k, v in msgspec.to_builtins(self).items() if v is not None}
        line: str = yaml.safe_dump(facts, default_flow_style=True, sort_keys=False, width=1000)
        return line.strip()

    @property
    def kind(self) -> str:
        """Its kind, as in a scenario."""
        return str(self.__struct_config__.tag)

    @property
    def begin_tick(self) -> int:
        """The first tick of its effect."""
        return _tick(self.at_s, 0.0)

    @property
    def end_tick(self) -> int | None:
        """The first tick after it; None: there is none."""
        if self.for_s is None:
            return None
        return max(self.begin_tick + 1, _tick(self.at_s, self.for_s))

    def is_on(self, tick: int) -> bool:
        """Return whether it is in effect at a tick."""
        end = self.end_tick
        return self.begin_tick <= tick and (end is None or tick < end)


class Off(FaultSpec, frozen=True, tag="off"):
    """Nothing comes."""


class Stuck(FaultSpec, frozen=True, tag="stuck"):
    """Every reading repeats the first one of the fault, with a stamp of its own."""


class Disturbance(FaultSpec, frozen=True, kw_only=True):
    """What makes numbers wrong."""

    numbers_field: ClassVar[str]
    quantity: str | None = None
    """Which of them; the sensor's first unless given, see `SensorSpec.quantities`."""

    @property
    def numbers(self) -> Numbers:
        """By how much, in what its kind understands by that."""
        numbers: Numbers = getattr(self, self.numbers_field)
        return numbers


class Bias(Disturbance, frozen=True, tag="bias", kw_only=True):
    """A constant is added."""

    numbers_field: ClassVar[str] = "value"
    value: Numbers
    """In the quantity's unit."""


class Drift(Disturbance, frozen=True, tag="drift", kw_only=True):
    """What is added grows from zero."""

    numbers_field: ClassVar[str] = "per_s"
    per_s: Numbers
    """In the quantity's unit, for each second since the begin."""


class NoiseBurst(Disturbance, frozen=True, tag="noise_burst", kw_only=True):
    """White noise is added."""

    numbers_field: ClassVar[str] = "stddev"
    stddev: Numbers
    """1 sigma, in the quantity's unit."""


class TimeJump(FaultSpec, frozen=True, tag="time_jump", kw_only=True):
    """The sensor's clock is off: stamps are wrong, instants of measurement are not."""

    offset_s: Annotated[float, Meta(ge=-3600, le=3600)]


class Delay(FaultSpec, frozen=True, tag="delay", kw_only=True):
    """Readings come later, in order and with their right stamps."""

    delay_s: Annotated[float, Meta(gt=0, le=MAX_DELAY_SECONDS)]


class Drop(FaultSpec, frozen=True, tag="drop", kw_only=True):
    """Some readings are lost at random."""

    share: Annotated[float, Meta(gt=0, le=1)]


class RateChange(FaultSpec, frozen=True, tag="rate_change", kw_only=True):
    """Fewer readings come, evenly."""

    rate_hz: Positive
    """Messages a second of sim time, less than the sensor declares."""


class OccludedSector(FaultSpec, frozen=True, tag="occluded_sector", kw_only=True):
    """Something covers a part of the turn: nothing returns from there."""

    from_deg: Degrees
    """Azimuth in the sensor's frame, from x towards y."""

    to_deg: Degrees
    """The sector goes from `from_deg` counter-clockwise to it."""

    @property
    def width_deg(self) -> float:
        """How much of the turn it takes, above 0 and up to 360."""
        return (self.to_deg - self.from_deg) % 360 or 360.0


Fault = (
    Off | Stuck | Bias | Drift | NoiseBurst | TimeJump | Delay | Drop | RateChange | OccludedSector
)

KINDS: dict[str, type[FaultSpec]] = {str(c.__struct_config__.tag): c for c in get_args(Fault)}
"""Every kind of fault by its tag."""
