# SPDX-License-Identifier: Apache-2.0
"""Cameras as their makers describe them."""

import math
from typing import Any

import numpy as np
import pytest

from groundlink.scenario.cameras import Optics
from services.sensors.depth_camera.model import measured
from services.sensors.depth_camera.spec import DepthCamera
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.stereo_camera.spec import StereoCamera
from tests.services.sensors.sheets import from_sheet

SHEETS: dict[str, tuple[type[Optics], float, float]] = {
    "depth_hd_paper": (DepthCamera, 500.0, 495.5),
    "zed2_depth": (DepthCamera, 514.1, 514.1),
    "zed2": (StereoCamera, 514.1, 514.1),
    "realsense_d435i": (DepthCamera, 446.8, 433.0),
}
"""Kind, and what angles and size make of focal lengths, worked out by hand."""


def read(name: str) -> Any:
    kind = SHEETS[name][0]
    topics = {"topic": "/left/image", "right_topic": "/right/image"}
    return from_sheet(kind, name, **(topics if kind is StereoCamera else {}))


@pytest.mark.parametrize("name", SHEETS)
def test_every_sheet_fits_and_has_its_focal_lengths(name: str) -> None:
    spec = read(name)
    assert spec.datasheet
    pinhole = Pinhole.of(spec)
    assert (pinhole.fx, pinhole.fy) == pytest.approx(SHEETS[name][1:], abs=0.06)


@pytest.mark.parametrize(
    ("name", "distance_m", "sheet_m"),
    [("zed2_depth", 3.0, 0.03), ("zed2_depth", 15.0, 0.75), ("realsense_d435i", 2.0, 0.04)],
)
def test_errors_keep_within_the_sheet(name: str, distance_m: float, sheet_m: float) -> None:
    """Nearly all of a wall's pixels are within what the maker promises, and it is not too good."""
    spec = read(name)
    wall = np.full((200, 400), distance_m, np.float32)
    depth_m = measured(wall, Pinhole.of(spec).fx, spec, np.random.default_rng(1))[:, 50:]
    within = np.abs(depth_m - distance_m) < sheet_m
    assert within.mean() > 0.94
    assert depth_m.std() > sheet_m / 4
    assert math.isclose(float(np.median(depth_m)), distance_m, rel_tol=0.005)
