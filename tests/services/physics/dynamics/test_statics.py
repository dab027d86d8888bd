# SPDX-License-Identifier: Apache-2.0
"""The engine's world is the scenario's world."""

from collections.abc import Iterator

import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy
from groundlink.scenario import Scenario
from groundlink.scene.build import solids
from groundlink.world.bounds import bounds
from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid, Sphere
from services.physics.dynamics.bullet import BulletBackend
from services.physics.dynamics.statics import add_statics
from tests.services.physics.free_bodies import FreeBodies


@pytest.fixture
def backend() -> Iterator[BulletBackend]:
    backend = BulletBackend()
    yield backend
    backend.close()


def test_every_solid_is_met_where_it_stands(lab: Scenario, backend: BulletBackend) -> None:
    built = solids(lab)
    statics = add_statics(backend, built, lab.world.materials, clearance_m=0.13)
    for solid in built:
        low, high = bounds(solid)
        center = (low + high) / 2
        # From just above its top down: things that stand on it start above the ray.
        x, y, _ = center.tolist()
        hit = backend.ray((x, y, float(high[2]) + 1e-3), (x, y, float(low[2])))
        assert hit is not None
        body, point = hit
        assert solid in statics[body].solids
        assert point[2] == pytest.approx(high[2], abs=2e-3), solid.name
        assert statics[body].friction == lab.world.materials[solid.material].friction


def test_static_bodies_are_few(lab: Scenario) -> None:
    built = solids(lab)
    assert len(built) >= 120
    assert len(add_statics(FreeBodies(), built, lab.world.materials, clearance_m=0.13)) < 40


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (Box(size_m=(0.2, 0.4, 0.6)), 0.2),
        (Cylinder(radius_m=0.2, length_m=0.6), 0.2),
        (Sphere(radius_m=0.3), 0.3),
    ],
)
def test_shapes_are_placed_and_turned(
    backend: BulletBackend, shape: Shape, expected: float, alone: bool
) -> None:
    solid = Solid(
        name="thing",
        shape=shape,
        material="m",
        position_m=(1.0, 2.0, 3.0),
        # Its own y is the world's z.
        orientation=quaternion_from_rpy(np.pi / 2, 0.0, 0.0),
    )
    far = Solid(name="far", shape=shape, material="m", position_m=(4.0, 2.0, 3.0))
    add_statics(backend, [solid] if alone else [solid, far], {"m": Material()}, clearance_m=0.0)
    hit = backend.ray((1.0, 2.0, 5.0), (1.0, 2.0, 3.0))
    assert hit is not None
    assert hit[1] == pytest.approx((1.0, 2.0, 3.0 + expected), abs=1e-3)
    hit = backend.ray((1.0, 0.0, 3.0), (1.0, 2.0, 3.0))
    assert hit is not None
    assert hit[1] == pytest.approx((1.0, 2.0 - 0.3, 3.0), abs=1e-3)


def test_several_worlds_live_side_by_side() -> None:
    first, second = BulletBackend(), BulletBackend()
    ball = Solid("ball", Sphere(radius_m=1.0), "m")
    add_statics(second, [ball], {"m": Material()}, clearance_m=0.0)
    line = (0.0, 0.0, 5.0), (0.0, 0.0, -5.0)
    assert first.ray(*line) is None
    assert second.ray(*line) is not None
    first.close()
    assert second.ray(*line) is not None
    second.close()
    second.close()
