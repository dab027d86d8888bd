# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.radar --name VEHICLE/SENSOR``."""

from services.sensors.radar import KIND
from services.sensors.runtime.process import run

if __name__ == "__main__":
    run(KIND)
