# SPDX-License-Identifier: Apache-2.0
"""What pictures show: where things are, their light and shadows, and always the same bits."""

import hashlib
import os
import subprocess
import sys
from typing import Any

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.scenario.schema import Placement, Scenario
from groundlink.world.solids import Material
from groundlink.world.weather import Lamps, Sun, Weather
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import ALL_LAYERS, Frame
from services.sensors.rendering.look.mesh import VERTEX, Skin, SkinnedMesh
from tests.services.sensors.rendering import views
from tests.services.sensors.yards import box, yard

AHEAD = views.looking((0.0, 0.0, 1.0))
FLOOR = box("ground", (40.0, 40.0, 1.0), (0.0, 0.0, -0.5), "black")


def lit(*solids: Any, light: Sun | Lamps | None = None, **fields: Any) -> Scenario:
    """Return a world of solids under a light, without the yard's far box."""
    made = yard(*solids)
    materials = {
        **made.world.materials,
        "gray": Material(color=(0.3, 0.3, 0.3), texture="plain"),
        "black": Material(color=(0.2, 0.2, 0.2)),
    }
    world = replace(made.world, materials=materials, solids=solids, light=light, **fields)
    high = replace(made.vehicles[0], placement=Placement(z_m=100.0))
    return replace(made, world=world, vehicles=(high,))


def brightness(color: NDArray[np.uint8], row: int, column: int) -> float:
    """Return the mean of 5 x 5 pixels."""
    return float(color[row - 2 : row + 3, column - 2 : column + 3].mean())


@pytest.mark.parametrize(
    "pinhole",
    [Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5), Pinhole(321, 200, 300.0, 220.0, 120.3, 130.8)],
)
def test_objects_are_projected_by_the_matrix(pinhole: Pinhole) -> None:
    """Pixel centers are whole numbers, the first row is the top one."""
    generator = np.random.default_rng(7)
    grid = np.array([(y, z) for y in np.arange(-1.2, 1.3, 0.3) for z in np.arange(0.4, 1.7, 0.3)])
    places = np.column_stack(
        [np.full(len(grid), 4.0), grid + generator.uniform(-0.05, 0.05, grid.shape)]
    )
    squares = [box(f"square{i}", (0.001, 0.17, 0.19), at) for i, at in enumerate(places)]
    made = views.renderer(lit(FLOOR, *squares), pinhole, layers=ALL_LAYERS)
    labels = made.draw(AHEAD).labels
    assert labels is not None
    errors = []
    for i, (x, y, z) in enumerate(places - (0.0005, 0, 0)):
        rows, columns = np.nonzero(labels == made.labels.instances.index(f"square{i}"))
        # Optical x is the world's -y, optical y its -z.
        u, v = pinhole.fx * -y / x + pinhole.cx, pinhole.fy * (1.0 - z) / x + pinhole.cy
        if u > pinhole.width - 12 or u < 12 or v > pinhole.height - 12 or v < 12:
            continue  # cut off at the rim
        errors.append((columns.mean() - u, rows.mean() - v))
    # A square's middle is known to half a pixel, and that of many squares much better.
    assert len(errors) > 25
    assert np.abs(errors).max() <= 0.5
    assert np.abs(np.mean(errors, axis=0)).max() < 0.12


def test_the_sky_is_infinitely_far_and_no_thing() -> None:
    made = views.renderer(lit(FLOOR), layers=ALL_LAYERS)
    frame = made.draw(AHEAD)
    assert np.isinf(frame.depth_m[:50]).all()
    assert frame.labels is not None
    assert (frame.labels[:50] == -1).all()
    assert np.isfinite(frame.depth_m[-1]).all()
    # Blue above, the sun where it is: south-east by 150 degrees clockwise from north, 40 up.
    assert frame.color[0, 80, 2] > frame.color[0, 80, 0] + 20
    sun = made.draw(views.looking((0, 0, 1), yaw_deg=-60.0, pitch_deg=-40.0)).color
    assert sun[57:63, 77:83].max() > 250
    assert brightness(sun, 60, 80) > brightness(sun, 20, 20) + 20


def test_a_shadow_falls_away_from_the_sun() -> None:
    # A plate 1 m above the floor, the sun at 45 degrees in the west: the shadow is 1 m to the east.
    plate = box("plate", (0.4, 0.4, 0.02), (5.0, 0.0, 1.0), "gray")
    made = views.renderer(lit(FLOOR, plate, light=Sun(azimuth_deg=270.0, elevation_deg=45.0)))
    color = made.draw(views.looking((6.0, 0.0, 3.0), pitch_deg=90.0)).color
    # Straight down from 3 m, the top of the picture is ahead, east: 40 pixels a meter.
    shadow, beside = brightness(color, 60, 80), brightness(color, 60, 120)
    assert shadow < 0.75 * beside
    assert brightness(color, 60 - 20, 80) == pytest.approx(beside, rel=0.1)


def test_a_vehicle_takes_its_shadow_along_and_the_same_bits_come_back() -> None:
    scenario = views.laboratory()
    around = views.world_replica(scenario)
    above = views.looking((-2.0, 0.0, 2.8), pitch_deg=90.0)
    here, there = (views.parked(around, (x, 0.0, 0.17)) for x in (-2.0, -1.0))

    def seen(made: Renderer, *places: Any) -> str:
        for place in places:
            made.place(place)
        return hashlib.sha256(made.draw(above).color.tobytes()).hexdigest()

    made = Renderer(scenario.world, around, views.SMALL)
    first = seen(made, here)
    assert made.mended == 0
    assert seen(made, here) == first
    assert made.mended == 0, "nothing has moved"
    assert seen(made, there) != first
    assert made.mended == 1, "one vehicle, one lamp"
    assert seen(made, here) == first
    fresh = Renderer(scenario.world, around, views.SMALL)
    assert seen(fresh, here) == first
    assert seen(fresh, there) == seen(made, there)


def test_views_are_drawn_again_only_after_a_change() -> None:
    scenario = views.laboratory()
    around = views.world_replica(scenario)
    left, right = (views.looking((-4.0, y, 0.5)) for y in (0.1, 0.0))
    here, there = (views.parked(around, (x, 0.0, 0.17)) for x in (-2.0, -1.0))
    made = Renderer(scenario.world, around, views.SMALL, layers=ALL_LAYERS)

    def pair() -> list[Frame]:
        return [made.draw(view) for view in (left, right)]

    made.place(here)
    first = pair()
    rover = [made.labels.of_mover("rover")]
    share = made.visible_shares(rover)
    made.place(here.copy())
    assert [now is before for now, before in zip(pair(), first, strict=True)] == [True, True]
    assert made.draw(left) is first[0]
    assert made.visible_shares(rover) != share, "those of the view that was asked for last"
    with pytest.raises(ValueError, match="read-only"):
        first[0].color[0] = 0

    made.place(there)
    assert not np.array_equal(made.draw(left).color, first[0].color)
    made.place(here)
    assert all(
        np.array_equal(now.color, before.color) for now, before in zip(pair(), first, strict=True)
    )
    made.exposure = 0.5
    assert made.draw(left).color.mean() < first[0].color.mean() - 20
    made.exposure = 1.0
    made.add(quad(Skin(np.zeros((8, 8, 3), np.uint8))))
    assert not np.array_equal(made.draw(left).color, first[0].color)


def test_a_vehicle_stands_in_the_shade() -> None:
    """A plate between it and the lamp amid the ceiling takes its light."""
    scenario = views.laboratory()
    plate = box("plate", (1.6, 1.6, 0.02), (1.2, 0.0, 1.5), "metal")
    shaded = replace(scenario, world=replace(scenario.world, solids=(plate,)))
    brightnesses = []
    for one in (scenario, shaded):
        around = views.world_replica(one)
        made = Renderer(one.world, around, views.SMALL, layers=ALL_LAYERS)
        made.place(views.parked(around, (2.0, 0.0, 0.17)))
        frame = made.draw(views.looking((4.0, 0.0, 1.0), yaw_deg=180.0, pitch_deg=20.0))
        assert frame.labels is not None
        rover = frame.labels == made.labels.of_mover("rover")
        assert rover.sum() > 500
        brightnesses.append(float(frame.color[rover].mean()))
    assert brightnesses[1] < 0.9 * brightnesses[0]


def test_renderers_do_not_disturb_each_other() -> None:
    """One that draws may not be the newest: a vehicle can have several cameras in one process."""
    walls = [box("wall", (1.0, 9.0, 9.0), (x, 0.0, 1.0), "gray") for x in (3.5, 6.5)]
    near, far = (
        views.renderer(lit(FLOOR, wall), pinhole)
        for wall, pinhole in zip(
            walls, (views.SMALL, Pinhole(64, 48, 60.0, 60.0, 31.5, 23.5)), strict=True
        )
    )
    for _ in range(2):
        assert near.draw(AHEAD).depth_m[60, 80] == pytest.approx(3.0, abs=1e-4)
        assert far.draw(AHEAD).depth_m[24, 32] == pytest.approx(6.0, abs=1e-4)
    far.close()
    assert near.draw(AHEAD).depth_m[60, 80] == pytest.approx(3.0, abs=1e-4)


def test_lamps_light_surfaces_below() -> None:
    ceiling = box("ceiling", (10.0, 10.0, 0.2), (0.0, 0.0, 3.1))
    made = views.renderer(lit(FLOOR, ceiling, light=Lamps(at_m=((3.0, 0.0, 2.96),))))
    color = made.draw(views.looking((0.0, 0.0, 2.0), pitch_deg=45.0)).color
    assert brightness(color, 45, 80) > 1.15 * brightness(color, 110, 80)
    lamp = made.draw(views.looking((3.0, 0.0, 1.0), pitch_deg=-90.0)).color
    assert brightness(lamp, 60, 80) > 240 > brightness(lamp, 20, 20) + 50


def test_a_longer_exposure_is_brighter_and_does_not_move_anything() -> None:
    made = views.renderer(lit(FLOOR, box("wall", (1.0, 9.0, 9.0), (6.5, 0.0, 1.0), "gray")))
    frames = []
    for exposure in (0.5, 1.0, 2.0):
        made.exposure = exposure
        frame = made.draw(AHEAD)
        frames.append((float(frame.color.mean()), frame.depth_m.copy()))
    levels, depths = zip(*frames, strict=True)
    assert levels[0] + 20 < levels[1] < levels[2] - 20
    assert np.array_equal(depths[0], depths[2])


def test_fog_hides_far_objects() -> None:
    wall = box("wall", (1.0, 40.0, 40.0), (20.5, 0.0, 1.0), "gray")
    contrast = []
    for visibility_m in (None, 40.0):
        made = views.renderer(lit(FLOOR, wall, weather=Weather(fog_visibility_m=visibility_m)))
        contrast.append(float(made.draw(AHEAD).color[30, 80].mean()))
    clear, foggy = contrast
    # 0.05 ** (20 / 40) = 22 % of the wall is left; the rest is the bright horizon.
    assert foggy > clear + 30


def quad(skin: Skin, tint: float = 0.5) -> SkinnedMesh:
    """Return a square of 2 m that faces west, 3 m ahead; u goes right, v goes down."""
    vertices = np.zeros(4, VERTEX)
    vertices["position"] = [(3, 1, 2), (3, -1, 2), (3, -1, 0), (3, 1, 0)]
    vertices["normal"] = (-1, 0, 0)
    vertices["uv"] = [(0, 0), (1, 0), (1, 1), (0, 1)]
    vertices["tint"], vertices["label"] = tint, 0
    return SkinnedMesh(vertices, np.array([[0, 2, 1], [0, 3, 2]], np.uint32), skin)


def test_a_mesh_shows_its_texture() -> None:
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, :32] = (250, 40, 40)
    picture[32:, 32:] = (40, 40, 250)
    made = views.renderer(lit(FLOOR))
    made.add(quad(Skin(picture)))
    made.place(views.parked(views.world_replica(lit(FLOOR)), (0.0, 0.0, -400.0)))
    color = made.draw(AHEAD).color.astype(int)
    # 1 m is 40 pixels; the middle is at row 59.5, column 79.5.
    red, dark, blue = color[40, 60], color[40, 100], color[80, 100]
    assert red[0] > 2 * red[2]
    assert blue[2] > 2 * blue[0]
    assert dark.max() < 20


def test_a_normal_map_tilts_the_light() -> None:
    """The sun is in the west, behind the eye and to the left of it, low."""
    plain = np.full((8, 8), 160, np.uint8)
    sun = Sun(azimuth_deg=225.0, elevation_deg=10.0)  # shines towards north-east
    level = []
    for towards in ((0.0, 0.0), (0.6, 0.0), (-0.6, 0.0)):
        n = np.array([*towards, np.sqrt(1 - np.hypot(*towards) ** 2)])
        bumps = np.broadcast_to(np.rint((n + 1) / 2 * 255), (8, 8, 3)).astype(np.uint8)
        made = views.renderer(lit(FLOOR, light=sun))
        made.add(quad(Skin(plain, bumps.copy()), tint=0.3))
        made.place(views.parked(views.world_replica(lit(FLOOR)), (0.0, 0.0, -400.0)))
        level.append(brightness(made.draw(AHEAD).color, 60, 80))
    flat, to_the_right, to_the_left = level
    # Facing west, right is south, and that is where the sun is.
    assert to_the_right > flat + 5
    assert to_the_left < flat - 5


def test_a_visual_slam_finds_corners_everywhere() -> None:
    """With the two thresholds of ORB-SLAM's FAST detector, in every quarter of the picture."""
    made = views.renderer(views.laboratory(), Pinhole(640, 480, 415.0, 415.0, 319.5, 239.5))
    for yaw_deg in (0.0, 120.0, 240.0):
        color = made.draw(views.looking((-4.1, 0.0, 0.5), yaw_deg=yaw_deg)).color
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        for threshold, least in ((20, 3), (7, 50)):
            found = cv2.FastFeatureDetector_create(threshold).detect(gray)
            quarters = [(corner.pt[0] > 320, corner.pt[1] > 240) for corner in found]
            counts = [quarters.count((x, y)) for x in (False, True) for y in (False, True)]
            assert min(counts) > least, (yaw_deg, threshold, counts)


PRINT_HASH = """
import hashlib
from tests.services.sensors.rendering import views
made = views.renderer(views.laboratory(), layers=("color", "depth", "labels"))
frame = made.draw(views.looking((-4.0, 0.0, 0.5), yaw_deg=10.0))
parts = frame.color, frame.depth_m, frame.labels
print(hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
"""


def test_the_same_bits_in_every_process_with_any_number_of_threads() -> None:
    hashes = set()
    for threads in ("0", "1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", PRINT_HASH],
            env=os.environ | {"LP_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        hashes.add(done.stdout)
    assert len(hashes) == 1


def test_culling_removes_only_invisible_objects(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = views.renderer(views.laboratory())
    pose = views.looking((-4.0, 0.0, 0.5), yaw_deg=10.0)
    culled = made.draw(pose).color.copy()
    counts = []
    from services.sensors.rendering.gl import renderer

    def everything(boxes: Any, clip_from_world: Any) -> NDArray[np.bool_]:
        counts.append(len(boxes.middles))
        return np.ones(len(boxes.middles), bool)

    monkeypatch.setattr(renderer, "seen", everything)
    assert np.array_equal(views.renderer(views.laboratory()).draw(pose).color, culled)
    assert counts[0] > 20
