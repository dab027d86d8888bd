# SPDX-License-Identifier: Apache-2.0
"""A chessboard that is drawn through lens and sensor calibrates to what CameraInfo says."""

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import Floats, transform
from groundlink.scenario import cameras
from groundlink.scenario.schema import Scenario
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.look.mesh import VERTEX, Skin, SkinnedMesh
from services.sensors.rendering.optics.imager import Electronics
from services.sensors.rendering.optics.lens import LensOptics
from tests.services.sensors.rendering.gl.test_renderer import lit

from . import views

PINHOLE = Pinhole(1280, 960, 840.0, 848.0, 650.0, 472.0)
"""Wide enough for a lens to bend a lot."""

SQUARE_M = 0.03
INNER = (11, 8)
"""Corners along x and y of the board, whose middle is at the origin."""

CORNERS = np.array(
    [((x - 5) * SQUARE_M, (y - 3.5) * SQUARE_M, 0.0) for y in range(INNER[1]) for x in range(11)],
    np.float32,
)
VIEWS = 12
LEAST_STEP_PX = 20.0
"""Between corners of a view: of smaller squares the detector takes one corner for another."""

REACH = 0.8
"""Of half the picture's diagonal: each view has a corner beyond, where the lens bends most."""

FRINGES = {"chromatic_aberration": 0.001, "vignetting": 0.3}
WORLD_FROM_BOARD = transform(np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 0.0, 1.0]))


def chessboard() -> SkinnedMesh:
    """Return squares with a white rim, in the air, facing up."""
    columns, rows = INNER[0] + 3, INNER[1] + 3
    corners, faces = [], []
    for row in range(rows):
        for column in range(columns):
            inside = 0 < row < rows - 1 and 0 < column < columns - 1
            tint = 0.02 if inside and (row + column) % 2 else 0.7
            for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1)):
                x, y = (column + dx - 7) * SQUARE_M, (row + dy - 5.5) * SQUARE_M
                corners.append(((x, y, 2.0), (0, 0, 1), (x, y), (tint,) * 3, 0))
            first = len(corners) - 4
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return SkinnedMesh(
        np.array(corners, VERTEX),
        np.array(faces, np.uint32),
        Skin(np.full((4, 4), 180, np.uint8)),
    )


def projected(
    spec: cameras.Lens, points: Floats, optical_from_board: Floats, pinhole: Pinhole = PINHOLE
) -> Floats:
    """Return the pixels of points of the board, shape (N, 2), by OpenCV's own formula."""
    project = cv2.projectPoints if spec.model == "plumb_bob" else cv2.fisheye.projectPoints
    turn, place = cv2.Rodrigues(optical_from_board[:3, :3])[0], optical_from_board[:3, 3]
    coefficients = np.array(spec.coefficients)
    flat, _ = project(points[:, None], turn, place, pinhole.matrix(), coefficients)
    return np.asarray(flat[:, 0], np.float64)


def poses(spec: cameras.Lens, away_m: float, pinhole: Pinhole = PINHOLE) -> list[Floats]:
    """Return board_from_optical of cameras whose pictures have the whole board, up to the rim."""
    generator = np.random.default_rng(5)
    board = np.asarray(1.2 * CORNERS, np.float64)
    middle, diagonal_px = (pinhole.cx, pinhole.cy), np.hypot(pinhole.width, pinhole.height)
    made: list[Floats] = []
    while len(made) < VIEWS:
        tilt = generator.uniform(-0.7, 0.7, 2)
        turn = cv2.Rodrigues(np.array([0.0, 0.0, generator.uniform(-np.pi, np.pi)]))[0]
        pose = np.eye(4)
        pose[:3, :3] = turn @ cv2.Rodrigues(np.array([np.pi, 0.0, 0.0]))[0]
        pose[:3, :3] @= cv2.Rodrigues(np.array([*tilt, 0.0]))[0]
        place = [*generator.uniform(-1.0, 1.0, 2), -1.0]
        pose[:3, 3] = away_m * generator.uniform(0.8, 1.4) * (pose[:3, :3] @ place)
        optical_from_board = np.linalg.inv(pose)
        if (board @ optical_from_board[2, :3] + optical_from_board[2, 3]).min() < 0.05:
            continue
        flat = projected(spec, board, optical_from_board, pinhole)
        if not ((flat > 4) & (flat < (pinhole.width - 5, pinhole.height - 5))).all():
            continue
        if np.linalg.norm(flat - middle, axis=1).max() > REACH * diagonal_px / 2:
            made.append(pose)
    return made


def drawn(scenario: Scenario, spec: cameras.Lens, away_m: float) -> list[NDArray[np.uint8]]:
    """Return gray pictures of the board through a lens."""
    made = LensOptics(spec, PINHOLE)
    renderer: Renderer = views.renderer(scenario, made.drawn)
    renderer.add(chessboard())
    renderer.place(views.parked(views.world_replica(scenario), (0.0, 0.0, -400.0)))
    grain = Electronics(
        cameras.Imager(full_well_electrons=20000.0, read_noise_electrons=5.0),
        PINHOLE.width * PINHOLE.height,
        RandomStreams(1, "rover/camera"),
    )
    pictures = []
    for tick, pose in enumerate(poses(spec, away_m)):
        color = made.seen(renderer.draw(WORLD_FROM_BOARD @ pose)).color
        pictures.append(grain.read(np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)), tick))
    return pictures


def found(pictures: list[NDArray[np.uint8]]) -> tuple[list[Any], list[Any]]:
    """Return corners in the board and in the pictures, of those in which all are seen.

    The detector is off by 0.02 to 0.04 pixels towards the middle, whatever draws the board, so it
    only finds where `cornerSubPix` begins.
    """
    solid, flat = [], []
    for picture in pictures:
        small = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        seen, corners = cv2.findChessboardCornersSB(small, INNER, flags=cv2.CALIB_CB_ACCURACY)
        if not seen:
            continue
        begun = (2 * corners + 0.5).astype(np.float32)
        rows = begun.reshape(*INNER[::-1], 2)
        step = min(np.linalg.norm(np.diff(rows, axis=axis), axis=2).min() for axis in (0, 1))
        if step < LEAST_STEP_PX:
            continue
        half = int(np.clip(0.35 * step, 3, 9))  # without the next corner's edges
        corners = cv2.cornerSubPix(picture, begun, (half, half), (-1, -1), (3, 50, 1e-4))
        solid.append(CORNERS[None])
        flat.append(corners.reshape(1, -1, 2))
    return solid, flat


def seen_points(spec: cameras.Lens) -> Floats:
    """Return what a lens puts on pixels all over the picture, in its frame, shape (N, 3)."""
    undistort = cv2.undistortPoints if spec.model == "plumb_bob" else cv2.fisheye.undistortPoints
    flat = np.ascontiguousarray(PINHOLE.rays()[::24, ::24, :2]).reshape(-1, 1, 2)
    rays = undistort(flat, np.eye(3), np.array(spec.coefficients))[:, 0]
    return np.concatenate([rays, np.ones((len(rays), 1))], axis=1)


def displacements(spec: cameras.Lens, points: Floats) -> Floats:
    """Return by how many pixels the coefficients of a lens move points, shape (N, 2)."""
    ideal = cameras.Lens(model=spec.model)
    return projected(spec, points, np.eye(4)) - projected(ideal, points, np.eye(4))


@pytest.mark.parametrize(
    ("fields", "away_m"),
    [
        ({"distortion": (-0.25, 0.10, 0.010, -0.012), **FRINGES}, 0.42),
        ({"distortion": (0.25, -0.12)}, 0.42),
        ({"model": "equidistant", "distortion": (-0.08, 0.04)}, 0.25),
    ],
    ids=["barrel", "pincushion", "fisheye"],
)
def test_a_chessboard_calibrates_to_camera_info(fields: dict[str, Any], away_m: float) -> None:
    """K within 0.5 %; every coefficient, and what they do anywhere in the picture, within 2 %."""
    spec = cameras.Lens(**fields)
    solid, flat = found(drawn(lit(), spec, away_m))
    assert len(solid) >= 0.6 * VIEWS
    size = (PINHOLE.width, PINHOLE.height)
    if spec.model == "plumb_bob":
        flags = cv2.CALIB_FIX_K3
        error, k, d, *_ = cv2.calibrateCamera(solid, flat, size, None, None, flags=flags)
    else:
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC + cv2.CALIB_FIX_SKEW
        flags += cv2.CALIB_FIX_K3 + cv2.CALIB_FIX_K4
        error, k, d, *_ = cv2.fisheye.calibrate(
            solid, flat, size, np.eye(3), np.zeros(4), flags=flags
        )
    told, calibrated = spec.coefficients, tuple(d.ravel().tolist()[: len(spec.coefficients)])
    print(f"{error=:.3f}", len(solid), k.tolist(), calibrated)
    assert error < 0.15
    assert np.diag(k)[:2] == pytest.approx([PINHOLE.fx, PINHOLE.fy], rel=0.005)
    assert k[:2, 2] == pytest.approx([PINHOLE.cx, PINHOLE.cy], rel=0.005)
    # Where a coefficient is zero, what is found must be small beside the others.
    assert calibrated == pytest.approx(told, rel=0.02, abs=0.005 * abs(told[0]))
    points = seen_points(spec)
    wanted = displacements(spec, points)
    found_px = displacements(cameras.Lens(model=spec.model, distortion=calibrated), points)
    shift_px = np.linalg.norm(wanted, axis=1)
    off_px = np.linalg.norm(found_px - wanted, axis=1)
    counts = shift_px > 0.1 * shift_px.max()
    assert (off_px[counts] / shift_px[counts]).max() < 0.02
