# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar_2d --name VEHICLE/SENSOR``."""

from services.sensors.lidar_2d import KIND
from services.sensors.runtime.process import run

if __name__ == "__main__":
    run(KIND)
