# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `wheel_odometry`. Other kinds never import this package."""

from groundlink.messages.navigation import Odometry
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import WheelOdometry

KIND = SensorKind(
    spec=WheelOdometry,
    streams={"": Odometry},
    check="services.sensors.wheel_odometry.checks:problems",
    model="services.sensors.wheel_odometry.model:WheelOdometryModel",
    light=True,
    disturb={"yaw": "services.sensors.wheel_odometry.fault_effects:offset_yaw"},
)
