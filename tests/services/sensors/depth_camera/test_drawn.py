# SPDX-License-Identifier: Apache-2.0
"""Depth drawn, against depth by rays."""

from __future__ import annotations

import numpy as np
import pytest

from groundlink.frames import quaternion_from_rpy
from services.sensors.depth_camera.eyes import DrawnEye, RayEye, depth_eye
from tests.services.sensors.rendering.opengl import _opengl as _opengl
from tests.services.sensors.yards import moving

from .specs import spec, world


def test_rays_and_drawing_agree() -> None:
    """Within 1 mm at 10 m away from edges, of a moving vehicle between two states."""
    made, sensor = world(), spec(width=320, height=240)
    turn = quaternion_from_rpy(0.02, 0.05, 0.2)
    run = list(moving([(0.1 * tick, 0.0, 0.1) for tick in range(3)], turn))
    sights = []
    for kind in (DrawnEye, RayEye):
        eye = kind(made, made.vehicles[0], sensor)
        for state in run:
            eye.take(state)
        sights.append(eye.look(2_500_000 + 900_000))
    drawn, cast = sights
    assert drawn.colour is not None
    assert cast.colour is None
    rough = np.zeros(cast.depth_m.shape, bool)
    for axis in (0, 1):
        for step in (-1, 1):
            with np.errstate(invalid="ignore"):
                jump = np.abs(np.roll(cast.depth_m, step, axis) - cast.depth_m)
            rough |= ~(jump < 0.2)
    smooth = ~rough & (cast.depth_m < 10.0)
    assert smooth.mean() > 0.3
    assert np.abs(drawn.depth_m[smooth] - cast.depth_m[smooth]).max() < 1e-3
    assert (np.isinf(drawn.depth_m) == np.isinf(cast.depth_m)).mean() > 0.99
    assert np.isinf(cast.depth_m).any()


def test_with_opengl_depth_is_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    made = world()
    assert isinstance(depth_eye(made, made.vehicles[0], spec()), DrawnEye)
    assert capsys.readouterr().err == ""
