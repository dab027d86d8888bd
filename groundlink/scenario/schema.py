# SPDX-License-Identifier: Apache-2.0
"""A resolved scenario: every reference followed, every default filled in.

Rule: types say what is allowed, and nothing else does. Defaults live here, scenario files override
them, and the resolved scenario is saved with each run's report. Angles and units are those of data
sheets, named in the field; they are converted once, where they are used.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.world.room import Clutter, Furniture, Room
from groundlink.world.solids import Material, Solid, Spec, Vector3

from .sensors import Sensor
from .vehicle import VehicleModel

Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
"""Lower case letters, digits and underscores: also a part of a key, a topic and a frame."""

RESERVED_NAMES = frozenset({"state", "clock", "health", "scenario", "ack"})
"""Second parts of the bus's own keys, so no names for vehicles."""

RESERVED_SENSOR_NAMES = frozenset({"command"})
"""Last parts of a vehicle's own keys."""

Address = Annotated[str, Meta(pattern=r"^[^\s:]+:[0-9]{1,5}$")]
"""HOST:PORT."""


class World(Spec, frozen=True, kw_only=True):
    """What stands around the vehicles."""

    name: Name
    materials: dict[str, Material]
    room: Room | None = None
    furniture: tuple[Furniture, ...] = ()
    solids: tuple[Solid, ...] = ()
    """Single static shapes, where no kind of furniture fits."""

    clutter: Clutter | None = None


class Placement(Spec, frozen=True):
    """Where a vehicle starts: its base footprint on the ground, in the world."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_deg: float = 0.0


class Vehicle(Spec, frozen=True, kw_only=True):
    """One vehicle of a run."""

    name: Name
    model: VehicleModel
    placement: Placement = Placement()
    command_topic: str = "/cmd_vel"
    frame_prefix: str = ""
    """Put before the vehicle's frame names where several vehicles share one tf tree."""

    sensors: tuple[Sensor, ...] = ()


class Time(Spec, frozen=True):
    """How sim time runs and what stamps mean."""

    mode: Literal["realtime", "fast"] = "realtime"
    factor: Annotated[float, Meta(gt=0)] = 1.0
    """Sim seconds for each second of the wall's, in realtime mode."""

    epoch: Literal["wall", "zero"] = "wall"
    """Stamp of sim time zero: the wall clock's at the start, or zero."""

    clock_rate_hz: Annotated[float, Meta(gt=0, le=400)] = 100.0
    window_ticks: Annotated[int, Meta(ge=8)] = 400
    """In fast mode physics is at most this far ahead of the slowest sensor; a period of the clock
    or more, since the gateway tells its progress with each message of the clock."""


class Gateway(Spec, frozen=True):
    """The UDP Bridge's end on the simulator's side."""

    bind: Address = "127.0.0.1:7510"
    peer: Address = "127.0.0.1:7511"
    """Where the ROS side listens; every stream with `push` goes there."""

    datagram: Literal["mtu", "loopback"] | Annotated[int, Meta(ge=256, le=65507)] = "loopback"
    signed_peer: bool = False


class Scenario(Spec, frozen=True, kw_only=True):
    """A run: a seed, a world, vehicles with their sensors, and how it meets ROS."""

    name: Name
    description: str = ""
    seed: Annotated[int, Meta(ge=0)] = 0
    time: Time = Time()
    world: World
    vehicles: tuple[Vehicle, ...]
    gateway: Gateway = Gateway()

    def sensor(self, name: str) -> tuple[Vehicle, Sensor] | None:
        """Return the vehicle and the sensor called `vehicle/sensor`, or None."""
        for vehicle in self.vehicles:
            for sensor in vehicle.sensors:
                if f"{vehicle.name}/{sensor.name}" == name:
                    return vehicle, sensor
        return None

    def sensor_names(self) -> list[str]:
        """Return every sensor as `vehicle/sensor`, in the scenario's order."""
        return [f"{v.name}/{s.name}" for v in self.vehicles for s in v.sensors]


__all__ = ["Gateway", "Placement", "Scenario", "Time", "Vector3", "Vehicle", "World"]
