# SPDX-License-Identifier: Apache-2.0
"""The engine against the oracle, and its further guarantees."""

from typing import Any

import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy
from groundlink.world.solids import Box, Cylinder, Solid, Sphere
from groundlink.world.triangles import Triangles, merged
from services.sensors.rays import scene as scene_module
from services.sensors.rays.builtin import BuiltinEngine
from services.sensors.rays.embree import EmbreeEngine, EngineUnavailableError
from services.sensors.rays.engine import RayEngine
from services.sensors.rays.scene import Scene

from . import oracle

STEPS = 41
SECONDS = 0.1


@pytest.fixture(params=[EmbreeEngine, BuiltinEngine])
def engine(request: pytest.FixtureRequest) -> type[RayEngine]:
    made: type[RayEngine] = request.param
    return made


def solid(rng: np.random.Generator, number: int, reach: float) -> Solid:
    size = rng.uniform(0.2, 0.9, 3).tolist()
    shapes = [
        Box(size_m=tuple(size)),
        Cylinder(radius_m=size[0] / 2, length_m=size[1]),
        Sphere(radius_m=size[2] / 2),
    ]
    return Solid(
        name=f"solid{number}",
        shape=shapes[number % 3],
        material="m",
        position_m=tuple(rng.uniform(-reach, reach, 3).tolist()),
        orientation=quaternion_from_rpy(*rng.uniform(-3, 3, 3)),
    )


def room(rng: np.random.Generator, solids: int) -> Triangles:
    walls = [
        Solid(name=f"{axis}{side}", shape=Box(size_m=(9.0, 9.0, 9.0)), material="m", position_m=at)
        for axis in range(2)
        for side in (-1, 1)
        for at in [tuple(12.0 * side if i == axis else 0.0 for i in range(3))]
    ]
    return merged([*walls, *(solid(rng, n, 5.0) for n in range(solids))])


def bodies(rng: np.random.Generator, count: int, first_label: int = 1000) -> list[Triangles]:
    return [
        merged(
            [solid(rng, 3 * n, 0.0), solid(rng, 3 * n + 1, 0.3)], first_label=first_label + 2 * n
        )
        for n in range(count)
    ]


def motion(rng: np.random.Generator, count: int, *, speed: float, turn: float) -> np.ndarray:
    """Poses of bodies at constant velocity, each turning about an axis of its own."""
    t = np.linspace(0, SECONDS, STEPS)[:, None, None]
    start, velocity = rng.uniform(-2.5, 2.5, (count, 3)), rng.normal(0, speed, (count, 3))
    axis = rng.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    half = rng.normal(0, turn, (count, 1)) * t / 2
    position = np.broadcast_to(start + velocity * t, (STEPS, count, 3))
    return np.concatenate([position, axis * np.sin(half), np.cos(half)], axis=-1)


def rays(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    directions = rng.normal(size=(3, count))
    directions /= np.linalg.norm(directions, axis=0)
    return tuple(  # type: ignore[return-value]
        a.astype(np.float32)
        for a in (rng.uniform(-1, 1, (3, count)), directions, rng.random(count))
    )


def check(hits: Any, answer: oracle.Answer, directions: np.ndarray, *, least_hits: int) -> None:
    hit = np.isfinite(answer.range_m)
    assert least_hits < hit.sum()
    np.testing.assert_array_equal(np.isfinite(hits.range_m), hit)
    np.testing.assert_allclose(hits.range_m[hit], answer.range_m[hit], rtol=0, atol=5e-6)
    np.testing.assert_array_equal(hits.label, answer.label)
    np.testing.assert_array_equal(hits.body, answer.body)
    np.testing.assert_allclose(hits.normal_in_world.T, answer.normal_in_world, atol=1e-6)


def test_static_world(engine: type[RayEngine]) -> None:
    rng = np.random.default_rng(1)
    static = room(rng, 12)
    origins, directions, times = rays(rng, 2001)
    hits = Scene(static, engine=engine).cast(origins, directions, times, 100.0)
    answer = oracle.cast(static, [], np.empty((2, 0, 7)), origins.T, directions.T, times)
    check(hits, answer, directions, least_hits=600)
    assert (~np.isfinite(answer.range_m)).sum() > 100


@pytest.mark.parametrize(("speed", "turn"), [(0.0, 0.0), (15.0, 0.0), (0.0, 6.0), (15.0, 6.0)])
def test_moving_bodies_at_mixed_times(speed: float, turn: float, engine: type[RayEngine]) -> None:
    rng = np.random.default_rng(2)
    static, moving = room(rng, 3), bodies(rng, 12)
    poses = motion(rng, 12, speed=speed, turn=turn)
    origins, directions, times = rays(rng, 3000)
    times[:100], times[-100:] = 0.0, 1.0
    scene = Scene(static, moving, engine)
    scene.move(poses)
    hits = scene.cast(origins, directions, times, 100.0)
    answer = oracle.cast(static, moving, poses, origins.T, directions.T, times)
    check(hits, answer, directions, least_hits=1000)
    assert (answer.body >= 0).sum() > 250


def test_poses_count_at_the_instant_of_the_ray(engine: type[RayEngine]) -> None:
    """A plate passes at 10 m/s: only rays in time with it meet it."""
    plate = merged([Solid(name="p", shape=Box(size_m=(0.01, 0.1, 0.1)), material="m")])
    scene = Scene(merged([]), [plate], engine)
    poses = np.tile([2.0, 0, 0, 0, 0, 0, 1], (3, 1, 1))
    poses[:, 0, 1] = (-0.5, 0.0, 0.5)
    scene.move(poses)
    times = np.linspace(0, 1, 100).astype(np.float32)
    origins = np.zeros((3, 100), np.float32)
    directions = np.tile(np.array([[1], [0], [0]], np.float32), (1, 100))
    hits = scene.cast(origins, directions, times, 10.0)
    np.testing.assert_array_equal(np.isfinite(hits.range_m), np.abs(times - 0.5) < 0.05)
    np.testing.assert_allclose(hits.range_m[50], 1.995, atol=1e-6)


@pytest.mark.parametrize("turned", [0.5, 1.4, 3.0])
def test_a_long_body_is_met_wherever_it_turns(turned: float, engine: type[RayEngine]) -> None:
    """Two rods of one shape turn about their middles: rays straight down follow their ends."""
    shape = Box(size_m=(4.0, 0.02, 0.02))
    rods = [
        merged([Solid(name=f"rod{n}", shape=shape, material="m")], first_label=5 + n)
        for n in range(2)
    ]
    scene = Scene(merged([]), rods, engine)
    share = np.linspace(0, 1, STEPS)
    poses = np.zeros((STEPS, 2, 7))
    poses[:, 1, 2] = -1.0
    poses[:, :, 5], poses[:, :, 6] = (f(turned * share / 2)[:, None] for f in (np.sin, np.cos))
    scene.move(poses)
    times = np.linspace(0, 1, 200).astype(np.float32)
    above = 1.9 * np.cos(turned * times), 1.9 * np.sin(turned * times), np.full(200, 5.0)
    below = above[0], above[1], np.full(200, -5.0)
    for origins, upwards, rod in ((above, -1, 0), (below, 1, 1)):
        directions = np.tile(np.array([[0], [0], [upwards]], np.float32), (1, 200))
        hits = scene.cast(np.array(origins, np.float32), directions, times, 10.0)
        np.testing.assert_allclose(hits.range_m, 4.99 - rod, atol=1e-5)
        assert set(hits.label.tolist()) == {5 + rod}
        assert set(hits.body.tolist()) == {rod}


def test_alone_and_in_packets(engine: type[RayEngine]) -> None:
    """Embree follows a lone ray and eight together in different ways."""
    rng = np.random.default_rng(3)
    static, moving = room(rng, 6), bodies(rng, 10)
    scene = Scene(static, moving, engine)
    scene.move(motion(rng, 10, speed=5.0, turn=6.0))
    origins, directions, times = rays(rng, 403)
    hits = scene.cast(origins, directions, times, 100.0)
    for i in range(403):
        one = scene.cast(origins[:, i : i + 1], directions[:, i : i + 1], times[i : i + 1], 100.0)
        assert one.label[0] == hits.label[i]
        np.testing.assert_allclose(one.range_m[0], hits.range_m[i], atol=2e-5)


def test_shape_and_count_do_not_matter(engine: type[RayEngine]) -> None:
    rng = np.random.default_rng(4)
    static = room(rng, 6)
    origins, directions, times = rays(rng, 6 * 40)
    scene = Scene(static, engine=engine)
    flat = scene.cast(origins, directions, times, 100.0)
    shaped = scene.cast(
        *(a.reshape(3, 6, 40) for a in (origins, directions)), times.reshape(6, 40), 100.0
    )
    assert shaped.normal_in_world.shape == (3, 6, 40)
    np.testing.assert_array_equal(shaped.range_m.reshape(-1), flat.range_m)
    for count in (1, 7, 8, 9, 16, 17, 31):
        part = scene.cast(origins[:, :count], directions[:, :count], times[:count], 100.0)
        np.testing.assert_array_equal(
            part.range_m[: count // 16 * 16], flat.range_m[: count // 16 * 16]
        )
        np.testing.assert_allclose(part.range_m, flat.range_m[:count], atol=2e-5)


def test_what_meets_nothing(engine: type[RayEngine]) -> None:
    scene = Scene(
        merged([Solid(name="s", shape=Sphere(radius_m=1.0), material="m")]), engine=engine
    )
    origins = np.array([[-3, -3], [0, 5], [0, 0]], np.float32)
    directions = np.array([[1, 1], [0, 0], [0, 0]], np.float32)
    times = np.zeros(2, np.float32)
    for max_range, reached in ((10.0, True), (1.9, False)):
        hits = scene.cast(origins, directions, times, max_range)
        assert np.isfinite(hits.range_m).tolist() == [reached, False]
        assert hits.label.tolist() == [0 if reached else -1, -1]
        assert hits.body.tolist() == [-1, -1]
        assert not hits.normal_in_world[:, 1].any()


def test_the_number_of_poses_may_change(engine: type[RayEngine]) -> None:
    rng = np.random.default_rng(5)
    moving = bodies(rng, 4)
    origins, directions, times = rays(rng, 500)
    scene = Scene(merged([]), moving, engine)
    for steps in (41, 2, 28, 27, 28):
        poses = motion(rng, 4, speed=5.0, turn=2.0)[:steps]
        scene.move(poses)
        hits = scene.cast(origins, directions, times, 100.0)
        answer = oracle.cast(merged([]), moving, poses, origins.T, directions.T, times)
        check(hits, answer, directions, least_hits=10)


def test_same_bits_every_time(engine: type[RayEngine]) -> None:
    def run() -> bytes:
        rng = np.random.default_rng(6)
        static, moving = room(rng, 6), bodies(rng, 10)
        scene = Scene(static, moving, engine)
        scene.move(motion(rng, 10, speed=5.0, turn=6.0))
        hits = scene.cast(*rays(rng, 5000), 100.0)
        return b"".join(a.tobytes() for a in (hits.range_m, hits.normal_in_world, hits.label))

    assert run() == run()


def test_the_engines_agree() -> None:
    rng = np.random.default_rng(7)
    static, moving = room(rng, 12), bodies(rng, 100)
    poses, cast = motion(rng, 100, speed=15.0, turn=6.0), rays(rng, 40_000)
    answers = []
    for made in (EmbreeEngine, BuiltinEngine):
        scene = Scene(static, moving, made)
        scene.move(poses)
        answers.append(scene.cast(*cast, 100.0))
    embree, builtin = answers
    # A ray that passes an edge within micrometers may meet what is on either side.
    same = (embree.label == builtin.label) & (embree.body == builtin.body)
    same &= np.abs(embree.normal_in_world - builtin.normal_in_world).max(axis=0) < 1e-6
    assert np.mean(same) > 1 - 2e-4
    hit = same & (embree.label >= 0)
    np.testing.assert_allclose(embree.range_m[hit], builtin.range_m[hit], rtol=0, atol=1e-5)


def test_without_embree_the_builtin_engine_is_taken_and_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unavailable() -> None:
        raise EngineUnavailableError("Embree does not start: it needs a CPU with AVX2")

    monkeypatch.setattr(scene_module, "device", unavailable)
    scene_module.best_engine.cache_clear()
    try:
        assert scene_module.best_engine() is scene_module.best_engine() is BuiltinEngine
    finally:
        scene_module.best_engine.cache_clear()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "AVX2" in said
    assert "slower" in said


def test_embree_is_taken_where_it_works() -> None:
    assert scene_module.best_engine() is EmbreeEngine


def sheet(rng: np.random.Generator, *, points: int, cell_m: float, rough_m: float) -> Triangles:
    """A grid of triangles about the origin, on average level."""
    line = (np.arange(points) - points // 2) * cell_m
    x, y = (a.ravel() for a in np.meshgrid(line, line, indexing="ij"))
    corner = (np.arange(points - 1)[:, None] * points + np.arange(points - 1)).ravel()
    a, b, c, d = corner, corner + points, corner + points + 1, corner + 1
    vertices = np.stack([x, y, rough_m * rng.normal(size=x.shape)], axis=-1)
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    labels = np.zeros(len(faces), np.int32)
    return Triangles(vertices.astype(np.float32), faces.astype(np.uint32), labels)


def test_a_grazing_range_is_as_good_as_any(engine: type[RayEngine]) -> None:
    """Ground seen from 1.5 m above, 40 to 140 m away: float32 alone is wrong by tenths of mm."""
    rng = np.random.default_rng(8)
    ground = sheet(rng, points=33, cell_m=10.0, rough_m=0.05)
    angle, slope = rng.uniform(0, 2 * np.pi, 2000), 1.5 / rng.uniform(40, 140, 2000)
    directions = np.stack([np.cos(angle), np.sin(angle), -slope])
    directions = (directions / np.linalg.norm(directions, axis=0)).astype(np.float32)
    origins = np.tile(np.array([[0.3], [0.1], [1.5]], np.float32), (1, 2000))
    times = np.zeros(2000, np.float32)
    hits = Scene(ground, engine=engine).cast(origins, directions, times, 200.0)
    answer = oracle.cast(ground, [], np.empty((2, 0, 7)), origins.T, directions.T, times)
    both = np.isfinite(hits.range_m) & np.isfinite(answer.range_m)
    assert both.sum() > 1900
    np.testing.assert_allclose(hits.range_m[both], answer.range_m[both], rtol=0, atol=2e-5)


def test_no_ray_slips_between_triangles(engine: type[RayEngine]) -> None:
    """Rays at edges and corners, straight down, from the side and from below."""
    rng = np.random.default_rng(9)
    ground = sheet(rng, points=17, cell_m=0.5, rough_m=0.0)
    corners = ground.vertices[ground.faces].astype(np.float64)
    inner = corners[np.abs(corners[..., :2]).max(axis=(1, 2)) < 3.9]
    a, b = inner, np.roll(inner, -1, axis=1)
    targets = np.concatenate([a + share * (b - a) for share in (0.0, 0.25, 0.5, 0.3)])
    targets = targets.reshape(-1, 3)
    for eye in (None, (0.0, 0.0, 2.0), (0.123, -0.777, 1.3), (0.0, 0.0, -2.0)):
        origins = np.add(targets, (0, 0, 1.0)) if eye is None else np.tile(eye, (len(targets), 1))
        origins, directions = origins.astype(np.float32), (targets - origins).astype(np.float32)
        times = np.zeros(len(targets), np.float32)
        hits = Scene(ground, engine=engine).cast(origins.T, directions.T, times, 2.0)
        np.testing.assert_allclose(hits.range_m, 1.0, atol=1e-5)


@pytest.mark.parametrize("away_m", [0.0, 5000.0])
def test_a_world_is_met_up_to_its_bounds(engine: type[RayEngine], away_m: float) -> None:
    """Rays that all go for the rim of a flat square, from above and from below."""
    rng = np.random.default_rng(10)
    rim = np.column_stack([np.full(256, 9.998), rng.uniform(-9.998, 9.998, 256), np.zeros(256)])
    square = sheet(rng, points=3, cell_m=10.0, rough_m=0.0)
    moved = np.array([away_m, -away_m, 0.0])
    vertices = (square.vertices + moved).astype(np.float32)
    scene = Scene(Triangles(vertices, square.faces, square.labels), engine=engine)
    for height in (-0.5, 0.5):
        eye = (moved + np.array((30.0, 3.0, height))).astype(np.float32)
        directions = (rim + moved - eye).astype(np.float32)
        origins = np.tile(eye, (256, 1)).T
        hits = scene.cast(origins, directions.T, np.zeros(256, np.float32), 2.0)
        np.testing.assert_allclose(hits.range_m, 1.0, atol=1e-3)
