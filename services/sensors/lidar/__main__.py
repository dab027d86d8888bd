# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar --name VEHICLE/SENSOR [--native HOST:PORT]``."""

from groundlink.scenario.sensors import Lidar
from services.sensors.runtime.kinds import Kind, run

from .model import LidarModel
from .vlp16 import Vlp16

KIND = Kind(Lidar, LidarModel, native=lambda _, spec: Vlp16(spec), sees_world=True)

if __name__ == "__main__":
    run(KIND)
