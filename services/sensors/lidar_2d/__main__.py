# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar_2d --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Lidar2d
from services.sensors.runtime.kinds import Kind, run

from .model import Lidar2dModel

KIND = Kind(Lidar2d, Lidar2dModel, sees_world=True)

if __name__ == "__main__":
    run(KIND)
