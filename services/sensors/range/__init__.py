# SPDX-License-Identifier: Apache-2.0
"""Sensor kind `range`: a range finder. Other kinds never import this package."""

from groundlink.messages.imagery import Range
from groundlink.scenario.sensor_kinds import SensorKind

from .spec import RangeFinder

KIND = SensorKind(
    spec=RangeFinder,
    streams={"": Range},
    model="services.sensors.range.model:RangeModel",
    light=True,
    sees_world=True,
    disturb={"range": "services.sensors.range.fault_effects:offset_range"},
)
