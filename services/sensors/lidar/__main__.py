# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar --name VEHICLE/SENSOR [--native HOST:PORT]``."""

from groundlink.scenario.sensors import Lidar
from services.sensors.shell import run

from .model import LidarModel
from .vlp16 import Vlp16

if __name__ == "__main__":
    run(Lidar, LidarModel, native=lambda _, spec: Vlp16(spec), sees_world=True)
