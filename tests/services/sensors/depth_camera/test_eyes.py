# SPDX-License-Identifier: Apache-2.0
"""Depth by rays, where OpenGL is missing."""

import subprocess
import sys

import numpy as np
import pytest

from services.sensors.depth_camera import eyes
from services.sensors.depth_camera.eyes import RayEye, depth_eye
from services.sensors.depth_camera.spec import ColorStream
from services.sensors.rendering.gl.context import RenderingUnavailableError
from tests.services.sensors.yards import moving

from .specs import spec, world


def unavailable() -> None:
    raise RenderingUnavailableError("cameras need OpenGL 3.3 by EGL, which does not open here")


def test_a_ray_eye_measures_along_z() -> None:
    """All of a wall that is square to the camera is equally deep."""
    made = world()
    eye = RayEye(made, made.vehicles[0], spec())
    eye.take(next(moving([(0.0, 0.0, 0.0)])))
    wall = eye.look(0, 0).depth_m[55:60, 100:150]
    assert np.abs(wall - 7.8).max() < 1e-4


def test_without_opengl_depth_is_by_rays_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(eyes, "open_context", unavailable)
    made = world()
    assert isinstance(depth_eye(made, made.vehicles[0], spec()), RayEye)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("measures depth by rays: cameras need OpenGL")
    with pytest.raises(RenderingUnavailableError):
        depth_eye(made, made.vehicles[0], spec(color=ColorStream(topic="/camera/color/image_raw")))


def test_without_moderngl_the_model_can_still_be_imported() -> None:
    script = "import sys; from services.sensors.depth_camera import model; "
    script += "sys.exit('moderngl' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], timeout=60, check=False)
    assert done.returncode == 0
