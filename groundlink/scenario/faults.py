# SPDX-License-Identifier: Apache-2.0
"""Faults: errors of a sensor that a scenario or a command injects, with their times.

Each kind of fault is a class; its tag is the kind. A fault is in effect for whole ticks, from the
first tick at or after its begin. It affects the readings measured (stamped) at or after that tick
and before its end. Its effects are in `services/sensors/faults/effects.py`.
"""

import math
from functools import lru_cache
from typing import Annotated, ClassVar, NamedTuple, get_args

import msgspec
from msgspec import Meta

from groundlink.core.clock import TICK_RATE_HZ, exact
from groundlink.core.errors import UserError
from groundlink.core.fields import NonNegative, Positive, Spec

Degrees = Annotated[float, Meta(ge=-360, le=360)]

Numbers = float | tuple[float, ...]
"""A single number for all components of a quantity, or one number for each."""

MAX_DELAY_SECONDS = 1.0
"""Longest delay, in seconds. The history of physics for a sensor that is restarted covers readings
of this age."""


EACH_WHEEL = ("one for each wheel",)
"""Component names of a quantity with one number for each wheel."""


class Quantity(NamedTuple):
    """A numeric quantity of a reading that a fault can disturb."""

    unit: str
    components: tuple[str, ...] = ()
    """Names of its components; empty for a single number."""

    field: str = ""
    """Field of the message to which a fault adds its offset; empty if the kind has its own
    function."""


@lru_cache(maxsize=1024)
def _tick(begin_s: float, more_s: float) -> int:
    """Return the first tick at or after the sum of two times; called at every reading."""
    return -int(-(exact(begin_s) + exact(more_s)) * TICK_RATE_HZ // 1)


class FaultSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """Base of all faults."""

    at_s: NonNegative = 0.0
    """Sim time at which the fault begins."""

    for_s: Positive | None = None
    """Duration; none: until the end of the run."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, float) and not math.isfinite(number):
                    raise ValueError(f"`{name}` is {number}; expected a finite number")

    def __str__(self) -> str:
        """Return the fault as one line of YAML, with the keys of a scenario."""
        import yaml  # Only reports and errors need it, and importing it takes as long as msgspec.

        facts = {k: v for k, v in msgspec.to_builtins(self).items() if v is not None}
        line: str = yaml.safe_dump(facts, default_flow_style=True, sort_keys=False, width=1000)
        return line.strip()

    @property
    def kind(self) -> str:
        """Kind of the fault, as in a scenario."""
        return str(self.__struct_config__.tag)

    @property
    def begin_tick(self) -> int:
        """First tick at which the fault is in effect."""
        return _tick(self.at_s, 0.0)

    @property
    def end_tick(self) -> int | None:
        """First tick after the fault; None for a fault without end."""
        if self.for_s is None:
            return None
        return max(self.begin_tick + 1, _tick(self.at_s, self.for_s))

    def is_on(self, tick: int) -> bool:
        """Return whether the fault is in effect at a tick."""
        end = self.end_tick
        return self.begin_tick <= tick and (end is None or tick < end)


class Off(FaultSpec, frozen=True, tag="off"):
    """The sensor publishes nothing."""


class Stuck(FaultSpec, frozen=True, tag="stuck"):
    """Every reading repeats the first one of the fault, with a new stamp."""


class Disturbance(FaultSpec, frozen=True, kw_only=True):
    """Base of the faults that disturb a quantity of the readings."""

    numbers_field: ClassVar[str]
    quantity: str | None = None
    """Name of the quantity; default: the first one of the sensor's `SensorSpec.quantities`."""

    @property
    def numbers(self) -> Numbers:
        """Return the size of the disturbance, in the unit of the kind of fault."""
        numbers: Numbers = getattr(self, self.numbers_field)
        return numbers


class Bias(Disturbance, frozen=True, tag="bias", kw_only=True):
    """A constant offset is added to the quantity."""

    numbers_field: ClassVar[str] = "value"
    value: Numbers
    """Offset, in the quantity's unit."""


class Drift(Disturbance, frozen=True, tag="drift", kw_only=True):
    """A linearly growing offset is added to the quantity, from zero at the begin."""

    numbers_field: ClassVar[str] = "per_s"
    per_s: Numbers
    """Growth per second of sim time, in the quantity's unit."""


class NoiseBurst(Disturbance, frozen=True, tag="noise_burst", kw_only=True):
    """White noise is added to the quantity."""

    numbers_field: ClassVar[str] = "stddev"
    stddev: Numbers
    """1 sigma, in the quantity's unit."""


class TimeJump(FaultSpec, frozen=True, tag="time_jump", kw_only=True):
    """The sensor's clock is off: stamps are wrong, instants of measurement are correct."""

    offset_s: Annotated[float, Meta(ge=-3600, le=3600)]
    """Offset of the stamps; positive: stamps are in the future."""


class Delay(FaultSpec, frozen=True, tag="delay", kw_only=True):
    """Readings arrive late, in order and with correct stamps."""

    delay_s: Annotated[float, Meta(gt=0, le=MAX_DELAY_SECONDS)]
    """Delay of each reading, in seconds of sim time."""


class Drop(FaultSpec, frozen=True, tag="drop", kw_only=True):
    """Some readings are dropped at random."""

    share: Annotated[float, Meta(gt=0, le=1)]
    """Probability that a reading is dropped."""


class RateChange(FaultSpec, frozen=True, tag="rate_change", kw_only=True):
    """Readings are published at a lower rate, evenly spaced."""

    rate_hz: Positive
    """Messages per second of sim time; lower than the rate that the sensor declares."""


class OccludedSector(FaultSpec, frozen=True, tag="occluded_sector", kw_only=True):
    """A sector of the revolution is covered and gives no returns."""

    from_deg: Degrees
    """Azimuth in the sensor's frame, from x towards y."""

    to_deg: Degrees
    """End of the sector, counterclockwise from `from_deg`."""

    @property
    def width_deg(self) -> float:
        """Width of the sector in degrees, above 0 and up to 360."""
        return (self.to_deg - self.from_deg) % 360 or 360.0


Fault = (
    Off | Stuck | Bias | Drift | NoiseBurst | TimeJump | Delay | Drop | RateChange | OccludedSector
)

KINDS: dict[str, type[FaultSpec]] = {str(c.__struct_config__.tag): c for c in get_args(Fault)}
"""All kinds of faults by tag."""


def fault_from(fields: object) -> Fault:
    """Return the fault with these fields, as a scenario has them.

    Raises
    ------
    UserError
        if it is none; the line names the field.
    """
    try:
        fault: Fault = msgspec.convert(fields, Fault)
    except msgspec.ValidationError as error:
        problem, _, place = str(error).partition(" - at `$.")
        at = f"`{place.strip('`')}`: " if place else ""
        raise UserError(f"{at}{problem[:1].lower()}{problem[1:]}") from None
    return fault
