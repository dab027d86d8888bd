# SPDX-License-Identifier: Apache-2.0
"""Decoder for scenarios from other machines, which may have sensor kinds that this one lacks.

A sensor of an unknown kind becomes an `UnknownSensor`. It keeps its position in the scenario and
has no streams on this machine. Encoding it again gives the original sensor.
"""

from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from .every_sensor import SensorSpec, UnknownSensor
from .schema import Scenario
from .sensor_kinds import sensor_kinds

_UNKNOWN = str(UnknownSensor.__struct_config__.tag)

_SHARED = {*SensorSpec.__struct_fields__, "rate_hz"} - {"faults"}
"""Fields that are kept for a sensor of an unknown kind."""


class Unknown(NamedTuple):
    """A sensor that was taken out of a scenario, with its position."""

    vehicle: int
    position: int
    sensor: UnknownSensor


def decode_scenario(payload: bytes | memoryview) -> Scenario:
    """Return a scenario from MessagePack.

    Raises
    ------
    msgspec.MsgspecError
        when the payload is not a valid scenario.
    """
    try:
        return msgspec.msgpack.decode(payload, type=Scenario)
    except msgspec.ValidationError:
        plain = msgspec.msgpack.decode(payload)
        unknown = take_unknown(plain)
        return put_unknown(msgspec.convert(plain, Scenario), unknown)


def take_unknown(plain: Any) -> list[Unknown]:
    """Remove the sensors of unknown kinds from a scenario as plain data, and return them."""
    found: list[Unknown] = []
    vehicles = plain.get("vehicles") if isinstance(plain, dict) else None
    for v, vehicle in enumerate(vehicles or ()):
        known = []
        for s, stated in enumerate(vehicle.get("sensors", ())):
            sensor = stated["fields"] if stated.get("kind") == _UNKNOWN else stated
            if sensor.get("kind") in sensor_kinds():
                known.append(sensor)
            else:
                shared = {name: value for name, value in sensor.items() if name in _SHARED}
                found.append(
                    Unknown(v, s, msgspec.convert({**shared, "fields": sensor}, UnknownSensor))
                )
        vehicle["sensors"] = known
    return found


def put_unknown(scenario: Scenario, unknown: list[Unknown]) -> Scenario:
    """Return a scenario with the sensors that `take_unknown` removed put back in place."""
    vehicles = list(scenario.vehicles)
    for v, s, sensor in unknown:
        sensors = [*vehicles[v].sensors]
        sensors.insert(s, sensor)
        vehicles[v] = replace(vehicles[v], sensors=tuple(sensors))
    return replace(scenario, vehicles=tuple(vehicles))


def missing_kinds(scenario: Scenario) -> list[str]:
    """Return a line for each kind that is not installed here, with the package to install."""
    sensors = (sensor for vehicle in scenario.vehicles for sensor in vehicle.sensors)
    return [sensor.problem for sensor in sensors if isinstance(sensor, UnknownSensor)]
