# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Lidar
from services.sensors.shell import run

from .model import LidarModel

if __name__ == "__main__":
    run(Lidar, LidarModel)
