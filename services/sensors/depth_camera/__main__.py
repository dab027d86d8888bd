# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.depth_camera --name VEHICLE/SENSOR``."""

from services.sensors.depth_camera import KIND
from services.sensors.runtime.process import run

if __name__ == "__main__":
    run(KIND)
