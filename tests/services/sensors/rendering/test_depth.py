# SPDX-License-Identifier: Apache-2.0
"""Depth and labels of every pixel, against rays through the same world."""

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.every_sensor import Mount
from services.sensors.rays.replica import Replica
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS

from . import views

PINHOLE = Pinhole(240, 180, 190.0, 170.0, 100.0, 95.5)
"""Neither square nor centered."""

POSES = {
    "lab": [
        views.looking((-4.1, 0.0, 0.5)),
        views.looking((3.0, -1.0, 1.2), yaw_deg=130.0, pitch_deg=15.0),
        views.looking((-3.0, 0.0, 0.9), yaw_deg=-100.0, pitch_deg=25.0),
    ],
    "yard": [
        views.looking((-8.0, -4.0, 0.5)),
        views.looking((4.0, 2.0, 4.0), yaw_deg=-30.0, pitch_deg=30.0),
    ],
}


def cast(replica: Replica, world_from_optical: Floats) -> tuple[Floats, Floats, NDArray[np.int32]]:
    """Return depth along z, normals (3, ...) and labels of each pixel, by rays."""
    rays = np.moveaxis(PINHOLE.rays() @ world_from_optical[:3, :3].T, -1, 0).astype(np.float32)
    origins = np.broadcast_to(world_from_optical[:3, 3, None, None], rays.shape)
    shape = rays.shape[1:]
    hits = replica.scene.cast(origins.astype(np.float32), rays, np.zeros(shape, np.float32), 1e3)
    return hits.range_m.astype(np.float64), hits.normal_in_world.copy(), hits.label.copy()


def inside(normals: Floats, labels: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return the pixels whose neighbors see the same plane of the same solid."""
    same = np.ones(labels.shape, bool)
    for axis in (0, 1):
        for step in (-1, 1):
            other = np.roll(labels, step, axis)
            cosine = np.sum(normals * np.roll(normals, step, axis + 1), axis=0)
            same &= (other == labels) & ((cosine > 0.9999) | (labels < 0))
    same[[0, -1]] = same[:, [0, -1]] = False
    return same


@pytest.mark.parametrize("world", POSES)
def test_depth_agrees_with_rays(world: str) -> None:
    scenario = load(SHIPPED / f"{'indoor_lab' if world == 'lab' else 'yard'}.yaml")
    around = views.world_replica(scenario)
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 50.0)))
    poses = views.parked(around, (-1.0, 0.5, 0.17))
    replica.scene.move(np.stack([poses, poses]))
    made = Renderer(scenario.world, around, PINHOLE, layers=ALL_LAYERS)
    made.place(poses)
    things = made.labels.of_solids(solid.name for solid in around.static)
    vehicles = [made.labels.of_mover(name) for name in around.movers]
    of_label = np.array(
        [
            *things,
            *(v for v, link in zip(vehicles, around.links, strict=True) for _ in link),
            -1,
        ]
    )
    for pose in POSES[world]:
        frame = made.draw(pose)
        depth, normals, labels = cast(replica, pose)
        same = inside(normals, labels)
        assert same.mean() > 0.7
        near = same & (depth < 10.0)
        assert near.sum() > 2000
        assert np.abs(frame.depth_m[near] - depth[near]).max() < 1e-3
        # Farther off it is rounding that grows with depth.
        far = same & np.isfinite(depth)
        assert np.abs(frame.depth_m[far] / depth[far] - 1).max() < 1e-4
        assert np.array_equal(np.isinf(frame.depth_m[same]), np.isinf(depth[same]))
        assert frame.labels is not None
        assert np.array_equal(frame.labels[same], of_label[labels[same]])
