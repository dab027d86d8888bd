# SPDX-License-Identifier: Apache-2.0
"""Every sensor that casts rays sees a world's terrain, as one body with many materials."""

import msgspec
import numpy as np
import pytest

from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.scene.bodies import NO_BODY, body_names
from groundlink.scene.build import solids
from groundlink.world import assets
from groundlink.world.solids import Material
from groundlink.world.terrain import Terrain, encode_grid
from services.sensors.rays.probe import RayProbe
from services.sensors.rays.replica import Replica
from tests.services.sensors.lidar import rooms

SLOPE = 0.25
"""Of the terrain, eastwards; at the middle of the world its height is -0.5 m."""


@pytest.fixture
def hillside(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """A room whose floor is under a slope of two materials, the darker one in the north."""
    monkeypatch.setenv("GROUNDLINK_ASSETS", str(tmp_path_factory.mktemp("assets")))
    east = np.arange(-10.0, 11.0)
    heights = np.tile(SLOPE * east - 0.5, (21, 1)).astype(np.float32)
    surface = np.repeat([0, 1], 10)[:, None].repeat(20, axis=1).astype(np.uint8)
    terrain = Terrain(
        heights=assets.put(encode_grid(heights)),
        surface=assets.put(encode_grid(surface)),
        cell_m=1.0,
        at_m=(0.0, 0.0, 0.25),
        low_m=(-10.0, -10.0, -3.0),
        high_m=(10.0, 10.0, 3.0),
        materials=("sand", "peat"),
    )
    made = rooms.scenario()
    materials = {"sand": Material(reflectivity=0.5), "peat": Material(reflectivity=0.2)}
    world = msgspec.structs.replace(
        made.world, terrain=terrain, materials={**made.world.materials, **materials}
    )
    return msgspec.structs.replace(made, world=world)


def height_m(x_m: float) -> float:
    return SLOPE * x_m - 0.25


def test_labels_bodies_and_reflectivity(hillside: Scenario) -> None:
    replica = Replica(hillside, hillside.vehicles[0], Mount((0.0, 0.0, 0.5)))
    for state in rooms.states(hillside, lambda _: ((-4.0, -3.0, 2.0), (0, 0, 0)), 2):
        replica.take(state)
    replica.scene.move(replica.motion(0, 1))
    x, y = np.array([[3.0, 1.5, 3.0, -2.0], [-2.5, 2.5, 0.5, 0.5]])
    origins = np.stack([x, y, np.full(4, 2.5)]).astype(np.float32)
    down = np.tile([[0.0], [0.0], [-1.0]], (1, 4)).astype(np.float32)
    hits = replica.scene.cast(origins, down, np.zeros(4, np.float32), 10.0)
    # In the west the room's floor is above the slope.
    np.testing.assert_allclose(
        2.5 - hits.range_m, [height_m(3.0), height_m(1.5), height_m(3.0), 0.0], atol=1e-5
    )
    names = (*body_names(hillside, solids(hillside)),)
    bodies = replica.body_numbers(hits.label, hits.body).tolist()
    assert [names[body] for body in bodies] == ["terrain", "terrain", "terrain", "z-1"]
    assert bodies[0] == len(names) - 1
    assert replica.reflectivity[hits.label] == pytest.approx([0.5, 0.2, 0.2, 0.4])
    none = np.array([-1], np.int32)
    assert replica.body_numbers(none, none).tolist() == [NO_BODY]
    # What is on links comes behind the terrain's materials.
    x_m, y_m, _ = np.add(rooms.WHEELS[0], (-4.0, -3.0, 0.0))
    above = np.array([[x_m], [y_m], [2.9]], np.float32)
    seen = replica.scene.cast(above, down[:, :1], np.zeros(1, np.float32), 10.0)
    assert seen.body[0] > 0
    assert replica.reflectivity[seen.label] == pytest.approx([0.05])


def test_a_lidar_and_its_truth(hillside: Scenario) -> None:
    scan, *_ = rooms.scans(hillside, rooms.at_rest)
    model = rooms.model(hillside)
    names = body_names(hillside, solids(hillside))
    bodies = model.scanner.replica.body_numbers(scan.returns.label, scan.returns.body)
    on_terrain = scan.returns.returned & (bodies == len(names) - 1)
    assert 50 < on_terrain.sum() < scan.returns.returned.sum()
    cloud, *_ = rooms.clouds(hillside, rooms.at_rest)
    points = rooms.in_world(rooms.at_rest, np.zeros(1), rooms.points(cloud))
    on_slope = np.abs(points[:, 2] - height_m(1.0) - SLOPE * (points[:, 0] - 1.0)) < 1e-4
    assert on_slope.sum() >= on_terrain.sum()


def test_a_probe_of_few_rays(hillside: Scenario) -> None:
    """As range finders and the sky of GNSS cast them."""
    probe = RayProbe(hillside, hillside.vehicles[0], Mount(xyz_m=(0.0, 0.0, 0.9)))
    for state in rooms.states(hillside, lambda _: ((2.0, 1.0, 0.6), (0, 0, 0)), 2):
        probe.take(state)
    towards = np.array([[1.0, 0.0, 0.0], [0.2, 0.0, 1.0]]).T
    towards /= np.linalg.norm(towards, axis=0)
    hits = probe.cast(0, np.array([2.0, 1.0, 0.5]), towards, 5.0)
    assert hits.range_m[0] == pytest.approx((0.5 - height_m(2.0)) / SLOPE, abs=1e-5)
    assert hits.label[0] == len(probe.replica.static) + 1
    assert hits.label[1] < len(probe.replica.static)
