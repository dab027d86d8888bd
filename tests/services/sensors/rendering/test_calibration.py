# SPDX-License-Identifier: Apache-2.0
"""A chessboard that is drawn through lens and sensor calibrates to what CameraInfo says."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.frames import Floats, transform
from groundlink.scenario import lenses
from groundlink.scenario.schema import Scenario
from services.sensors.rendering.imager import Electronics
from services.sensors.rendering.lens import Lens
from services.sensors.rendering.mesh import VERTEX, Mesh, Skin
from services.sensors.rendering.pinhole import Pinhole
from services.sensors.rendering.renderer import Renderer
from services.sensors.streams import RandomStreams

from . import views
from .test_renderer import lit

PINHOLE = Pinhole(640, 480, 420.0, 424.0, 325.0, 236.0)
SQUARE_M = 0.03
INNER = (11, 8)
"""Corners along x and y of the board, whose middle is at the origin."""

CORNERS = np.array(
    [((x - 5) * SQUARE_M, (y - 3.5) * SQUARE_M, 0.0) for y in range(INNER[1]) for x in range(11)],
    np.float32,
)
VIEWS = 16
FRINGES = {"chromatic_aberration": 0.001, "vignetting": 0.3}
WORLD_FROM_BOARD = transform(np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 0.0, 1.0]))


def chessboard() -> Mesh:
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
    return Mesh(
        np.array(corners, VERTEX),
        np.array(faces, np.uint32),
        Skin(np.full((4, 4), 180, np.uint8)),
    )


def poses(spec: lenses.Lens, away_m: float) -> list[Floats]:
    """Return board_from_optical of cameras whose pictures have the whole board, up to the rim."""
    generator = np.random.default_rng(3)
    project = cv2.projectPoints if spec.model == "plumb_bob" else cv2.fisheye.projectPoints
    made: list[Floats] = []
    while len(made) < VIEWS:
        tilt = generator.uniform(-0.7, 0.7, 2)
        turn = cv2.Rodrigues(np.array([0.0, 0.0, generator.uniform(-np.pi, np.pi)]))[0]
        pose = np.eye(4)
        pose[:3, :3] = turn @ cv2.Rodrigues(np.array([np.pi, 0.0, 0.0]))[0]
        pose[:3, :3] @= cv2.Rodrigues(np.array([*tilt, 0.0]))[0]
        place = [*generator.uniform(-0.5, 0.5, 2), -1.0]
        pose[:3, 3] = away_m * generator.uniform(0.8, 1.4) * (pose[:3, :3] @ place)
        optical_from_board = np.linalg.inv(pose)
        board = (1.2 * CORNERS.astype(np.float64))[:, None]
        if (board[:, 0] @ optical_from_board[2, :3] + optical_from_board[2, 3]).min() < 0.05:
            continue
        flat, _ = project(
            board,
            cv2.Rodrigues(optical_from_board[:3, :3])[0],
            optical_from_board[:3, 3],
            PINHOLE.matrix(),
            np.array(spec.coefficients),
        )
        if ((flat > 4) & (flat < (PINHOLE.width - 5, PINHOLE.height - 5))).all():
            made.append(pose)
    return made


def drawn(scenario: Scenario, spec: lenses.Lens, away_m: float) -> list[NDArray[np.uint8]]:
    """Return grey pictures of the board through a lens."""
    made = Lens(spec, PINHOLE)
    renderer: Renderer = views.renderer(scenario, made.drawn)
    renderer.add(chessboard())
    renderer.place(views.parked(views.surroundings(scenario), (0.0, 0.0, -400.0)))
    grain = Electronics(
        lenses.Imager(full_well_electrons=20000.0, read_noise_electrons=5.0),
        640 * 480,
        RandomStreams(1, "rover/camera"),
    )
    pictures = []
    for tick, pose in enumerate(poses(spec, away_m)):
        colour = made.seen(renderer.draw(WORLD_FROM_BOARD @ pose)).colour
        pictures.append(grain.read(np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)), tick))
    return pictures


def found(pictures: list[NDArray[np.uint8]]) -> tuple[list[Any], list[Any]]:
    """Return corners in the board and in the pictures, of those in which all are seen."""
    solid, flat = [], []
    for picture in pictures:
        seen, corners = cv2.findChessboardCornersSB(picture, INNER, flags=cv2.CALIB_CB_ACCURACY)
        if seen:
            solid.append(CORNERS[None])
            flat.append(corners.reshape(1, -1, 2))
    return solid, flat


@pytest.mark.parametrize(
    ("fields", "away_m"),
    [
        ({"distortion": (-0.20, 0.08, 0.003, -0.004), **FRINGES}, 0.42),
        ({"distortion": (0.15, -0.05)}, 0.42),
        ({"model": "equidistant", "distortion": (-0.05, 0.02)}, 0.25),
    ],
    ids=["barrel", "pincushion", "fisheye"],
)
def test_a_chessboard_calibrates_to_camera_info(fields: dict[str, Any], away_m: float) -> None:
    """K within 0.5 %; the distortion within 2 % of its largest coefficient's shift."""
    spec = lenses.Lens(**fields)
    solid, flat = found(drawn(lit(), spec, away_m))
    assert len(solid) >= 12
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
    print(f"{error=:.3f}", k.tolist(), d.ravel().tolist())
    assert error < 0.2
    assert np.diag(k)[:2] == pytest.approx([PINHOLE.fx, PINHOLE.fy], rel=0.005)
    assert k[:2, 2] == pytest.approx([PINHOLE.cx, PINHOLE.cy], rel=0.005)
    wanted = np.array(spec.coefficients)
    assert d.ravel()[0] == pytest.approx(wanted[0], rel=0.02)
    assert d.ravel()[2:4] == pytest.approx(wanted[2:4], abs=0.02 * abs(wanted[0]))
