# SPDX-License-Identifier: Apache-2.0
"""Specification of a range finder: what a scenario can say. Defaults are an ideal sensor."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from groundlink.core.fields import Fraction01, NonNegative, Positive
from groundlink.messages.imagery import Range
from groundlink.scenario.every_sensor import Carrier, Rate, SensorSpec
from groundlink.scenario.faults import Quantity


class RangeFinder(SensorSpec, frozen=True, tag="range", kw_only=True):
    """A device that measures one distance: by ultrasound, or by infrared light in either way."""

    quantities: ClassVar = {"range": Quantity("m")}
    rate_hz: Rate = 20.0
    radiation: Literal["ultrasound", "infrared"]
    field_of_view_deg: Annotated[float, Meta(gt=0, le=120)]
    """Full angle of the cone about x in which things are met."""

    rays: Annotated[int, Meta(ge=1, le=4096)] = 128
    """That fill the cone; 1 is the axis alone."""

    echo: Literal["nearest", "mean"] = "nearest"
    """What a device reports of all it meets: sound the first echo, light the mean over its spot."""

    max_incidence_deg: Annotated[float, Meta(gt=0, le=90)] = 90.0
    """Surfaces that are met at a larger angle from their normal send nothing back."""

    min_range_m: NonNegative = 0.0
    max_range_m: Positive
    full_range_reflectivity: Fraction01 = 0.0
    """Of a surface that is seen up to the largest range; one of a quarter of it, up to half as far.
    0 for no influence."""

    range_stddev_m: NonNegative = 0.0
    """White noise of one measurement, 1 sigma."""

    range_stddev_share: NonNegative = 0.0
    """White noise that grows with the distance, as a share of it."""

    range_stddev_per_m: NonNegative = 0.0
    """White noise that grows with the distance squared, as triangulation has it: metres at 1 m."""

    turn_on_bias_m: NonNegative = 0.0
    """1 sigma of the constant offset drawn for a run."""

    range_resolution_m: NonNegative = 0.0
    """Ranges are rounded to multiples of it; 0 for none."""

    dropout: Fraction01 = 0.0
    """Share of measurements that fail, which the device tells (NaN)."""

    def __post_init__(self) -> None:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"`min_range_m` is {self.min_range_m:g}; expected less than `max_range_m`, "
                f"{self.max_range_m:g}"
            )

    def largest_message(self, carrier: Carrier) -> Range:
        """Return a distance; all are of one size."""
        frame = carrier.frame_prefix + self.frame
        return Range(0, frame, self.radiation, 0.0, 0.0, 0.0, 0.0, 0.0)
