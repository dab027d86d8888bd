# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.wheel_odometry --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import WheelOdometry
from services.sensors.runtime.kinds import Kind, run

from .model import WheelOdometryModel

KIND = Kind(WheelOdometry, WheelOdometryModel)

if __name__ == "__main__":
    run(KIND)
