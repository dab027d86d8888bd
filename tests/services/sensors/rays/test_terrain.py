# SPDX-License-Identifier: Apache-2.0
"""Rays against terrain: the oracle's answers, PyBullet's, and none that slips through."""

import time
import tracemalloc
from collections.abc import Callable

import numpy as np
import pybullet
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import quaternion_from_rpy
from groundlink.world.solids import Box, Solid, Sphere
from groundlink.world.terrain import Ground
from groundlink.world.triangles import Triangles, merged, of_ground
from services.sensors.rays.builtin import BuiltinEngine
from services.sensors.rays.embree import EmbreeEngine
from services.sensors.rays.engine import RayEngine
from services.sensors.rays.scene import Hits, Scene
from services.sensors.rays.terrain import Relief

from . import oracle
from .grounds import ground, rough, triangles

NOTHING = merged([])
STILL = np.empty((2, 0, 7))
EXACT_M = 1e-5
"""What float32 rounds of a range of 100 m."""

Floats = NDArray[np.float64]


def scene(
    made: Ground, static: Triangles = NOTHING, engine: type[RayEngine] = BuiltinEngine
) -> Scene:
    return Scene(static, engine=engine, terrain=Relief(made, first_label=0))


def cast(
    scene: Scene, origins: Floats, directions: Floats, max_range: float = 100.0
) -> tuple[Hits, tuple[NDArray[np.float32], ...]]:
    """Cast rays, shape (N, 3); return them, too, as they were rounded."""
    rays = origins.astype(np.float32), directions.astype(np.float32)
    times = np.zeros(len(origins), np.float32)
    return scene.cast(rays[0].T, rays[1].T, times, max_range), (*rays, times)


def towards(rng: np.random.Generator, count: int, kind: str) -> Floats:
    """Return unit vectors: any, flat ones, along axes, or eight by eight nearly the same."""
    made = rng.normal(size=(count, 3))
    match kind:
        case "flat":
            made[:, 2] *= 0.03
        case "level":
            made[:, 2] = 0.0
        case "eastward":
            made[:, 1] = 0.0
        case "northward":
            made[:, 0] = 0.0
        case "upright":
            made[:, :2] = 0.0
        case "together":
            made = made[np.arange(count) // 8 * 8] + rng.normal(0, 0.005, (count, 3))
            made[:, 2] *= 0.1
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True))


@pytest.mark.parametrize("rough_m", [0.05, 0.5, 5.0])
@pytest.mark.parametrize(
    "kind", ["any", "flat", "level", "eastward", "northward", "upright", "together"]
)
def test_the_oracle_agrees(kind: str, rough_m: float) -> None:
    """From above, below and outside of small maps of any shape; none is missed or invented."""
    rng = np.random.default_rng(1)
    total = 0
    for rows, columns, cell_m in ((2, 2, 2.0), (2, 30, 0.5), (9, 16, 1.0), (24, 17, 0.25)):
        made = ground(rough(rng, rows, columns, rough_m), cell_m, (-3.0 * cell_m, 5.5))
        low = np.array([made.x0_m - 1, made.y0_m - 1, -3 * rough_m])
        high = low + np.array([(columns - 1) * cell_m + 2, (rows - 1) * cell_m + 2, 6 * rough_m])
        origins = rng.uniform(low, high, (1600, 3))
        if kind == "together":
            origins = origins[np.arange(1600) // 8 * 8]
        hits, rays = cast(scene(made), origins, towards(rng, 1600, kind))
        answer = oracle.cast(triangles(made), [], STILL, *rays, 100.0)
        np.testing.assert_array_equal(np.isfinite(hits.range_m), np.isfinite(answer.range_m))
        hit = np.isfinite(answer.range_m)
        np.testing.assert_allclose(hits.range_m[hit], answer.range_m[hit], rtol=0, atol=EXACT_M)
        np.testing.assert_allclose(hits.normal_in_world.T, answer.normal_in_world, atol=2e-6)
        np.testing.assert_array_equal(hits.label, answer.label)
        assert (hits.body == -1).all()
        total += int(hit.sum())
    assert total > 500


@pytest.mark.parametrize("engine", [EmbreeEngine, BuiltinEngine])
def test_the_nearest_counts_among_solids_and_bodies(engine: type[RayEngine]) -> None:
    rng = np.random.default_rng(2)
    surface = rng.integers(0, 3, (39, 39)).astype(np.uint8)
    made = ground(rough(rng, 40, 40, 0.3), 0.5, (-9.75, -9.75), surface)
    box, ball = Box(size_m=(1.0, 0.6, 1.5)), Sphere(radius_m=0.9)
    static = merged(
        [
            Solid(name=f"b{i}", shape=box, material="m", position_m=tuple(place))
            for i, place in enumerate(rng.uniform((-8, -8, -0.5), (8, 8, 0.5), (25, 3)).tolist())
        ]
    )
    moving = [
        merged([Solid(name=f"s{i}", shape=ball, material="m")], first_label=28 + i)
        for i in range(10)
    ]
    poses = np.zeros((3, 10, 7))
    poses[:, :, :3] = rng.uniform((-6, -6, 0), (6, 6, 0.5), (10, 3))
    poses[1:, :, 0] += [[0.2], [0.4]]
    poses[:, :, 3:] = quaternion_from_rpy(0.1, 0.2, 0.3)
    origins = np.tile([0.3, 0.2, 1.8], (4000, 1))
    directions = np.add(towards(rng, 4000, "flat"), (0, 0, -0.2))
    times = rng.random(4000).astype(np.float32)
    # Labels: static solids, then the terrain's materials, then what is on the bodies.
    mixed = Scene(static, moving, engine, Relief(made, first_label=25))
    mixed.move(poses)
    rays = origins.astype(np.float32), directions.astype(np.float32)
    hits = mixed.cast(rays[0].T, rays[1].T, times, 100.0)
    own = triangles(made, first_label=25)
    everything = Triangles(
        np.concatenate([static.vertices, own.vertices]),
        np.concatenate([static.faces, own.faces + np.uint32(len(static.vertices))]),
        np.concatenate([static.labels, own.labels]),
    )
    answer = oracle.cast(everything, moving, poses, *rays, times)
    hit = np.isfinite(answer.range_m)
    np.testing.assert_array_equal(np.isfinite(hits.range_m), hit)
    np.testing.assert_allclose(hits.range_m[hit], answer.range_m[hit], rtol=0, atol=EXACT_M)
    np.testing.assert_array_equal(hits.label, answer.label)
    np.testing.assert_array_equal(hits.body, answer.body)
    np.testing.assert_allclose(hits.normal_in_world.T, answer.normal_in_world, atol=2e-6)
    for labels in (range(25), range(25, 28), range(28, 38)):
        assert np.isin(hits.label, labels).sum() > 50


def points_of_interest(made: Ground) -> Floats:
    """Return corners, and points on edges and cuts, inside of the map."""
    corners = triangles(made).vertices[triangles(made).faces].astype(np.float64)
    x, y = made.x0_m, made.y0_m
    rows, columns = made.heights.shape
    middle = np.array([x + (columns - 1) * made.cell_m / 2, y + (rows - 1) * made.cell_m / 2])
    reach = np.abs(corners[..., :2] - middle).max(axis=(1, 2))
    inner = corners[reach < (min(rows, columns) / 2 - 1) * made.cell_m]
    ends = np.roll(inner, -1, axis=1)
    on = [inner + share * (ends - inner) for share in (0.0, 0.25, 0.5, 0.3)]
    return np.concatenate(on).reshape(-1, 3)


@pytest.mark.parametrize("rough_m", [0.0, 0.3])
@pytest.mark.parametrize(
    "eye", [None, (0.0, 0.0, 3.0), (0.123, -0.777, 2.3), (1.0, 0.5, -3.0), (1.0, 8.0, 5.0)]
)
def test_no_ray_slips_through_edges_and_corners(
    eye: tuple[float, float, float] | None, rough_m: float
) -> None:
    """A ray that ends on the other side has met the surface."""
    rng = np.random.default_rng(3)
    made = ground(rough(rng, 17, 17, rough_m), 0.5, (-4.0, -4.0))
    targets = points_of_interest(made)
    eyes = np.add(targets, (0, 0, 2.0)) if eye is None else np.tile(eye, (len(targets), 1))
    hits, rays = cast(scene(made), eyes, targets - eyes, 1.05)
    ends = (rays[0] + 1.05 * rays[1].astype(np.float64)).T
    through = (ends[2] < made.height_at(*ends[:2])) == (eyes[:, 2] > 0)
    assert through.sum() > len(targets) / 2
    assert np.isfinite(hits.range_m[through]).all()
    if not rough_m:
        np.testing.assert_allclose(hits.range_m, 1.0, atol=1e-5)


@pytest.mark.parametrize("ahead", [(1, 0), (0, 1), (-1, 0), (0, -1), (1, -1), (-1, 1), (1, 1)])
def test_rays_along_lines_of_the_grid(ahead: tuple[int, int]) -> None:
    """Along rows, columns, cuts and across them, where which cell it is is a matter of taste."""
    line = np.arange(33.0) - 16
    east, north = np.meshgrid(line, line)
    made = ground(np.maximum(0, 4 - np.abs(ahead[0] * east + ahead[1] * north)), 1.0, (-16, -16))
    beside = np.arange(-3, 3.25, 0.25)[:, None] * (-ahead[1], ahead[0], 0)
    directions = np.tile([*map(float, ahead), 0.0], (len(beside), 1))
    hits, _ = cast(scene(made), beside - 10 * directions + (0, 0, 1.5), directions)
    slope = abs(ahead[0]) + abs(ahead[1])
    np.testing.assert_allclose(hits.range_m, 10 - 2.5 / slope, atol=1e-5)


def test_what_passes_over_beside_or_away_meets_nothing() -> None:
    rng = np.random.default_rng(4)
    made = ground(rough(rng, 20, 20, 0.2), 1.0, (0.0, 0.0))
    top = float(made.heights.max())
    rays = [
        ((-5, 5, top + 0.01), (1, 0, 0)),
        ((-5, -0.01, 0), (1, 0, 0)),
        ((5, 5, 3), (0, 0, 1)),
        ((5, 5, -3), (0, 0, -1)),
        ((-1, 5, 5), (0, 0, -1)),
        ((30, 5, 0), (1, 0, 0)),
        ((5, 5, 5), (0, 0, 0)),
        ((5, 5, 3), (0.3, 0.3, -0.1)),
    ]
    origins, directions = (np.array(v, np.float64) for v in zip(*rays, strict=True))
    hits, _ = cast(scene(made), origins, directions, 8.0)
    assert np.isinf(hits.range_m).all()
    assert (hits.label == -1).all()
    endless, _ = cast(scene(made), origins, directions, np.inf)
    assert np.isinf(endless.range_m).tolist() == [True] * 7 + [False]


def test_either_side_is_met() -> None:
    made = ground(np.zeros((5, 5)), 1.0, (-2.0, -2.0))
    hits, _ = cast(
        scene(made),
        np.array([[0.1, 0.2, 2.0], [0.1, 0.2, -3.0], [0.3, 0.1, 0.0]]),
        np.array([[0, 0, -1.0], [0, 0, 1.0], [1.0, 0, 0]]),
    )
    np.testing.assert_allclose(hits.range_m, [2.0, 3.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(hits.normal_in_world.T, [[0, 0, 1]] * 3)


def test_far_from_the_origin() -> None:
    """At 7 km float32 coordinates round where rays start, as the scene says; nothing else does."""
    rng = np.random.default_rng(5)
    made = ground(rough(rng, 60, 60, 2.0), 10.0, (6700.0, -6800.0))
    origins = np.tile([7003.7, -6511.3, 9.1], (1000, 1))
    directions = towards(rng, 1000, "flat")
    hits, rays = cast(scene(made), origins, directions, 300.0)
    answer = oracle.cast(triangles(made), [], STILL, *rays, 300.0)
    hit = np.isfinite(answer.range_m)
    assert hit.sum() > 100
    np.testing.assert_array_equal(np.isfinite(hits.range_m), hit)
    np.testing.assert_allclose(hits.range_m[hit], answer.range_m[hit], rtol=0, atol=3e-5)


def test_pybullet_meets_the_same_triangles() -> None:
    """The cut of each cell is the one of its height fields."""
    rng = np.random.default_rng(6)
    made = ground(rough(rng, 30, 41, 0.5), 0.5, (-10.0, -7.25))
    client = pybullet.connect(pybullet.DIRECT)
    try:
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD,
            meshScale=[made.cell_m, made.cell_m, 1.0],
            heightfieldData=made.heights.ravel().astype(np.float64),
            numHeightfieldRows=41,
            numHeightfieldColumns=30,
            physicsClientId=client,
        )
        lift = (float(made.heights.min()) + float(made.heights.max())) / 2
        pybullet.createMultiBody(0, shape, basePosition=[0, 0, lift], physicsClientId=client)
        starts = rng.uniform((-9, -7, 2.5), (9, 7, 3.5), (1000, 3)).astype(np.float32)
        ends = rng.uniform((-9, -7, -2.5), (9, 7, -2.0), (1000, 3)).astype(np.float32)
        answers = pybullet.rayTestBatch(starts.tolist(), ends.tolist(), physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    hits, _ = cast(scene(made), starts.astype(np.float64), (ends - starts).astype(np.float64), 1.0)
    shares = np.array([answer[2] for answer in answers])
    assert (shares < 1).all()
    length = np.linalg.norm(ends - starts, axis=1)
    np.testing.assert_allclose(hits.range_m * length, shares * length, rtol=0, atol=1e-4)


def test_alone_and_in_packets() -> None:
    """Eight alike are followed together, others one by one."""
    rng = np.random.default_rng(7)
    made = ground(rough(rng, 80, 80, 0.1), 0.25, (-10.0, -10.0))
    looked = scene(made)
    origins, directions = np.tile([0.0, 0.0, 1.0], (403, 1)), towards(rng, 403, "together")
    hits, _ = cast(looked, origins, directions)
    together = hits.range_m.copy()
    for i in range(403):
        one, _ = cast(looked, origins[i : i + 1], directions[i : i + 1])
        np.testing.assert_allclose(one.range_m[0], together[i], rtol=0, atol=1e-6)


def spent(call: Callable[[], object]) -> float:
    started = time.process_time()
    call()
    return time.process_time() - started


def test_a_map_of_15_km_costs_little() -> None:
    """1501 x 1501 heights: less memory than they take themselves, and quicker than a 20th as many
    triangles for Embree."""
    rng = np.random.default_rng(8)
    large = ground(rough(rng, 1501, 1501, 20.0), 10.0, (-7500.0, -7500.0))
    small = triangles(ground(rough(rng, 336, 336, 20.0), 10.0))
    tracemalloc.start()
    try:
        kept = Relief(large, first_label=0)
        now, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert now < large.heights.nbytes
    assert peak < 5 * large.heights.nbytes
    del kept
    assert spent(lambda: Relief(large, first_label=0)) < spent(
        lambda: Scene(small, engine=EmbreeEngine)
    )


@pytest.mark.parametrize("engine", [EmbreeEngine, BuiltinEngine])
def test_as_triangles_it_is_met_where_its_heights_are(engine: type[RayEngine]) -> None:
    """A small terrain is triangles, a large one heights: nobody should be able to tell."""
    random = np.random.default_rng(5)
    surface = random.integers(0, 3, (19, 29)).astype(np.uint8)
    made = ground(rough(random, 20, 30, 1.0), cell_m=0.7, surface=surface)
    heights = Scene(merged([]), engine=engine, terrain=Relief(made, first_label=4))
    faces = Scene(of_ground(made, first_label=4), engine=engine)
    origins = random.uniform(0, (20, 13, 10), (4000, 3)).T.astype(np.float32)
    origins[2] += 5
    directions = random.normal(0, 1, (3, 4000)).astype(np.float32)
    directions[2] = -np.abs(directions[2]) - 0.1
    directions /= np.linalg.norm(directions, axis=0)
    met, same = (
        made_of.cast(origins, directions, np.zeros(4000, np.float32), 100.0)
        for made_of in (heights, faces)
    )
    assert 0.2 < np.isfinite(met.range_m).mean() < 0.8
    alike = met.label == same.label
    assert alike.mean() > 0.999, "but for rays at the edges of cells"
    np.testing.assert_allclose(met.range_m[alike], same.range_m[alike], atol=2e-5)
    np.testing.assert_allclose(
        met.normal_in_world[:, alike], same.normal_in_world[:, alike], atol=1e-4
    )
