# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.imu --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Imu
from services.sensors.runtime.kinds import Kind, run

from .model import ImuModel

KIND = Kind(Imu, ImuModel)

if __name__ == "__main__":
    run(KIND)
