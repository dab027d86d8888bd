# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.depth_camera --name VEHICLE/SENSOR``.

Rule: the model is imported when what it imports is known to be here.
"""

from __future__ import annotations

from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import DepthCamera
from services.sensors.rendering.gl.context import require
from services.sensors.runtime.kinds import Kind, run
from services.sensors.runtime.model import SensorModel


def model(scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> SensorModel:
    """Return the model, or raise a UserError that says what is missing."""
    require("cv2")
    from .model import DepthCameraModel

    return DepthCameraModel(scenario, vehicle, spec)


KIND = Kind(DepthCamera, model, sees_world=True)

if __name__ == "__main__":
    run(KIND)
