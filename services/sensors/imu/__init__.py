# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `imu`: an inertial measurement unit. Other kinds never import this package."""

from groundlink.messages.base import Imu
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import InertialUnit

KIND = SensorKind(
    spec=InertialUnit,
    streams={"": Imu},
    model="services.sensors.imu.model:ImuModel",
    light=True,
)
