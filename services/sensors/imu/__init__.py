# SPDX-License-Identifier: Apache-2.0
"""An inertial measurement unit: the kind `imu`. Other kinds never import it."""

from groundlink.messages.base import Imu
from groundlink.scenario import sensors as specs
from groundlink.scenario.sensor_kinds import SensorKind

KIND = SensorKind(
    spec=specs.InertialUnit,
    streams={"": Imu},
    model="services.sensors.imu.model:ImuModel",
)
