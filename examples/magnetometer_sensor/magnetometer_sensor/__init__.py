# SPDX-License-Identifier: Apache-2.0
"""A magnetometer: the sensor kind `magnetometer`.

Processes that only carry its messages import this package, not the model.
"""

from groundlink.scenario.sensor_kinds import MessageSupport, SensorKind

from .message import MagneticField
from .spec import Magnetometer

KIND = SensorKind(
    spec=Magnetometer,
    streams={"": MagneticField},
    model="magnetometer_sensor.model:MagnetometerModel",
    messages={
        MagneticField: MessageSupport(
            codec="magnetometer_sensor.codec:CODEC",
            drawing="magnetometer_sensor.drawing:draw",
        )
    },
)
