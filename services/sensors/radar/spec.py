# SPDX-License-Identifier: Apache-2.0
"""Specification of a radar in a scenario."""

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta, field

from groundlink.core.fields import Fraction01, NonNegative, Positive
from groundlink.messages.base import packed
from groundlink.messages.imagery import RADAR_POINT, RadarDetections
from groundlink.scenario.every_sensor import Carrier, Rate, SensorSpec
from groundlink.scenario.faults import Quantity

MOST_RAYS = 200_000


class Radar(SensorSpec, frozen=True, tag="radar", kw_only=True):
    """An automotive FMCW radar at 77 GHz that reports detections."""

    quantities: ClassVar = {"range": Quantity("m"), "velocity": Quantity("m/s")}
    rate_hz: Rate = 13.0
    """Frames per second of sim time."""

    horizontal_fov_deg: Annotated[float, Meta(gt=0, le=180)]
    """Full horizontal field of view, centered on x."""

    vertical_fov_deg: Annotated[float, Meta(gt=0, le=90)]
    """Full vertical field of view, centered on x."""

    ray_step_deg: Annotated[float, Meta(gt=0, le=10)] = 0.5
    """Angle between neighboring rays, both ways."""

    min_range_m: NonNegative = 0.2
    """Nearer surfaces give no echo."""

    max_range_m: Positive
    """Limit of the range; the receiver filters out farther echoes."""

    full_range_rcs_dbsm: float
    """Radar cross-section whose echo from the largest range has the threshold's SNR, in dBsm. It
    sets the sensitivity: power, antenna gain and losses."""

    threshold_db: Annotated[float, Meta(ge=3, le=40)] = 12.0
    """Power above which an echo is a detection, over the receiver's noise or that of
    `cfar_cells`."""

    cfar_cells: Annotated[int, Meta(ge=0, le=64)] = 0
    """Range cells on each side whose mean power is the unit of the threshold (cell-averaging CFAR,
    with a guard cell between). 0: receiver noise is the unit."""

    range_resolution_m: Positive
    """Size of a range cell."""

    azimuth_resolution_deg: Annotated[float, Meta(gt=0, le=90)]
    """Size of an azimuth cell at boresight. Cells are even in the sine of the angle, as an antenna
    array forms them, so they are wider to the sides."""

    elevation_resolution_deg: Annotated[float, Meta(ge=0, le=90)] = 0.0
    """Size of an elevation cell at boresight. 0: the device measures no elevation, z is 0."""

    velocity_resolution_mps: Positive
    """Size of a velocity cell."""

    min_velocity_mps: float = -60.0
    """Begin of the unambiguous interval of radial velocities; negative: approaching."""

    max_velocity_mps: float = 60.0
    """End of the unambiguous interval. Velocities beyond appear at its other end."""

    range_stddev_m: NonNegative = 0.0
    """Error of the range in addition to that of thermal noise, 1 sigma."""

    azimuth_stddev_deg: NonNegative = 0.0
    """The same for the azimuth, at boresight."""

    elevation_stddev_deg: NonNegative = 0.0
    """The same for the elevation, at boresight."""

    velocity_stddev_mps: NonNegative = 0.0
    """The same for the radial velocity."""

    fluctuation: Literal["none", "swerling1"] = "none"
    """Fluctuation of echoes from frame to frame. `swerling1`: exponential power, as of many
    scatterers with random phases."""

    false_alarms: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """Mean number of false detections in a frame."""

    max_detections: Annotated[int, Meta(ge=1, le=65536)] = 256
    """Most detections in a frame; of more, the strongest are kept."""

    reflectivities: Mapping[str, Fraction01] = field(default_factory=dict)
    """Power reflectivity at 77 GHz and normal incidence by name of material, where it differs from
    the model's table."""

    def __post_init__(self) -> None:
        for problem in self._problems():
            raise ValueError(problem)

    def _problems(self) -> Iterator[str]:
        if self.min_range_m >= self.max_range_m:
            yield (
                f"`min_range_m` is {self.min_range_m:g}; expected less than `max_range_m`, "
                f"{self.max_range_m:g}"
            )
        span_mps = self.max_velocity_mps - self.min_velocity_mps
        if span_mps <= self.velocity_resolution_mps:
            yield (
                f"`min_velocity_mps` to `max_velocity_mps` spans {span_mps:g} m/s; expected more "
                f"than `velocity_resolution_mps`, {self.velocity_resolution_mps:g}"
            )
        rays = self.horizontal_fov_deg * self.vertical_fov_deg / self.ray_step_deg**2
        if rays > MOST_RAYS:
            yield (
                f"`ray_step_deg` of {self.ray_step_deg:g} makes {rays:.0f} rays; expected "
                f"{MOST_RAYS} at most"
            )

    def largest_message(self, carrier: Carrier) -> RadarDetections:
        """Return a frame with as many detections as the device reports."""
        points = packed(np.zeros(self.max_detections, RADAR_POINT))
        return RadarDetections(0, carrier.frame_prefix + self.frame, points)
