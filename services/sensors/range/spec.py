# SPDX-License-Identifier: Apache-2.0
"""Specification of a range finder in a scenario. The defaults are those of an ideal sensor."""

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from groundlink.core.fields import Fraction01, NonNegative, Positive
from groundlink.messages.imagery import Range
from groundlink.scenario.every_sensor import Carrier, Rate, SensorSpec
from groundlink.scenario.faults import Quantity


class RangeFinder(SensorSpec, frozen=True, tag="range", kw_only=True):
    """A device that measures one distance by ultrasound or infrared light."""

    quantities: ClassVar = {"range": Quantity("m")}
    rate_hz: Rate = 20.0
    """Measurements per second of sim time."""

    radiation: Literal["ultrasound", "infrared"]
    """Type of radiation, as in sensor_msgs/Range."""

    field_of_view_deg: Annotated[float, Meta(gt=0, le=120)]
    """Full angle of the detection cone about x."""

    rays: Annotated[int, Meta(ge=1, le=4096)] = 128
    """Number of rays that fill the cone; 1 casts the axis only."""

    echo: Literal["nearest", "mean"] = "nearest"
    """Reported distance: the nearest return (ultrasound) or the mean over the spot (infrared
    light)."""

    max_incidence_deg: Annotated[float, Meta(gt=0, le=90)] = 90.0
    """Surfaces with a larger angle between ray and normal return nothing."""

    min_range_m: NonNegative = 0.0
    """Smallest distance. Nearer objects are reported as minus infinity (REP 117)."""

    max_range_m: Positive
    """Largest distance. If nothing is nearer, infinity is reported (REP 117)."""

    full_range_reflectivity: Fraction01 = 0.0
    """Reflectivity of a surface that is detected up to the maximum range. A surface with a quarter
    of it is detected up to half the range. 0 disables the limit."""

    range_stddev_m: NonNegative = 0.0
    """White noise of one measurement, 1 sigma."""

    range_stddev_share: NonNegative = 0.0
    """White noise proportional to the distance, as a fraction of it."""

    range_stddev_per_m: NonNegative = 0.0
    """White noise proportional to the distance squared, as with triangulation: value in meters at 1
    m."""

    turn_on_bias_m: NonNegative = 0.0
    """1 sigma of the constant offset that is drawn for each run."""

    range_resolution_m: NonNegative = 0.0
    """Ranges are rounded to multiples of this value; 0 for no rounding."""

    dropout: Fraction01 = 0.0
    """Fraction of measurements that fail and are reported as NaN."""

    def __post_init__(self) -> None:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"`min_range_m` is {self.min_range_m:g}; expected less than `max_range_m`, "
                f"{self.max_range_m:g}"
            )

    def largest_message(self, carrier: Carrier) -> Range:
        """Return a distance reading; all have the same size."""
        frame = carrier.frame_prefix + self.frame
        return Range(0, frame, self.radiation, 0.0, 0.0, 0.0, 0.0, 0.0)
