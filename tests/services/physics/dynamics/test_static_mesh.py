# SPDX-License-Identifier: Apache-2.0
"""Meshes that stand still in the engine: rolled on where they are ground, bumped into elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.core.frames import quaternion_from_rpy
from groundlink.scenario.schema import Placement
from groundlink.world import assets
from groundlink.world.mesh_asset import asset_of, surface
from groundlink.world.solids import Box, Material, Mesh, Solid
from groundlink.world.triangles import merged
from services.physics.dynamics import static_mesh as trimesh
from services.physics.dynamics.engine import Engine
from services.physics.dynamics.statics import add_statics
from tests.services.physics.grounds import FLOOR, VEHICLES, drive, shipped
from tests.services.physics.terrains import hills, put

GROUND = {"ground": Material(friction=0.7)}


def mesh(vertices: ArrayLike, faces: ArrayLike) -> Mesh:
    """Return a mesh whose asset is in the store."""
    vertices = np.asarray(vertices, np.float32)
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    asset = assets.keep(asset_of(vertices, np.asarray(faces, np.uint32)))
    return Mesh(asset=asset, low_m=tuple(low), high_m=tuple(high))


def yard(heights: NDArray[np.floating], cell_m: float) -> Mesh:
    """Return a mesh of ground like a scan of it, around the origin."""
    count = len(heights)
    line = (np.arange(count) - count // 2) * cell_m
    vertices = np.stack([*np.meshgrid(line, line), heights], axis=-1).reshape(-1, 3)
    number = np.arange(count**2).reshape(count, count)
    a, b, c, d = (
        n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    return mesh(vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([d, c, b], 1)]))


def crate(size_m: tuple[float, float, float]) -> Mesh:
    """Return a box as a mesh."""
    triangles = merged([Solid("crate", Box(size_m=size_m), "ground")])
    return mesh(triangles.vertices, triangles.faces)


@pytest.fixture
def engine() -> Iterator[Engine]:
    engine = Engine()
    yield engine
    engine.close()


def test_a_mesh_is_met_where_it_stands_hollow_as_it_is(engine: Engine) -> None:
    """A gate, turned and moved: through its opening a ray goes on."""
    posts = [
        Solid(f"{y}", Box(size_m=(0.2, 0.4, 2.0)), "ground", (0.0, y, 1.0)) for y in (-1.0, 1.0)
    ]
    triangles = merged(posts)
    gate = Solid(
        "gate",
        mesh(triangles.vertices, triangles.faces),
        "ground",
        (5.0, 2.0, 0.0),
        quaternion_from_rpy(0.0, 0.0, np.pi / 2),
    )
    statics = add_statics(engine, [gate], GROUND, clearance_m=0.1)
    [(body, static)] = statics.items()
    assert static.friction == GROUND["ground"].friction
    [(met, _, _, point, _)] = engine.rayTest([6.0, 0.0, 1.0], [6.0, 5.0, 1.0])
    assert met == body
    assert point == pytest.approx((6.0, 1.9, 1.0), abs=1e-5)
    [(met, *_)] = engine.rayTest([5.0, 0.0, 1.0], [5.0, 5.0, 1.0])
    assert met == -1


def test_one_mesh_stands_in_many_places(engine: Engine) -> None:
    shape = crate((1.0, 1.0, 1.0))
    crates = [Solid(f"c{i}", shape, "ground", (2.0 * i, 0.0, 0.5)) for i in range(20)]
    statics = add_statics(engine, crates, GROUND, clearance_m=0.1)
    assert len(statics) == 20
    for i in range(20):
        [(_, _, _, point, _)] = engine.rayTest([2.0 * i, 0.0, 3.0], [2.0 * i, 0.0, -1.0])
        assert point[2] == pytest.approx(1.0)


def test_faces_without_an_area_do_no_harm() -> None:
    heights = hills(41, cell_m=0.5)
    whole = yard(heights, 0.5)
    found = surface(whole.asset)
    spoilt = np.concatenate([found.faces, found.faces[:, [0, 0, 1]], found.faces[:, [2, 2, 2]]])
    solid = Solid("yard", mesh(found.vertices, spoilt), "ground", drivable=True)
    with put(None, shipped("rover"), solid, at=Placement(z_m=float(heights.max()))) as simulation:
        driven = drive(simulation, 3.0, (1.0, 0.3))
    assert np.isfinite(driven.pose).all()
    assert driven.pose[-1, 2] > float(heights.min())


@pytest.mark.parametrize("name", VEHICLES)
def test_wheels_roll_on_a_mesh_that_is_ground_and_do_not_feel_its_edges(name: str) -> None:
    model = shipped(name)
    speed = min(model.top_speed_mps / 2, 2.5)
    high = np.zeros((121, 121))
    high[:, :4] = 2.0  # what makes the mesh as a whole higher than what is rolled over anyway
    solid = Solid("yard", yard(high, 0.5), "ground", drivable=True)
    with put(None, model, solid) as simulation:
        stood = drive(simulation, 0.5)
        drive(simulation, 2.0 + speed / model.drive.max_acceleration_mps2, (speed, 0.0))
        driven = drive(simulation, 4.0, (speed, 0.0))
        [vitals] = simulation.vitals(0)
    assert np.abs(np.diff(stood.velocity[:, :3], axis=0)).max() / TICK_SECONDS < 0.05
    upward = np.diff(driven.velocity[:, 2]) / TICK_SECONDS
    assert upward.std() < 0.05
    assert driven.speed == pytest.approx(speed, rel=0.01)
    assert driven.pose[-1, 2] == pytest.approx(model.base_height_m, abs=2e-3)
    assert not vitals.contacts


def test_wheels_pass_through_a_mesh_that_is_none_and_the_chassis_does_not() -> None:
    solid = Solid("rock", crate((1.0, 4.0, 2.0)), "ground", (2.5, 0.0, 1.0))
    with put(None, shipped("rover"), FLOOR, solid) as simulation:
        driven = drive(simulation, 4.0, (0.8, 0.0))
        [vitals] = simulation.vitals(0)
    half = shipped("rover").chassis.size_m[0] / 2
    assert driven.pose[:, 0].max() == pytest.approx(2.0 - half, abs=0.02)
    assert [contact.name for contact in vitals.contacts] == ["rock"]


def test_too_many_triangles_are_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch, engine: Engine
) -> None:
    monkeypatch.setattr(trimesh, "MOST_TRIANGLES", 11)
    solid = Solid("statue", crate((1.0, 1.0, 1.0)), "ground")
    with pytest.raises(UserError, match=r"`statue` has 12 triangles.*expected 11 at most.*thin"):
        add_statics(engine, [solid], GROUND, clearance_m=0.1)


def test_nothing_is_said_while_a_mesh_is_put(
    engine: Engine, capfd: pytest.CaptureFixture[str]
) -> None:
    add_statics(engine, [Solid("c", crate((1.0, 1.0, 1.0)), "ground")], GROUND, clearance_m=0.1)
    assert capfd.readouterr() == ("", "")
