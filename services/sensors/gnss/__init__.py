# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `gnss`: a satellite navigation receiver. Other kinds never import this package."""

from groundlink.messages.navigation import NavSatFix
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import Gnss

KIND = SensorKind(
    spec=Gnss,
    streams={"": NavSatFix},
    check="services.sensors.gnss.checks:problems",
    model="services.sensors.gnss.model:GnssModel",
    native="services.sensors.gnss.native:native_device",
    light=True,
    sees_world=True,
    disturb={"position": "services.sensors.gnss.fault_effects:offset_position"},
)
