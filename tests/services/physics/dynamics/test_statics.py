# SPDX-License-Identifier: Apache-2.0
"""The engine's world is the scenario's world."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy
from groundlink.scenario import Scenario
from groundlink.world.bounds import bounds
from groundlink.world.build import solids
from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid, Sphere
from services.physics.dynamics.engine import Engine
from services.physics.dynamics.statics import add_statics


@pytest.fixture
def engine() -> Iterator[Engine]:
    engine = Engine()
    yield engine
    engine.close()


def test_every_solid_is_met_where_it_stands(lab: Scenario, engine: Engine) -> None:
    built = solids(lab)
    statics = add_statics(engine, built, lab.world.materials, clearance_m=0.13)
    for solid in built:
        low, high = bounds(solid)
        center = (low + high) / 2
        # From just above its top down: things that stand on it start above the ray.
        [(body, _, _, point, _)] = engine.rayTest(
            [*center[:2], high[2] + 1e-3], [*center[:2], low[2]]
        )
        assert solid in statics[body].solids
        assert point[2] == pytest.approx(high[2], abs=2e-3), solid.name
        assert statics[body].friction == lab.world.materials[solid.material].friction


def test_static_bodies_are_few(lab: Scenario, engine: Engine) -> None:
    built = solids(lab)
    assert len(built) >= 120
    assert len(add_statics(engine, built, lab.world.materials, clearance_m=0.13)) < 40


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
    engine: Engine, shape: Shape, expected: float, alone: bool
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
    add_statics(engine, [solid] if alone else [solid, far], {"m": Material()}, clearance_m=0.0)
    [(_, _, _, point, _)] = engine.rayTest([1.0, 2.0, 5.0], [1.0, 2.0, 3.0])
    assert point == pytest.approx((1.0, 2.0, 3.0 + expected), abs=1e-3)
    [(_, _, _, point, _)] = engine.rayTest([1.0, 0.0, 3.0], [1.0, 2.0, 3.0])
    assert point == pytest.approx((1.0, 2.0 - 0.3, 3.0), abs=1e-3)


def test_several_worlds_live_side_by_side() -> None:
    first, second = Engine(), Engine()
    second.createMultiBody(0, second.createCollisionShape(second.GEOM_SPHERE, radius=1.0))
    assert first.getNumBodies() == 0
    assert second.getNumBodies() == 1
    first.close()
    assert second.getNumBodies() == 1
    second.close()
    second.close()
