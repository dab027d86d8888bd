# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.range --name VEHICLE/SENSOR``."""

from groundlink.scenario.sensors import Range
from services.sensors.shell import run

from .model import RangeModel

if __name__ == "__main__":
    run(Range, RangeModel, sees_world=True)
