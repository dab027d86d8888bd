# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.stereo_camera --name VEHICLE/SENSOR``."""

from services.sensors.runtime.process import run
from services.sensors.stereo_camera import KIND

if __name__ == "__main__":
    run(KIND)
