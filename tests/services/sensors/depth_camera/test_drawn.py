# SPDX-License-Identifier: Apache-2.0
"""Depth drawn, against depth by rays."""

import cv2
import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.imagery import CameraInfo, Image
from groundlink.scenario.cameras import Imager, Lens
from services.sensors.camera.model import CameraModel
from services.sensors.camera.spec import Camera
from services.sensors.depth_camera.eyes import DrawnEye, RayEye, depth_eye
from services.sensors.depth_camera.model import DepthCameraModel
from services.sensors.depth_camera.spec import ColorStream
from services.sensors.runtime.model import stream_and_message
from tests.services.sensors.rendering.opengl import _opengl as _opengl
from tests.services.sensors.yards import moving

from .specs import MOUNT, spec, world


def test_rays_and_drawing_agree() -> None:
    """Within 1 mm at 10 m away from edges, of a moving vehicle between two states."""
    made, sensor = world(), spec(width=320, height=240, points_topic="/points")
    turn = quaternion_from_rpy(0.02, 0.05, 0.2)
    run = list(moving([(0.1 * tick, 0.0, 0.1) for tick in range(3)], turn))
    sights = []
    for kind in (DrawnEye, RayEye):
        eye = kind(made, made.vehicles[0], sensor)
        for state in run:
            eye.take(state)
        sights.append(eye.look(2_500_000 + 900_000, 2))
    drawn, cast = sights
    assert drawn.color is not None
    assert cast.color is None
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


@pytest.mark.parametrize(
    ("lens", "fields"),
    [
        (Lens(distortion=(-0.25, 0.06)), {}),
        (Lens(model="equidistant"), {"vertical_fov_deg": 100.0}),
    ],
    ids=["barrel", "fisheye"],
)
def test_behind_a_lens_rays_and_drawing_agree(lens: Lens, fields: dict[str, float]) -> None:
    """The drawn depth is that of the nearest drawn pixel: on a wall ahead it is the same."""
    made, sensor = world(), spec(width=320, height=240, lens=lens, **fields)
    sights = []
    for kind in (DrawnEye, RayEye):
        eye = kind(made, made.vehicles[0], sensor)
        eye.take(next(moving([(0.0, 0.0, 0.0)])))
        sights.append(eye.look(0, 0).depth_m)
    drawn, cast = sights
    wall = np.abs(cast - 7.8) < 1e-3
    assert wall.mean() > 0.05
    off = np.abs(drawn[wall] - 7.8) > 1e-3
    assert off.mean() < 0.1  # along its rim
    ideal = DrawnEye(made, made.vehicles[0], spec(width=320, height=240, **fields))
    ideal.take(next(moving([(0.0, 0.0, 0.0)])))
    assert (np.abs(ideal.look(0, 0).depth_m - 7.8) < 1e-3).sum() != wall.sum()


def test_depth_is_that_amid_the_exposure() -> None:
    """Of a vehicle that nears a wall at 40 m/s, drawn or by rays, with one pose or several."""
    made = world()
    run = list(moving([(0.1 * tick, 0.0, 0.0) for tick in range(6)]))
    for poses in (1, 4):
        sensor = spec(imager=Imager(exposure_s=0.01, poses=poses))
        for kind in (DrawnEye, RayEye):
            eye = kind(made, made.vehicles[0], sensor)
            for state in run[:5]:
                eye.take(state)
            assert eye.look(0, 0).depth_m[57, 130] == pytest.approx(7.6, abs=1e-3)


def test_with_opengl_depth_is_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    made = world()
    assert isinstance(depth_eye(made, made.vehicles[0], spec()), DrawnEye)
    assert capsys.readouterr().err == ""


def test_color_and_points_are_behind_the_lens() -> None:
    """Color is that of a camera with the same lens; points come back to their pixels by D."""
    made = world()
    lens = Lens(distortion=(-0.25, 0.06, 0.002, -0.001), vignetting=0.4)
    imager = Imager(full_well_electrons=3000.0)
    shared = {"width": 160, "height": 120, "mount": MOUNT, "lens": lens, "imager": imager}
    sensor = spec(
        **{"lens": lens, "imager": imager, "points_topic": "/points", "points_every": 4},
        color=ColorStream(topic="/camera/color/image_raw", publish="raw"),
    )
    camera = Camera(name="depth", topic="/image", frame="eye", publish="raw", **shared)
    (state,) = moving([(0.0, 0.0, 0.0)])
    streams = dict(
        map(stream_and_message, DepthCameraModel(made, made.vehicles[0], sensor).readings(state))
    )
    alone = dict(
        map(stream_and_message, CameraModel(made, made.vehicles[0], camera).readings(state))
    )
    color, info = streams["color_image"], streams["camera_info"]
    assert isinstance(color, Image)
    assert isinstance(info, CameraInfo)
    assert bytes(color.data) == bytes(alone["image"].data)
    assert tuple(np.frombuffer(info.distortion)) == lens.coefficients
    cloud = streams["points"].records()
    points = np.stack([cloud["x"], cloud["y"], cloud["z"]], axis=1).astype(np.float64)
    k, d = np.frombuffer(info.intrinsic).reshape(3, 3), np.frombuffer(info.distortion)
    there = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), k, d)[0].reshape(-1, 2)
    assert len(there) > 300
    assert np.abs(there - 4 * np.rint(there / 4)).max() < 0.01
