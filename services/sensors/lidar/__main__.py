# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar --name VEHICLE/SENSOR [--native HOST:PORT]``."""

from services.sensors.lidar import KIND
from services.sensors.runtime.process import run

if __name__ == "__main__":
    run(KIND)
