# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.range --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Range
from services.sensors.runtime.kinds import Kind, run

from .model import RangeModel

KIND = Kind(Range, RangeModel, sees_world=True)

if __name__ == "__main__":
    run(KIND)
