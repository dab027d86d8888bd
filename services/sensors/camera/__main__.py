# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.camera --name VEHICLE/SENSOR``.

Rule: the model is imported when what it imports is known to be here.
"""

from __future__ import annotations

from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Camera
from services.sensors.rendering.gl.context import require
from services.sensors.runtime.kinds import Kind, run
from services.sensors.runtime.model import SensorModel


def model(scenario: Scenario, vehicle: Vehicle, spec: Camera) -> SensorModel:
    """Return the model, or raise a UserError that says what is missing."""
    require("cv2", "moderngl")
    from .model import CameraModel

    return CameraModel(scenario, vehicle, spec)


KIND = Kind(Camera, model, sees_world=True)

if __name__ == "__main__":
    run(KIND)
