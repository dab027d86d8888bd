# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `lidar_2d`: a planar laser scanner. Other kinds never import this package."""

from groundlink.messages.imagery import LaserScan
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import Lidar2d

KIND = SensorKind(
    spec=Lidar2d,
    streams={"": LaserScan},
    model="services.sensors.lidar_2d.model:Lidar2dModel",
    sees_world=True,
    disturb={"range": "services.sensors.lidar_2d.fault_effects:offset_range"},
    cover="services.sensors.lidar_2d.fault_effects:cover",
)
