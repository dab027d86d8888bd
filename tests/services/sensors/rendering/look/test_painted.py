# SPDX-License-Identifier: Apache-2.0
"""Meshes with pictures of their own, as rays meet them, in the world and on vehicles."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.scenario.schema import Placement, Scenario
from groundlink.world import assets
from groundlink.world.mesh_asset import MeshPart, encode_mesh
from groundlink.world.solids import Box, Material, Mesh, Solid
from groundlink.world.triangles import merged
from groundlink.world.weather import Sun
from services.sensors.rendering.gl.target import ALL_LAYERS
from services.sensors.rendering.look.mesh import Skin
from services.sensors.rendering.look.painted import painted
from tests.services.sensors.rendering import views
from tests.services.sensors.yards import box, yard

AHEAD = views.looking((0.0, 0.0, 1.0))
GRAY = Material(color=(0.3, 0.3, 0.3))
WALL = np.array([(0, 1, -1), (0, -1, -1), (0, -1, 1), (0, 1, 1)], np.float32)
"""A square of 2 m that faces west: seen from there, from its lower left corner around."""

WALL_FACES = np.array([(0, 1, 2), (0, 2, 3)], np.uint32)
WALL_UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
EARTH = box("ground", (40.0, 40.0, 1.0), (0.0, 0.0, -1.5), "black")


def png(pixels: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", pixels[..., ::-1])[1].tobytes()


def flag() -> bytes:
    """Red on the upper left, blue on the lower right, else black."""
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32, :32], picture[32:, 32:] = (250, 40, 40), (40, 40, 250)
    return png(picture)


def mesh(vertices: NDArray[np.float32], *rest: object, **more: object) -> Mesh:
    asset = assets.put(encode_mesh(vertices, *rest, **more))  # type: ignore[arg-type]
    low, high = (tuple(f(axis=0).tolist()) for f in (vertices.min, vertices.max))
    return Mesh(asset=asset, low_m=low, high_m=high)


def wall(**part: object) -> Mesh:
    return mesh(WALL, WALL_FACES, WALL_UV, (MeshPart(first=0, count=2, **part),))  # type: ignore[arg-type]


def scenario(*solids: Solid, light: Sun | None = None) -> Scenario:
    made = yard(*solids)
    materials = {**made.world.materials, "gray": GRAY, "black": Material(color=(0.2, 0.2, 0.2))}
    world = replace(made.world, solids=solids, light=light, materials=materials)
    high = replace(made.vehicles[0], placement=Placement(z_m=100.0))
    return replace(made, world=world, vehicles=(high,))


def ahead(shape: Mesh, **turn: object) -> Solid:
    return Solid("wall", shape, "gray", position_m=(3.0, 0.0, 1.0), **turn)  # type: ignore[arg-type]


def test_a_mesh_shows_its_picture_the_right_way_up() -> None:
    made = views.renderer(scenario(EARTH, ahead(wall(picture=flag()))), layers=ALL_LAYERS)
    frame = made.draw(AHEAD)
    red, dark, blue = (frame.color[at].astype(int) for at in ((40, 60), (40, 100), (80, 100)))
    assert red[0] > 2 * red[2]
    assert blue[2] > 2 * blue[0]
    assert dark.max() < 20
    assert frame.labels is not None
    assert made.labels.instances[frame.labels[40, 60]] == "wall"
    assert frame.depth_m[40, 60] == pytest.approx(3.0, abs=1e-4)


def test_a_color_multiplies_the_picture_and_else_replaces_the_materials() -> None:
    white = png(np.full((4, 4, 3), 255, np.uint8))
    green = (0.05, 0.5, 0.05)
    levels = []
    for part in ({"picture": white, "color": green}, {"color": green}, {}):
        made = views.renderer(scenario(EARTH, ahead(wall(**part))))
        levels.append(made.draw(AHEAD).color[40:80, 60:100].mean(axis=(0, 1)))
    with_picture, alone, neither = levels
    assert with_picture == pytest.approx(alone, abs=6)
    assert alone[1] > 2 * alone[0]
    assert neither[0] == pytest.approx(neither[1], abs=12)


def test_an_open_mesh_is_seen_from_behind_as_rays_meet_it() -> None:
    turned = ahead(wall(picture=flag()), orientation=(0.0, 0.0, 1.0, 0.0))
    frame = views.renderer(scenario(EARTH, turned)).draw(AHEAD)
    assert frame.depth_m[40, 100] == pytest.approx(3.0, abs=1e-4)
    color = frame.color[40, 100].astype(int)  # mirrored: the flag's upper left
    assert color[0] > 2 * color[2]


@pytest.mark.parametrize("across_m", [40.0, 200.0], ids=["one map", "one more around the eye"])
def test_an_open_mesh_throws_its_shadow_but_none_on_itself(across_m: float) -> None:
    """The sun is behind the eye; the wall hovers a meter above the ground."""
    plain, sun = mesh(WALL, WALL_FACES), Sun(azimuth_deg=250.0, elevation_deg=35.0)
    earth = box("ground", (across_m, across_m, 1.0), (0.0, 0.0, -1.5))
    at = {"position_m": (3.0, 0.0, 1.0)}
    made = views.renderer(scenario(earth, Solid("wall", plain, "gray", **at), light=sun))  # type: ignore[arg-type]
    lit = made.draw(AHEAD).color[25:95, 45:115].astype(int)
    assert lit.std() < 8, "a coarse map's steps would be stripes"
    above = made.draw(views.looking((3.0, 0.0, 6.0), pitch_deg=90.0))
    ground = above.color[above.depth_m > 6.5].astype(int).sum(axis=1)
    assert ground.min() < 0.6 * np.median(ground)


def test_normals_of_a_picture_tilt_the_light() -> None:
    """The sun is in the south-west and low; the wall faces west, so its u runs south, v up."""
    level = {}
    for name, (u, v) in {
        "none": (0.0, 0.0),
        "flat": (0.0, 0.0),
        "to the sun": (0.6, 0.0),
        "away": (-0.6, 0.0),
        "up": (0.0, 0.6),
        "down": (0.0, -0.6),
    }.items():
        n = np.array([u, v, np.sqrt(1 - u * u - v * v)])
        normals = np.broadcast_to(np.rint((n + 1) / 2 * 255), (8, 8, 3)).astype(np.uint8)
        part = {} if name == "none" else {"normals": png(normals)}
        white = png(np.full((4, 4, 3), 150, np.uint8))
        made = views.renderer(
            scenario(
                EARTH,
                ahead(wall(picture=white, **part)),
                light=Sun(azimuth_deg=225.0, elevation_deg=30.0),
            )
        )
        level[name] = float(made.draw(AHEAD).color[50:70, 70:90].mean())
    assert level["flat"] == pytest.approx(level["none"], abs=1.5)
    assert level["to the sun"] > level["flat"] + 5 > level["away"] + 10
    assert level["up"] > level["flat"] > level["down"] + 5


def test_normals_are_smooth_on_round_things_and_not_across_edges() -> None:
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rims = [np.stack([np.cos(turn), np.sin(turn), np.full(24, z)], -1) for z in (-1.0, 1.0)]
    vertices = np.concatenate([*rims, [(0, 0, -1), (0, 0, 1)]]).astype(np.float32)
    i, j = np.arange(24), np.roll(np.arange(24), -1)
    faces = np.concatenate(
        [
            np.stack([i, j, j + 24], -1),
            np.stack([i, j + 24, i + 24], -1),
            np.stack([j, i, np.full(24, 48)], -1),
            np.stack([i + 24, j + 24, np.full(24, 49)], -1),
        ]
    ).astype(np.uint32)
    solid = Solid("can", mesh(vertices, faces), "gray")
    (made,) = painted(solid, 3, GRAY, {})  # closed: from outside alone
    at, normal = (made.vertices[name].astype(float) for name in ("position", "normal"))
    cap = np.abs(normal[:, 2]) > 0.5
    assert np.abs(normal[cap]) == pytest.approx(np.array([[0, 0, 1]] * cap.sum()), abs=1e-6)
    assert normal[~cap] == pytest.approx(at[~cap] * (1, 1, 0), abs=1e-6)
    assert (made.vertices["label"] == 3).all()
    assert len(made.vertices) < len(faces) * 3 / 2, "vertices are shared"
    drawn = made.vertices["position"][made.faces]
    assert np.array_equal(drawn, vertices[faces])


def test_a_mesh_is_where_rays_meet_it() -> None:
    solid = replace(
        ahead(wall(picture=flag())), position_m=(1.0, 2.0, 3.0), orientation=(0.5, 0.5, 0.5, 0.5)
    )
    front, back = painted(solid, 0, GRAY, {})
    expected = merged([solid])
    assert np.array_equal(
        front.vertices["position"][front.faces], expected.vertices[expected.faces]
    )
    assert np.array_equal(front.vertices["normal"], -back.vertices["normal"])


def test_a_link_may_be_a_mesh() -> None:
    made = scenario(EARTH)
    vehicle = made.vehicles[0]
    visual = Solid("body", wall(picture=flag()), "gray")
    model = replace(vehicle.model, visuals=(visual,))
    made = replace(made, vehicles=(replace(vehicle, model=model),))
    renderer = views.renderer(made, layers=ALL_LAYERS)
    poses = views.parked(views.world_replica(made), (0.0, 0.0, -400.0))
    poses[0, :3] = (3.0, 0.0, 1.0)
    renderer.place(poses)
    frame = renderer.draw(AHEAD)
    assert frame.labels is not None
    assert frame.labels[40, 60] == renderer.labels.of_mover(vehicle.name)
    red = frame.color[40, 60].astype(int)
    assert red[0] > 2 * red[2]


def test_meshes_share_their_pictures() -> None:
    skins: dict[str, Skin] = {}
    shape = wall(picture=flag())
    pieces = [
        piece
        for name in ("a", "b")
        for piece in painted(Solid(name, shape, "gray"), 0, GRAY, skins)
    ]
    assert len({id(piece.skin) for piece in pieces}) == len(skins) == 1


def test_a_picture_that_is_none_is_one_line() -> None:
    solid = ahead(wall(picture=b"no picture"))
    with pytest.raises(UserError, match="is not PNG or JPEG"):
        list(painted(solid, 0, GRAY, {}))


def test_boxes_stay_boxes() -> None:
    """A shape that is no mesh is not for this module."""
    with pytest.raises(AssertionError):
        list(painted(Solid("box", Box(size_m=(1, 1, 1)), "gray"), 0, GRAY, {}))
