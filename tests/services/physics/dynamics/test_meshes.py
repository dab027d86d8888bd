# SPDX-License-Identifier: Apache-2.0
"""Static meshes: wheels roll on those that are ground, chassis bump into the others."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.core.frames import quaternion_from_rpy
from groundlink.scenario.schema import Placement
from groundlink.world import assets
from groundlink.world.mesh_asset import encode_mesh, load_mesh
from groundlink.world.solids import Box, Material, Mesh, Solid
from groundlink.world.triangles import merged
from services.physics.dynamics import bullet
from services.physics.dynamics.bullet import BulletBackend
from services.physics.dynamics.statics import add_statics
from services.physics.trials.track import FLOOR, drive
from tests.services.physics.grounds import VEHICLES, shipped
from tests.services.physics.terrains import hills, put

GROUND = {"ground": Material(friction=0.7)}


def mesh(vertices: ArrayLike, faces: ArrayLike) -> Mesh:
    """Return a mesh whose asset is in the store."""
    vertices = np.asarray(vertices, np.float32)
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    asset = assets.put(encode_mesh(vertices, np.asarray(faces, np.uint32)))
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
def backend() -> Iterator[BulletBackend]:
    backend = BulletBackend()
    yield backend
    backend.close()


def test_a_mesh_is_met_where_it_stands_hollow_as_it_is(backend: BulletBackend) -> None:
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
    statics = add_statics(backend, [gate], GROUND, clearance_m=0.1)
    [(body, static)] = statics.items()
    assert static.friction == GROUND["ground"].friction
    hit = backend.ray((6.0, 0.0, 1.0), (6.0, 5.0, 1.0))
    assert hit is not None
    met, point = hit
    assert met == body
    assert point == pytest.approx((6.0, 1.9, 1.0), abs=1e-5)
    assert backend.ray((5.0, 0.0, 1.0), (5.0, 5.0, 1.0)) is None


def test_one_mesh_stands_in_many_places(backend: BulletBackend) -> None:
    shape = crate((1.0, 1.0, 1.0))
    crates = [Solid(f"c{i}", shape, "ground", (2.0 * i, 0.0, 0.5)) for i in range(20)]
    statics = add_statics(backend, crates, GROUND, clearance_m=0.1)
    assert len(statics) == 20
    for i in range(20):
        hit = backend.ray((2.0 * i, 0.0, 3.0), (2.0 * i, 0.0, -1.0))
        assert hit is not None
        assert hit[1][2] == pytest.approx(1.0)
    for body in statics:
        backend.remove(body)
    assert backend.ray((0.0, 0.0, 3.0), (0.0, 0.0, -1.0)) is None
    add_statics(backend, crates[:1], GROUND, clearance_m=0.1)
    assert backend.ray((0.0, 0.0, 3.0), (0.0, 0.0, -1.0)) is not None


def test_faces_without_an_area_do_no_harm() -> None:
    heights = hills(41, cell_m=0.5)
    whole = yard(heights, 0.5)
    found = load_mesh(whole.asset)
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
    monkeypatch: pytest.MonkeyPatch, backend: BulletBackend
) -> None:
    monkeypatch.setattr(bullet, "MAX_TRIANGLES", 11)
    solid = Solid("statue", crate((1.0, 1.0, 1.0)), "ground")
    with pytest.raises(UserError, match=r"`statue`: 12 triangles .* expected at most 11.*simplify"):
        add_statics(backend, [solid], GROUND, clearance_m=0.1)


def test_nothing_is_said_while_a_mesh_is_put(
    backend: BulletBackend, capfd: pytest.CaptureFixture[str]
) -> None:
    add_statics(backend, [Solid("c", crate((1.0, 1.0, 1.0)), "ground")], GROUND, clearance_m=0.1)
    assert capfd.readouterr() == ("", "")
