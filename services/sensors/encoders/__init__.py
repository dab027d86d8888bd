# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `encoders`: wheel encoders. Other kinds never import this package."""

from groundlink.messages.base import WheelEncoders
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import Encoders

KIND = SensorKind(
    spec=Encoders,
    streams={"": WheelEncoders},
    check="services.sensors.encoders.checks:problems",
    model="services.sensors.encoders.model:EncodersModel",
    light=True,
    disturb={"ticks": "services.sensors.encoders.fault_effects:offset_ticks"},
)
