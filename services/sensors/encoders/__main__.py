# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.encoders --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Encoders
from services.sensors.runtime.kinds import Kind, run

from .model import EncodersModel

KIND = Kind(Encoders, EncodersModel)

if __name__ == "__main__":
    run(KIND)
