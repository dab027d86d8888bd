# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `radar`: an automotive FMCW radar. Other kinds never import this package."""

from groundlink.messages.imagery import RadarDetections
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import Radar

KIND = SensorKind(
    spec=Radar,
    streams={"": RadarDetections},
    model="services.sensors.radar.model:RadarModel",
    sees_world=True,
    disturb={
        "range": "services.sensors.faults.point_effects:offset_range",
        "velocity": "services.sensors.radar.fault_effects:offset_velocity",
    },
    cover="services.sensors.faults.point_effects:cover",
)
