# SPDX-License-Identifier: Apache-2.0
"""Edges between pixels: colors are the mean light of a pixel's area, depth and labels are not."""

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario import cameras
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS
from services.sensors.rendering.look.mesh import VERTEX, Skin, SkinnedMesh
from tests.services.sensors.rendering.gl.test_renderer import lit

from . import test_calibration as calibration
from . import views

SLANTED = views.looking((0.0, 0.0, 1.0))
SLANTED[:3, :3] @= cv2.Rodrigues(np.array([0.0, 0.0, 0.23]))[0]
NEAR_M, FAR_M = 3.0, 6.0
BASELINE_M = 0.05
VIEW = Pinhole(640, 480, 420.0, 420.0, 319.5, 239.5)


def sheet(away_m: float, half_m: float, tint: float, label: int) -> SkinnedMesh:
    """Return a square that faces west, its middle straight ahead."""
    vertices = np.zeros(4, VERTEX)
    vertices["position"] = [
        (away_m, y * half_m, 1.0 + z * half_m) for y, z in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    vertices["normal"], vertices["tint"], vertices["label"] = (-1, 0, 0), tint, label
    faces = np.array([[0, 2, 1], [0, 3, 2]], np.uint32)
    return SkinnedMesh(vertices, faces, Skin(np.full((4, 4), 180, np.uint8)))


def before_another(**options: Any) -> Renderer:
    """Return a renderer of a bright sheet before a dark one that fills the picture."""
    made = views.renderer(lit(), **options)
    made.add(sheet(NEAR_M, 0.7, 0.6, 0))
    made.add(sheet(FAR_M, 9.0, 0.05, 1))
    made.place(views.parked(views.world_replica(lit()), (0.0, 0.0, -400.0)))
    return made


def covered(finer: int) -> Floats:
    """Return which share of each pixel the near sheet covers, by points of a fine grid."""
    pinhole = views.SMALL
    at = (np.arange(finer) + 0.5) / finer - 0.5
    u = (np.arange(pinhole.width)[:, None] + at).ravel()
    v = (np.arange(pinhole.height)[:, None] + at).ravel()
    rays = np.ones((len(v), len(u), 3))
    rays[..., 0], rays[..., 1] = (u - pinhole.cx) / pinhole.fx, (v[:, None] - pinhole.cy) / 120.0
    there = rays @ SLANTED[:3, :3].T
    there = there / there[..., :1] * NEAR_M
    inside = (np.abs(there[..., 1:]) < 0.7).all(axis=-1)
    return inside.reshape(pinhole.height, finer, pinhole.width, finer).mean(axis=(1, 3))


@pytest.mark.parametrize(("samples", "most"), [(4, 0.13), (16, 0.08)])
def test_an_edge_has_the_light_of_what_it_covers(samples: int, most: float) -> None:
    """In linear light. One sample a pixel is off by 0.3 or more."""
    light = (before_another(samples=samples).draw(SLANTED).color[..., 1] / 255.0) ** 2
    share = covered(16)
    bright, dark = np.median(light[share == 1]), np.median(light[share == 0])
    partly = (share > 0) & (share < 1)
    off = (light - dark)[partly] / (bright - dark) - share[partly]
    assert partly.sum() > 200
    assert np.sqrt(np.mean(off**2)) < most
    assert abs(off.mean()) < 0.02


def test_depth_and_labels_are_those_of_the_center() -> None:
    """They are exactly those of one sample: nothing lies between the two sheets."""
    frames = [before_another(samples=n, layers=ALL_LAYERS).draw(SLANTED) for n in (1, 4, 16)]
    for frame in frames:
        assert frame.labels is not None
        assert set(np.unique(frame.labels)) == {0, 1}
        near = frame.labels == 0
        assert frame.depth_m[near] == pytest.approx(NEAR_M, abs=1e-4)
        assert frame.depth_m[~near] == pytest.approx(FAR_M, abs=1e-4)
        share = covered(1)
        assert (near == (share == 1)).mean() > 0.999
        assert np.array_equal(frame.labels, frames[0].labels)
        assert np.array_equal(frame.depth_m, frames[0].depth_m)


def corner_errors(samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return errors of a chessboard's corners, shape (N, 2), and of their disparities, (N,).

    The camera is ideal, and nothing is blurred before corners are looked for.
    """
    scenario, spec = lit(), cameras.Lens()
    renderer = views.renderer(scenario, VIEW, samples=samples)
    renderer.add(calibration.chessboard())
    renderer.place(views.parked(views.world_replica(scenario), (0.0, 0.0, -400.0)))
    limit = np.array([VIEW.width, VIEW.height]) - 4
    right = np.eye(4)
    right[0, 3] = BASELINE_M
    errors: list[list[NDArray[np.float64]]] = [[], []]
    for pose in calibration.poses(spec, 0.42, VIEW)[:12]:
        for eye, board_from_optical in enumerate((pose, pose @ right)):
            drawn = renderer.draw(calibration.WORLD_FROM_BOARD @ board_from_optical).color
            gray = cv2.cvtColor(drawn, cv2.COLOR_RGB2GRAY)
            corners = np.asarray(calibration.CORNERS, np.float64)
            true = calibration.projected(spec, corners, np.linalg.inv(board_from_optical), VIEW)
            rows = true.reshape(*calibration.INNER[::-1], 2)
            step = min(np.linalg.norm(np.diff(rows, axis=axis), axis=2).min() for axis in (0, 1))
            half = int(np.clip(0.35 * step, 3, 9))  # without the next corner's edges
            inside = ((true > half + 3) & (true < limit - half)).all(axis=1)
            begun = np.where(inside[:, None], true + 0.3, 20.0).astype(np.float32)
            around = (half, half), (-1, -1), (3, 100, 1e-5)
            found = cv2.cornerSubPix(gray, begun.reshape(-1, 1, 2), *around)
            error = found.reshape(-1, 2) - true
            found_it = inside & (np.abs(error) < 2.0).all(axis=1)
            errors[eye].append(np.where(found_it[:, None], error, np.nan))
    left, other = (np.concatenate(of) for of in errors)
    both = np.isfinite(left[:, 0]) & np.isfinite(other[:, 0])
    return left[both], (left - other)[both, 0]


def test_corners_and_disparities_are_known_to_a_tenth_of_a_pixel() -> None:
    """With one sample a pixel it is 0.2 and 0.3; with an exact mean 0.06 would be left."""
    noise = {}
    for samples in (1, 4, 16):
        errors, disparity = corner_errors(samples)
        assert len(errors) > 500
        noise[samples] = float(errors.std()), float(disparity.std())
    print(noise)
    assert noise[4][0] < 0.6 * noise[1][0]
    assert noise[4][1] < 0.6 * noise[1][1]
    assert noise[16][0] < 0.7 * noise[4][0]
    assert max(noise[4]) < 0.16
    assert max(noise[16]) < 0.10
