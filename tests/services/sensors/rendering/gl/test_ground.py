# SPDX-License-Identifier: Apache-2.0
"""Terrain in pictures: the triangles that rays meet, none missing, and its look."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats
from groundlink.loader.partial_scenario import load_partial
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.world.terrain import Ground, load_ground
from groundlink.world.weather import Lamps, Sun
from services.sensors.rays.replica import Replica
from services.sensors.rendering.gl import ground_levels
from services.sensors.rendering.gl.ground_levels import EXACT_M, HALF_PIXEL, SIDE, Levels
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS
from services.sensors.rendering.look import ground_paint
from tests.services.sensors.rays import grounds
from tests.services.sensors.rendering import views
from tests.services.sensors.rendering.hilly import hilly, waves
from tests.services.sensors.yards import box

PINHOLE = Pinhole(320, 240, 200.0, 200.0, 159.5, 119.5)
EVERYWHERE = np.diag([0.0, 0.0, 0.0, 1.0])
"""A view in which everything is amid the picture."""


def relief(scenario: Scenario) -> Ground:
    assert scenario.world.terrain
    return load_ground(scenario.world.terrain)


def above(scenario: Scenario, x: float, y: float, up: float, **turn: float) -> Floats:
    """Return world_from_optical so high above the terrain."""
    z = float(relief(scenario).height_at(x, y)) + up
    return views.looking((x, y, z), **turn)


def cast(scenario: Scenario, pose: Floats, sub_pixel: float = 0.0) -> NDArray[np.float32]:
    """Return the depth of each pixel by rays, those of pixels a bit lower."""
    replica = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 50.0)))
    parked = views.parked(views.world_replica(scenario), (0.0, 0.0, -400.0))
    replica.scene.move(np.stack([parked, parked]))
    local = PINHOLE.rays() + np.array([0.0, sub_pixel / PINHOLE.fy, 0.0])
    rays = np.moveaxis(local @ pose[:3, :3].T, -1, 0).astype(np.float32)
    origins = np.broadcast_to(pose[:3, 3, None, None], rays.shape).astype(np.float32)
    hits = replica.scene.cast(origins, rays, np.zeros(rays.shape[1:], np.float32), 1e5)
    return hits.range_m.copy()


@pytest.mark.parametrize(("rows", "columns"), [(130, 95), (2, 2), (40, 18), (4 * SIDE + 1,) * 2])
def test_errors_are_upper_bounds(rows: int, columns: int) -> None:
    rng = np.random.default_rng(rows)
    made = grounds.ground(np.cumsum(rng.normal(0, 0.1, (rows, columns)), axis=0))
    heights = made.heights
    y, x = np.indices(heights.shape)
    for level in Levels(made)._levels:
        stride = level.stride
        at_y, at_x = (np.append(np.arange(0, n - 1, stride), n - 1) for n in (rows, columns))
        coarse = np.ascontiguousarray(heights[np.ix_(at_y, at_x)])
        cell_y, cell_x = (
            np.clip(np.searchsorted(at, of, "right") - 1, 0, len(at) - 2)
            for at, of in ((at_y, y), (at_x, x))
        )
        v = (y - at_y[cell_y]) / np.diff(at_y)[cell_y]
        u = (x - at_x[cell_x]) / np.diff(at_x)[cell_x]
        apart = np.abs(grounds.ground(coarse).height_at(cell_x + u, cell_y + v) - heights)
        patch = cell_y // SIDE * level.columns + cell_x // SIDE
        worst = np.zeros(len(level.error_m))
        np.maximum.at(worst, patch, apart)
        assert (worst <= level.error_m + 1e-4).all()
        if stride in (2, 4):
            # Patches share their edges: the worst place may be counted to its neighbor here.
            assert np.median(worst - level.error_m) > -0.05 * level.error_m.max(), "too careful"


def test_patches_cover_the_map_once_and_fit_the_distance() -> None:
    made = grounds.ground(waves(301, 222, high=0.5, long=80.0), cell_m=2.0)
    levels, eye, focal = Levels(made), np.array([150.0, 300.0, 2.0]), 300.0
    shown = levels.shown(EVERYWHERE, eye, focal)
    covered = np.zeros((300, 221), int)
    for column, row, stride in shown.tolist():
        covered[row : row + SIDE * stride, column : column + SIDE * stride] += 1
    assert (covered == 1).all()
    assert len(set(shown[:, 2].tolist())) >= 3, "the test needs several levels"
    by_stride = {level.stride: level for level in levels._levels}
    last = 0.0
    for column, row, stride in shown.tolist():
        level = by_stride[stride]
        number = np.array([row // (SIDE * stride) * level.columns + column // (SIDE * stride)])
        (away_m,) = level.boxes.picked(number).away(eye).tolist()
        assert away_m >= last, "near ones are drawn first"
        last = away_m
        assert stride == 1 or level.error_m[number] <= HALF_PIXEL / focal * away_m
        assert stride == 1 or away_m > EXACT_M


def holes(made: Renderer, pose: Floats) -> int:
    """Return the pixels that show the sky below ground; the camera has to be level."""
    sky = np.isinf(made.draw(pose).depth_m)
    below = np.maximum.accumulate(~sky, axis=0)
    assert below.any()
    return int((sky & below).sum())


def test_no_cracks_between_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a level camera, below a pixel of ground there is ground."""
    scenario = hilly(waves(400, 400, high=12.0, long=120.0), cell_m=1.5)
    made = views.renderer(scenario, PINHOLE)
    places = [(x, y, up) for x, y in ((0, 0), (90, -140), (-200, 60)) for up in (0.4, 3.0, 40.0)]
    found = []
    for _ in range(2):
        found.append(
            sum(
                holes(made, above(scenario, x, y, up, yaw_deg=yaw))
                for x, y, up in places
                for yaw in (0.0, 100.0, 220.0)
            )
        )
        # The same without skirts: there are cracks to be seen.
        from services.sensors.rendering.gl import ground as drawn

        monkeypatch.setattr(drawn, "_patch", without_skirts(drawn._patch))
        made = views.renderer(scenario, PINHOLE)
    assert found[0] == 0
    assert found[1] > 0


def without_skirts(patch: Any) -> Any:
    def made() -> Any:
        knots, faces = patch()
        return knots, faces[: 2 * SIDE * SIDE]

    return made


def away_from_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return the pixels whose neighbors to the left and right are at about the same distance."""
    around = [np.roll(1 / depth_m, step, axis=1) for step in (-1, 0, 1)]
    return np.ptp(around, axis=0) < 0.1 / depth_m


@pytest.mark.parametrize("at", [(0.0, 0.0), (5990.0, -5980.0)])
def test_depth_is_that_of_rays(at: tuple[float, float]) -> None:
    """Near to a millimeter, also far from the origin; farther off to half a pixel."""
    scenario = hilly(
        waves(1201, 1201, high=30.0, long=150.0),
        box("post", (0.3, 0.3, 30.0), (at[0] + 6.0, at[1] + 1.0, 0.0)),
        cell_m=10.0,
    )
    made = views.renderer(scenario, PINHOLE, layers=ALL_LAYERS)
    seen_near = seen_far = 0
    for up, yaw, pitch in ((0.6, 20.0, 8.0), (2.0, -100.0, 20.0), (30.0, 150.0, 30.0)):
        pose = above(scenario, *at, up, yaw_deg=yaw, pitch_deg=pitch)
        frame = made.draw(pose)
        exact, higher, lower = (cast(scenario, pose, shift) for shift in (0.0, -0.6, 0.6))
        inside = np.isfinite(exact + higher + lower) & away_from_edges(exact)
        near, far = inside & (exact < 10.0), inside & (exact >= 10.0)
        assert np.abs(frame.depth_m[near] - exact[near]).max(initial=0.0) < 1e-3
        low, high = np.minimum(higher, lower)[far], np.maximum(higher, lower)[far]
        assert (
            (frame.depth_m[far] > low - 1e-2) & (frame.depth_m[far] < high + 1e-2)
        ).mean() > 0.999
        seen_near, seen_far = seen_near + near.sum(), seen_far + far.sum()
        assert frame.labels is not None
        terrain = made.labels.instances.index("terrain")
        assert made.labels.classes[terrain] == "terrain"
        assert (frame.labels[far] == terrain).mean() > 0.5
    assert seen_near > 5000
    assert seen_far > 20000


def test_the_ground_shows_its_materials() -> None:
    surface = np.zeros((60, 60), np.uint8)
    surface[:, 30:] = 1  # sand in the east
    made = views.renderer(hilly(np.zeros((61, 61)), surface=surface), PINHOLE)
    color = made.draw(views.looking((0.0, 0.0, 6.0), yaw_deg=90.0, pitch_deg=45.0)).color
    grass, sand = (
        color[80:, half].astype(float).mean(axis=(0, 1))
        for half in (slice(0, 100), slice(220, None))
    )
    assert grass[1] > 1.4 * grass[0]
    assert sand[0] > 1.4 * sand[1]
    # There is something to track, and colors flow into each other.
    assert color[150:, :100].std(axis=(0, 1)).max() > 4
    across = color[200, :, 0].astype(float)
    smoothed = np.convolve(across, np.ones(9) / 9, "valid")
    assert np.abs(np.diff(smoothed)).max() < 0.15 * (sand[0] - grass[0])


def test_hills_and_things_throw_shadows() -> None:
    heights = np.zeros((81, 81))
    heights[:, 20] = 4.0  # a ridge in the west, where the sun is
    sun = Sun(azimuth_deg=270.0, elevation_deg=30.0)
    roof = box("roof", (4.0, 4.0, 0.1), (15.0, 0.0, 3.0))
    scenario = hilly(heights, roof, light=sun)
    made = views.renderer(scenario, PINHOLE)

    def level(x: float, y: float) -> float:
        color = made.draw(views.looking((x, y, 8.0), pitch_deg=90.0)).color
        return float(color[110:130, 150:170].mean())

    # 4 m / tan(30 deg): 6.9 m of shadow to the east of the ridge at x = -20; of the roof 5.2 m.
    lit = level(0.0, 10.0)
    assert level(-16.0, 10.0) < 0.65 * lit
    assert level(-11.0, 10.0) == pytest.approx(lit, rel=0.3)
    assert level(15.0 + 5.2, 0.0) < 0.65 * lit
    assert level(15.0 + 9.0, 0.0) == pytest.approx(lit, rel=0.3)


def test_a_vehicle_throws_a_shadow_wherever_it_is() -> None:
    """Also far from all that stands: the map around the eye goes with it."""
    scenario = hilly(np.zeros((200, 200)), cell_m=40.0, light=Sun(elevation_deg=70.0))
    made = views.renderer(scenario, PINHOLE, layers=ALL_LAYERS)
    around = views.world_replica(scenario)
    for x in (0.0, 3000.0):
        eye = views.looking((x, 1.5, 1.5), yaw_deg=-90.0, pitch_deg=45.0)
        made.place(views.parked(around, (x, 0.0, -300.0)))
        empty = made.draw(eye).color.copy()
        made.place(views.parked(around, (x, 0.0, 0.3)))
        frame = made.draw(eye)
        terrain = frame.labels == made.labels.instances.index("terrain")
        vehicle = frame.labels == made.labels.of_mover("rover")
        assert vehicle.sum() > 300
        darker = empty.astype(int).mean(axis=-1) - frame.color.mean(axis=-1) > 25
        assert (darker & terrain).sum() > 0.15 * vehicle.sum()


@pytest.mark.parametrize("away_m", [8.0, 60.0, 120.0])
def test_bare_terrain_is_lit_but_for_the_shadow_of_the_vehicle(away_m: float) -> None:
    """Where nothing stands, the sun's map is smaller than the car that starts at the origin."""
    bare = hilly(np.zeros((401, 401)), light=Sun(azimuth_deg=120.0, elevation_deg=25.0))
    _, shown = load_partial("car")
    materials = {**shown.world.materials, **bare.world.materials}
    scenario = replace(
        bare, world=replace(bare.world, materials=materials), vehicles=shown.vehicles
    )
    around = views.world_replica(scenario)
    in_base = [(0.0, 0.0, 0.0), *(wheel.center_m for wheel in scenario.vehicles[0].model.wheels)]
    assert len(in_base) == len(around.links)
    pose = views.looking((-away_m, 0.0, away_m / 2), pitch_deg=26.5)
    pictures = []
    for z_m in (0.4, 500.0):
        made = Renderer(scenario.world, around, PINHOLE)
        made.place(views.parked(around, (0.0, 0.0, z_m)) + np.pad(in_base, ((0, 0), (0, 4))))
        pictures.append(made.draw(pose).color.astype(int))
    rows, columns = np.nonzero(np.abs(pictures[0] - pictures[1]).max(axis=-1) > 2)
    # The car and its shadow are within 6 m of the origin, which is in the middle of the picture.
    reach_px = 6.0 * PINHOLE.fx / (away_m * np.hypot(1.0, 0.5) - min(6.0, away_m / 2))
    assert len(rows) > 5
    assert np.hypot(rows - PINHOLE.cy, columns - PINHOLE.cx).max() < reach_px


@pytest.mark.parametrize("yaw_deg", [0.0, 180.0])
def test_a_hill_hides_the_one_right_behind_it(yaw_deg: float) -> None:
    """Also where the depth buffer cannot tell them apart."""
    heights = np.zeros((41, 1501))
    for column in (1350, 1352, 1354, 1356):  # 6 km to the east, 20 m apart, and so in the west
        heights[:, [column, 1500 - column]] = 40.0
    scenario = hilly(heights, cell_m=10.0)
    pose = views.looking((0.0, 0.0, 20.0), yaw_deg=yaw_deg)
    frame = views.renderer(scenario, Pinhole(200, 100, 4000.0, 4000.0, 99.5, 49.5)).draw(pose)
    hill = np.isfinite(frame.depth_m) & (frame.depth_m > 5900.0)
    assert hill.sum() > 1000
    assert frame.depth_m[hill].max() < 6005.0


def test_patterns_stay_where_they_are() -> None:
    made = views.renderer(hilly(np.zeros((41, 41))), PINHOLE)
    # From 8 m straight down 1 m is 25 pixels; the top of the picture is east.
    here, there = (
        made.draw(views.looking((x, 0.0, 8.0), pitch_deg=90.0)).color.astype(float)
        for x in (0.3, 2.3)
    )
    moved = np.abs(here[:-50] - there[50:]).mean()
    assert moved < 0.4 * np.abs(here[:-50] - there[:-50]).mean()


def test_lamps_light_terrain_too() -> None:
    made = views.renderer(hilly(np.zeros((9, 9)), light=Lamps(at_m=((0.0, 0.0, 2.5),))), PINHOLE)
    color = made.draw(views.looking((-3.0, 0.0, 2.0), pitch_deg=35.0)).color
    assert color[118:122, 150:170].mean() > 1.1 * color[-5:, :20].mean()


def test_the_same_bits_whatever_was_drawn_before() -> None:
    scenario = hilly(waves(200, 200, high=9.0, long=60.0), box("b", (2, 2, 9), (20, 5, 0)))
    first, second = (views.renderer(scenario, PINHOLE, layers=ALL_LAYERS) for _ in range(2))
    here = above(scenario, 0.0, 0.0, 1.0)
    second.draw(above(scenario, 60.0, -40.0, 20.0, yaw_deg=70.0))
    one, other = first.draw(here), second.draw(here)
    assert np.array_equal(one.color, other.color)
    assert np.array_equal(one.depth_m, other.depth_m)


def test_a_map_that_opengl_cannot_hold_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = hilly(np.zeros((3, 20000)))
    with pytest.raises(UserError, match="terrain of 20000 x 3 heights: OpenGL allows"):
        views.renderer(scenario, PINHOLE)


def test_the_sun_shines_as_on_the_triangles() -> None:
    slope = np.broadcast_to(np.arange(20.0), (20, 20))  # 45 degrees, facing west
    towards = np.array([-np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    assert (ground_paint.sunlit(grounds.ground(slope), towards) >= 254).all()
    assert (ground_paint.sunlit(grounds.ground(slope), towards * (-1, 1, 1)) == 0).all()
    assert ground_levels.HALF_PIXEL <= 0.5
