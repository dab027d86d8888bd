# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.imu --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Imu
from services.sensors.shell import run

from .model import ImuModel

if __name__ == "__main__":
    run(Imu, ImuModel)
