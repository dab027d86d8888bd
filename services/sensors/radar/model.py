# SPDX-License-Identifier: Apache-2.0
"""Radar model: turn states of the world into one set of detections per frame.

Frame i is taken at event i of the rate's schedule, all of it at that instant. A grid of rays fills
the field of view; each ray stands for the patch of surface in its solid angle. The grid is moved by
a random part of a step in each frame, so that nothing stays between two rays. `echoes` gives the
power of each patch, `detector` what a device makes of the echoes.

The radial velocity of a patch is that of the surface less that of the sensor, along the ray, both
as the mean over the last tick of 2.5 ms. Right after a restart in the middle of a run there is no
earlier state, so a frame of that very instant is omitted.

Not modeled: sidelobes and the antenna's gain over the field of view, multipath, corner and
retroreflection, polarization, echoes of rain, mutual interference, and the motion during a frame.
"""

import math

import numpy as np

from groundlink.core.clock import Schedule
from groundlink.messages.base import BadBusMessage, State, packed
from groundlink.messages.imagery import RadarDetections
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.probe import RayProbe
from services.sensors.runtime.next_event import Event, NextEvent

from .detector import Detector, Echoes
from .echoes import (
    OTHER_REFLECTIVITY,
    REFLECTIVITIES,
    RadarEquation,
    cross_sections,
    rain_db_per_km,
)
from .spec import Radar


class RadarModel:
    """Radar of a vehicle (a `SensorModel`).

    Raises
    ------
    KernelsMissingError
        when the compiled loops are not installed; a `UserError`.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Radar) -> None:
        self._spec = spec
        self._frame = vehicle.frame_prefix + spec.frame
        self._due = NextEvent(Schedule.at(spec.rate_hz))
        self._probe = RayProbe(scenario, vehicle, spec.mount)
        known = {**REFLECTIVITIES, **spec.reflectivities}
        self._reflectivity = np.array(
            [known.get(name, OTHER_REFLECTIVITY) for name in self._probe.replica.materials]
        )
        full_db = spec.threshold_db - spec.full_range_rcs_dbsm
        loss = rain_db_per_km(scenario.world.weather.rain_mm_per_h)
        self._equation = RadarEquation(10 ** (full_db / 10) * spec.max_range_m**4, loss)
        self._streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        self._detector = Detector(spec, self._equation, self._streams)
        self._step_rad = math.radians(spec.ray_step_deg)
        columns, rows = (
            max(1, round(angle / spec.ray_step_deg))
            for angle in (spec.horizontal_fov_deg, spec.vertical_fov_deg)
        )
        self._rows, self._columns = (np.arange(n) - (n - 1) / 2 for n in (rows, columns))
        self.restart()

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""
        self._probe.restart()
        self._due.restart()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._due.tick

    def readings(self, state: State) -> list[RadarDetections]:
        """Return the frame that the next tick's state completes, if any.

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
        without_velocities = self._due.tick < 0 and state.tick > 0
        event = self._due.by(state.tick)
        if event is None or without_velocities:
            return []
        points = self._detector.detections(self._echoes(event), event.tick)
        return [RadarDetections(state.epoch_nanos + event.nanos, self._frame, packed(points))]

    def _echoes(self, event: Event) -> Echoes:
        """Return the echoes of all rays that hit something, without errors."""
        up, left = self._streams.at("grid", event.tick).uniform(-0.5, 0.5, 2) * self._step_rad
        elevation, azimuth = (
            angles.ravel()
            for angles in np.meshgrid(
                self._rows * self._step_rad + up,
                self._columns * self._step_rad + left,
                indexing="ij",
            )
        )
        level = np.cos(elevation)
        in_sensor = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        place = self._probe.place(event.nanos)
        rays = place.world_from_sensor @ in_sensor
        hits = self._probe.cast(event.nanos, place.origin_in_world, rays, self._spec.max_range_m)
        hit = (hits.label >= 0) & (hits.range_m >= self._spec.min_range_m)
        in_sensor, rays, range_m = in_sensor[:, hit], rays[:, hit], hits.range_m[hit].astype(float)
        origin = place.origin_in_world[:, None]
        own = self._probe.velocities(event.nanos, origin, np.array([self._probe.replica.carrier]))
        other = self._probe.velocities(event.nanos, origin + range_m * rays, hits.body[hit])
        rcs_m2 = cross_sections(
            range_m,
            # Bodies have no interior: either side of a surface returns the ray.
            np.abs(np.sum(hits.normal_in_world[:, hit] * rays, axis=0)),
            self._reflectivity[hits.label[hit]],
            self._step_rad**2 * level[hit],
        )
        return Echoes(
            range_m,
            in_sensor[1],
            in_sensor[2],
            np.sum((other - own) * rays, axis=0),
            self._equation.snr(rcs_m2, range_m),
        )
