# SPDX-License-Identifier: Apache-2.0
"""The scanned room: what is shipped is what its script makes, and all who look at it see it."""

import json
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.loader import load
from groundlink.messages.base import Command
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import Mount
from groundlink.scene.build import solids
from services.physics.simulation.simulation import Simulation
from services.sensors.rays.replica import Replica
from services.sensors.rendering.gl.pinhole import Pinhole
from tests.services.sensors.rendering import views
from tests.services.sensors.rendering.opengl import _opengl as _opengl
from tools import scanned_room


@pytest.fixture(scope="module")
def room() -> Scenario:
    return load("scanned_room")


def parts(file: bytes) -> tuple[dict[str, Any], list[bytes]]:
    """Return a GLB's description, without sizes, and its parts."""
    length = int.from_bytes(file[12:16], "little")
    told = json.loads(file[20 : 20 + length])
    binary = file[20 + length + 8 :]
    views = told.pop("bufferViews")
    told.pop("buffers")
    return told, [binary[v["byteOffset"] : v["byteOffset"] + v["byteLength"]] for v in views]


def test_the_script_makes_what_is_shipped() -> None:
    """But for how the picture is compressed, which is up to zlib."""
    shipped = scanned_room.FILE.read_bytes()
    told, (*numbers, picture) = parts(shipped)
    made, (*made_numbers, made_picture) = parts(scanned_room.glb())
    assert told == made
    assert numbers == made_numbers
    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert np.array_equal(pixels[..., ::-1], scanned_room.picture())
    assert made_picture.startswith(b"\x89PNG")
    assert len(shipped) < 1_000_000


def ranges(room: Scenario, towards: list[tuple[float, float, float]]) -> NDArray[np.float32]:
    """Return how far rays go from the middle of the room, as those of a LiDAR on a mast."""
    replica = Replica(room, room.vehicles[0], Mount((0.0, 0.0, 1.2)))
    parked = views.parked(views.world_replica(room), (0.0, 0.0, -400.0))
    replica.scene.move(np.stack([parked, parked]))
    at = np.array([0.0, 0.0, 1.2], np.float32)
    rays = (np.array(towards, np.float32) - at).T[:, None]
    rays /= np.linalg.norm(rays, axis=0)
    origins = np.broadcast_to(at[:, None, None], rays.shape).copy()
    instants = np.zeros(rays.shape[1:], np.float32)
    return replica.scene.cast(origins, rays, instants, 1e3).range_m[0].copy()


def test_a_lidar_sees_the_walls_and_the_holes(room: Scenario) -> None:
    window, doorway = (-0.5, 3.0, 1.4), (4.0, 0.0, 1.0)
    assert np.isinf(ranges(room, [window, doorway])).all()
    walls = [(-2.0, 3.0, 1.4), (2.0, 3.0, 1.4), (4.0, 1.5, 1.0), (-4.0, 0.0, 1.0), (1.0, 0.0, 0.0)]
    straight = np.linalg.norm(np.array(walls) - (0.0, 0.0, 1.2), axis=1)
    # Uneven by millimeters, and not flat.
    off = ranges(room, walls) - straight
    assert np.abs(off).max() < 0.03
    assert np.abs(off).max() > 1e-4


def test_a_camera_sees_the_picture(room: Scenario) -> None:
    """The squares of the poster are where they are painted, red and white."""
    made = views.renderer(room, Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5))
    color = made.draw(views.looking((2.0, 0.0, 1.4), yaw_deg=90.0)).color.astype(int)
    (left, _), (low, high) = scanned_room.POSTER_M
    for row in range(4):
        for column in range(4):
            x, z = left + 0.25 * (column + 0.5), high - 0.25 * (row + 0.5)
            u, v = 159.5 + 250 * (x - 2.0) / 3.0, 119.5 - 250 * (z - 1.4) / 3.0
            red, green, _ = color[round(v), round(u)].tolist()
            is_red = red > 2 * green
            assert is_red == ((row + column) % 2 == 0), (row, column, red, green)
    assert low < high


def test_a_rover_drives_on_it(room: Scenario) -> None:
    simulation = Simulation(room, solids(room))
    try:
        rows = []
        for _ in range(4 * 400):
            command = Command(simulation.sim_nanos, (0.6, 0.0, 0.0), (0.0, 0.0, 0.0))
            simulation.command("rover", command)
            simulation.step()
            rows.append(simulation.vehicle_states()["rover"].poses()[0])
    finally:
        simulation.close()
    poses = np.array(rows)[200:]
    assert poses[-1, 0] - room.vehicles[0].placement.x_m > 1.8
    assert np.ptp(poses[:, 2]) < 0.03
    assert np.abs(poses[:, 3:5]).max() < 0.03
