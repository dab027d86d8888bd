# SPDX-License-Identifier: Apache-2.0
"""Model: states of the run in, measurements of the magnetic field out."""

import numpy as np

from groundlink.core.clock import Schedule
from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats, matrix_from_quaternion, multiply
from groundlink.messages.base import BadBusMessage, State
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime.next_event import NextEvent

from .message import MagneticField
from .spec import Magnetometer


def measured(
    spec: Magnetometer, world_from_sensor: Floats, bias_t: Floats, noise: np.random.Generator
) -> Vector3:
    """Return the field along the axes of a sensor with this orientation (quaternion xyzw)."""
    sensor_from_world = matrix_from_quaternion(world_from_sensor).T
    field_t = sensor_from_world @ np.array(spec.earth_field_t) + bias_t
    field_t = field_t + spec.noise_stddev_t * noise.standard_normal(3)
    if spec.resolution_t:
        field_t = np.round(field_t / spec.resolution_t) * spec.resolution_t
    x, y, z = field_t.tolist()
    return x, y, z


class MagnetometerModel:
    """One magnetometer of one vehicle (a `services.sensors.runtime.model.SensorModel`)."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Magnetometer) -> None:
        self._spec, self._vehicle = spec, vehicle.name
        self._frame = vehicle.frame_prefix + spec.frame
        self._base_from_sensor = np.array(spec.mount.quaternion())
        self._streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        turn_on = self._streams.at("turn_on_bias", 0).standard_normal(3)
        self._bias_t = spec.turn_on_bias_t * turn_on
        self._due = NextEvent(Schedule.at(spec.rate_hz))

    def restart(self) -> None:
        """Forget earlier states."""
        self._due.restart()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._due.tick

    def readings(self, state: State) -> list[MagneticField]:
        """Return the measurement that is due by the next tick's state, if there is one."""
        if self._vehicle not in state.vehicles:
            self.restart()
            raise BadBusMessage(f"no vehicle `{self._vehicle}` in this state")
        event = self._due.by(state.tick)
        if event is None:
            return []
        world_from_base = state.vehicles[self._vehicle].poses()[0, 3:]
        world_from_sensor = multiply(world_from_base, self._base_from_sensor)
        noise = self._streams.at("noise", event.tick)
        return [
            MagneticField(
                stamp_nanos=state.epoch_nanos + event.nanos,
                frame=self._frame,
                field_t=measured(self._spec, world_from_sensor, self._bias_t, noise),
                variance_t2=self._spec.noise_stddev_t**2,
            )
        ]
