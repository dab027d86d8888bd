# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m magnetometer_sensor --name VEHICLE/SENSOR``."""

from magnetometer_sensor import KIND
from services.sensors.runtime.process import run

if __name__ == "__main__":
    run(KIND)
