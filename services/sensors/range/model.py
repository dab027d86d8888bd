# SPDX-License-Identifier: Apache-2.0
"""Range finder model: one distance from a cone, by ultrasound or infrared light.

Measurement i is taken at event i of the rate's schedule, for the whole cone at once. Rays that fill
the cone evenly determine the surfaces in it, their incidence angles and their reflectivity. Among
the returning rays, ultrasound reports the nearest distance, because the first echo counts; infrared
light through a lens reports the mean over its spot. A smooth wall reflects sound like a mirror. A
surface whose incidence angle exceeds `max_incidence_deg` returns nothing, so only the part of the
cone that meets a slanted wall squarely, if any, detects it. Multiple echoes, the speed of sound and
sunlight are not modeled, nor are the values that real devices report below their minimum range.

Values follow REP 117: -inf below the minimum range, +inf for no return or above the maximum range,
NaN for a measurement that the device reports as failed.
"""

import math

import numpy as np

from groundlink.core.clock import Schedule
from groundlink.core.frames import Floats
from groundlink.messages.base import BadBusMessage, State
from groundlink.messages.imagery import Range
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.normal import PolarNormal
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.probe import RayProbe
from services.sensors.runtime.next_event import NextEvent

from .spec import RangeFinder

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
"""Angle between successive seeds of a sunflower head; it never repeats a direction (Vogel 1979)."""


def cone(field_of_view_rad: float, rays: int) -> Floats:
    """Return unit vectors that fill a cone about x evenly in solid angle, shape (3, rays).

    The first vector is the axis, the last is on the rim.
    """
    numbers = np.arange(rays)
    share = numbers / max(1, rays - 1)
    cosine = 1 - (1 - math.cos(field_of_view_rad / 2)) * share
    sine = np.sqrt(1 - cosine**2)
    around = GOLDEN_ANGLE * numbers
    return np.stack([cosine, sine * np.cos(around), sine * np.sin(around)])


class RangeModel:
    """Range finder of a vehicle (a `SensorModel`).

    Raises
    ------
    KernelsMissingError
        when the compiled loops are not installed; a `UserError`.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: RangeFinder) -> None:
        self._spec = spec
        self._frame = vehicle.frame_prefix + spec.frame
        self._due = NextEvent(Schedule.at(spec.rate_hz))
        self._probe = RayProbe(scenario, vehicle, spec.mount)
        self._field_of_view_rad = math.radians(spec.field_of_view_deg)
        self._cone = cone(self._field_of_view_rad, spec.rays)
        self._least_cosine = math.cos(math.radians(spec.max_incidence_deg))
        self._streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        turn_on = PolarNormal(self._streams.at("turn_on_bias", 0)).draw(1)
        self._bias_m = spec.turn_on_bias_m * float(turn_on[0])
        self.restart()

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""
        self._probe.restart()
        self._due.restart()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._due.tick

    def readings(self, state: State) -> list[Range]:
        """Return the distance that the next tick's state completes, if any.

        Raises
        ------
        BadBusMessage
            when the state lacks a vehicle or a link of the scenario; the model is then restarted.
        """
        try:
            self._probe.take(state)
        except BadBusMessage:
            self.restart()
            raise
        event = self._due.by(state.tick)
        if event is None:
            return []
        range_m = self._reported(self._met(event.nanos), event.tick)
        spec = self._spec
        return [
            Range(
                stamp_nanos=state.epoch_nanos + event.nanos,
                frame=self._frame,
                radiation=spec.radiation,
                field_of_view_rad=self._field_of_view_rad,
                min_range_m=spec.min_range_m,
                max_range_m=spec.max_range_m,
                range_m=range_m,
                variance_m2=self._variance(range_m) if math.isfinite(range_m) else 0.0,
            )
        ]

    def _met(self, nanos: int) -> float:
        """Return the distance without errors; infinite without a return."""
        spec = self._spec
        place = self._probe.place(nanos)
        directions = place.world_from_sensor @ self._cone
        hits = self._probe.cast(nanos, place.origin_in_world, directions, spec.max_range_m)
        # Bodies have no interior: either side of a surface returns the ray.
        cosine = np.abs(np.sum(hits.normal_in_world * directions, axis=0))
        back = (hits.label >= 0) & (cosine >= self._least_cosine)
        if spec.full_range_reflectivity:
            # The returned light of a diffuse surface is rho cos / r^2; the device has a detection
            # limit.
            brightness = self._probe.replica.reflectivity[hits.label] * cosine
            reach = np.minimum(1.0, np.sqrt(brightness / spec.full_range_reflectivity))
            back &= hits.range_m <= spec.max_range_m * reach
        ranges = hits.range_m[back].astype(np.float64)
        if not len(ranges):
            return math.inf
        return float(ranges.min() if spec.echo == "nearest" else ranges.mean())

    def _reported(self, range_m: float, tick: int) -> float:
        """Return the reported distance after noise, bias, rounding, limits and failures."""
        spec = self._spec
        white = float(PolarNormal(self._streams.at("range", tick)).draw(1)[0])
        failed = self._streams.at("dropout", tick).random() < spec.dropout
        if failed:
            return math.nan
        if math.isinf(range_m):
            return math.inf
        range_m += math.sqrt(self._variance(range_m)) * white + self._bias_m
        if spec.range_resolution_m:
            range_m = round(range_m / spec.range_resolution_m) * spec.range_resolution_m
        if range_m < spec.min_range_m:
            return -math.inf
        return range_m if range_m <= spec.max_range_m else math.inf

    def _variance(self, range_m: float) -> float:
        """Return the variance of the white noise at a distance; its causes are independent."""
        spec = self._spec
        return (
            spec.range_stddev_m**2
            + (spec.range_stddev_share * range_m) ** 2
            + (spec.range_stddev_per_m * range_m**2) ** 2
        )
