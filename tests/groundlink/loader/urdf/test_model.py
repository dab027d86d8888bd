# SPDX-License-Identifier: Apache-2.0
"""A URDF becomes a vehicle like any other."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import astuple
from scipy.spatial.transform import Rotation

from groundlink.core.frames import matrix_from_quaternion
from groundlink.loader import load
from groundlink.scenario.joints import base_from_links
from groundlink.world.mesh_asset import load_mesh
from groundlink.world.solids import Cylinder, Mesh
from tests.groundlink.importing.files import COLORS, png, write
from tests.groundlink.loader.urdf.carts import CART, MODEL, TURRET, scenario, vehicle

CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)], np.float32)
TETRAHEDRON = np.array([[0, 2, 4], [0, 1, 2], [0, 4, 1], [1, 4, 2]])
"""Of the corners, with its faces outwards."""


@pytest.fixture(autouse=True)
def _store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GROUNDLINK_ASSETS", str(tmp_path / "assets"))


def stl(scale: float = 1.0) -> bytes:
    """Return a binary STL of a tetrahedron of 1 x 2 x 3."""
    faces = b"".join(
        struct.pack("<12fH", *[0.0] * 3, *(scale * CORNERS[face]).ravel().tolist(), 0)
        for face in TETRAHEDRON
    )
    return bytes(80) + struct.pack("<I", len(TETRAHEDRON)) + faces


def test_its_base_is_all_that_does_not_turn(tmp_path: Path) -> None:
    cart = vehicle(tmp_path).model
    assert cart.base_frame == "base_link"
    # 10 kg and 2 kg, without what the caster lacks of 8 % of a third of 14 kg.
    assert cart.chassis.mass_kg == pytest.approx(12 - 0.08 * 14 / 3)
    assert cart.chassis.center_m == pytest.approx((0.2 * 2 / 12, 0, (0.05 * 10 + 0.2 * 2) / 12))
    ixx, iyy, izz = cart.chassis.inertia_kgm2 or (0, 0, 0)
    apart = 10 * 2 / 12  # the reduced mass of the two, by Steiner
    assert ixx == pytest.approx(0.2 + 0.01 + apart * 0.15**2)
    assert iyy == pytest.approx(0.3 + 0.01 + apart * (0.15**2 + 0.2**2))
    assert izz == pytest.approx(0.4 + 0.001 + apart * 0.2**2)
    assert [part.position_m for part in cart.collisions] == [(0, 0, 0.05)]
    assert not cart.chassis.collides


def test_its_wheels_lie_along_y_whatever_their_links_do(tmp_path: Path) -> None:
    left, right, caster = vehicle(tmp_path).model.wheels
    assert left.name == "left_wheel_joint"
    assert left.center_m == pytest.approx((0, 0.2, 0))
    assert (left.radius_m, left.width_m) == pytest.approx((0.1, 0.04))
    assert left.inertia_kgm2 == pytest.approx(0.005)
    assert (left.friction, right.friction, caster.friction) == (0.9, 0.8, 0.02)
    assert left.visuals[0].shape == Cylinder(radius_m=0.1, length_m=0.04)
    assert left.visuals[0].orientation == pytest.approx((-(0.5**0.5), 0, 0, 0.5**0.5))
    assert not right.visuals
    assert caster.caster
    assert caster.center_m == pytest.approx((0.2, 0, -0.05))
    assert caster.mass_kg == pytest.approx(0.08 * 14 / 3)


def test_blocks_for_other_programs_change_nothing(tmp_path: Path) -> None:
    block = """  <ros2_control name="cart_system" type="system">
    <hardware><plugin>topic_based_ros2_control/TopicBasedSystem</plugin></hardware>
    <joint name="left_wheel"><command_interface name="velocity"/></joint>
    <joint name="no_such_joint"><command_interface name="effort"/></joint>
  </ros2_control>
</robot>"""
    plain, controlled = tmp_path / "plain", tmp_path / "controlled"
    plain.mkdir()
    controlled.mkdir()
    with_block = vehicle(controlled, CART.replace("</robot>", block))
    assert with_block.model == vehicle(plain).model


def test_its_links_are_mounts(tmp_path: Path) -> None:
    mount = vehicle(tmp_path).sensors[0].mount
    assert mount.xyz_m == pytest.approx((0.2, 0, 0.3))
    assert mount.rpy_deg == pytest.approx((0, np.degrees(0.1), 0))


def test_its_colors_are_materials_of_the_world(tmp_path: Path) -> None:
    loaded = load(scenario(tmp_path))
    orange = loaded.world.materials[loaded.vehicles[0].model.visuals[0].material]
    assert orange.color == pytest.approx((1, 0.216, 0), abs=1e-3)


def test_a_color_may_be_defined_where_it_is_used_first(tmp_path: Path) -> None:
    color = '<material name="orange"><color rgba="1 0.5 0 1"/></material>'
    again = CART.replace(f"  {color}\n", "").replace(
        '<material name="black"><color rgba="0.1 0.1 0.1 1"/></material>', color
    )
    model = vehicle(tmp_path, again).model
    assert model.visuals[0].material == model.wheels[0].material == "urdf_ff8000"


def test_vehicle_fields_override_the_urdf(tmp_path: Path) -> None:
    model = MODEL + (
        "name: mine\n"
        "chassis: {friction: 0.1}\n"
        "mounts: {front: {xyz_m: [1, 0, 0]}}\n"
        "suspension: {travel_m: 0.01, stiffness_npm: 900, damping_nspm: 20}\n"
    )
    mine = vehicle(tmp_path, model=model).model
    theirs = vehicle(tmp_path).model
    assert mine.name == "mine"
    assert mine.chassis.friction == 0.1
    assert mine.chassis.mass_kg == theirs.chassis.mass_kg
    assert set(mine.mounts) == {*theirs.mounts, "front"}
    assert astuple(mine.suspension) == (0.01, 900, 20)


def test_urdf_may_be_inline_in_the_scenario(tmp_path: Path) -> None:
    file = scenario(tmp_path)
    inline = "\n".join(f"      {line}" for line in MODEL.splitlines())
    text = file.read_text(encoding="utf-8").replace("model: cart.yaml", f"model:\n{inline}")
    file.write_text(text, encoding="utf-8")
    (tmp_path / "cart.yaml").unlink()
    assert load(file).vehicles[0].model.name == "cart"


MESH = '<mesh filename="{}" scale="{}"/>'
BOX = '<box size="0.5 0.3 0.1"/>'


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("part.stl", "part.stl"),
        ("meshes/part.stl", "meshes/part.stl"),
        ("package://cart_description/meshes/part.stl", "meshes/part.stl"),
        ("package://cart_meshes/part.stl", "../cart_meshes/part.stl"),
    ],
)
def test_its_meshes_are_found(tmp_path: Path, name: str, where: str) -> None:
    folder = tmp_path / "cart_description"
    file = folder / where
    file.parent.mkdir(parents=True)
    folder.mkdir(exist_ok=True)
    file.write_bytes(stl())
    shape = vehicle(folder, CART.replace(BOX, MESH.format(name, "1 1 1"), 1)).model.visuals[0].shape
    assert isinstance(shape, Mesh)
    assert (shape.low_m, shape.high_m) == ((0, 0, 0), (1, 2, 3))


@pytest.mark.parametrize(
    ("place", "found"), [("materials/textures", True), ("../cart_meshes", False)]
)
def test_a_mesh_has_its_picture_from_anywhere_in_its_package(
    tmp_path: Path, place: str, found: bool
) -> None:
    package = tmp_path / "cart_description"
    (package / "meshes").mkdir(parents=True)
    (package / place).mkdir(parents=True)
    write(package / place, "p.png", png(COLORS))
    write(package / "meshes", "m.mtl", f"newmtl a\nmap_Kd ../{place}/p.png\n".encode())
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\n"
    write(package / "meshes", "part.obj", f"{text}f 1/1 2/2 3/3\n".encode())
    mesh = MESH.format("package://cart_description/meshes/part.obj", "1 1 1")
    told: list[str] = []
    model = load(scenario(package, CART.replace(BOX, mesh, 1)), warn=told.append).vehicles[0].model
    shape = model.visuals[0].shape
    assert isinstance(shape, Mesh)
    assert load_mesh(shape.asset).parts[0].picture == (png(COLORS) if found else None)
    assert any("lies outside its folder" in line for line in told) is not found


def test_its_meshes_are_found_where_ros_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share = tmp_path / "ros" / "share" / "arm"
    share.mkdir(parents=True)
    (share / "part.stl").write_bytes(stl())
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'ros'}")
    (tmp_path / "home").mkdir()
    mesh = MESH.format("package://arm/part.stl", "1 1 1")
    assert vehicle(tmp_path / "home", CART.replace(BOX, mesh, 1))


def test_a_mirrored_mesh_keeps_its_faces_outwards(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(stl(1000))
    for scale in ("0.001 0.001 0.001", "0.001 -0.001 0.002"):
        mesh = MESH.format("part.stl", scale)
        shape = vehicle(tmp_path, CART.replace(BOX, mesh, 1)).model.visuals[0].shape
        assert isinstance(shape, Mesh)
        made = load_mesh(shape.asset)
        a, b, c = np.moveaxis(made.vertices[made.faces].astype(float), 1, 0)
        volume = np.sum(a * np.cross(b, c)) / 6
        assert volume == pytest.approx(1 if "-" not in scale else 2, rel=1e-3)


def test_a_wheel_may_be_a_mesh(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_bytes(stl(0.01))
    cylinder = '<cylinder radius="0.1" length="0.04"/>'
    wheel = vehicle(
        tmp_path, CART.replace(cylinder, MESH.format("part.stl", "1 1 1"))
    ).model.wheels[0]
    # Its link's z is the axle: the mesh reaches 20 mm from it, and from 0 to 30 mm along it.
    assert wheel.radius_m == pytest.approx(0.02)
    assert wheel.width_m == pytest.approx(0.03)
    assert wheel.center_m == pytest.approx((0, 0.215, 0))


def test_missing_texture_of_a_mesh_gives_one_line(tmp_path: Path) -> None:
    corners = "".join(f"v {x} {y} {z}\nvt {y} {z}\n" for x, y, z in CORNERS)
    faces = "".join("f " + " ".join(f"{i + 1}/{i + 1}" for i in f) + "\n" for f in TETRAHEDRON)
    (tmp_path / "hull.obj").write_text(f"mtllib hull.mtl\n{corners}usemtl a\n{faces}")
    (tmp_path / "hull.mtl").write_text("newmtl a\nmap_Kd gone.png\n")
    told: list[str] = []
    urdf = CART.replace(BOX, '<mesh filename="hull.obj"/>')
    load(scenario(tmp_path, urdf), warn=told.append)
    assert len(told) == 1
    assert "gone.png" in told[0]


def test_its_joints_move_with_their_limits_and_speeds(tmp_path: Path) -> None:
    model = vehicle(tmp_path, TURRET).model
    found = [(j.name, j.kind, j.parent, j.lower, j.upper, j.max_speed) for j in model.joints]
    assert found == [
        ("pan", "revolute", None, -1.0, 1.0, 1.0),
        ("turret", "revolute", None, None, None, 0.5),
        ("gun", "revolute", "turret", -0.1, 0.4, 0.2),
        ("ram", "prismatic", "gun", 0.0, 0.3, 0.1),
    ]
    assert {wheel.name for wheel in model.wheels} == {
        *("left_wheel_joint", "right_wheel_joint", "caster_joint")
    }


def test_moving_links_match_the_urdf(tmp_path: Path) -> None:
    """Forward kinematics by the file's own numbers, whose frames are turned."""
    model = vehicle(tmp_path, TURRET).model
    pan, turn, lift, slide = 0.0, 0.7, 0.3, 0.2
    poses = base_from_links(model.joints, (pan, turn, lift, slide))

    def pose(xyz: tuple[float, ...], *turns: Rotation) -> np.ndarray:
        made = np.eye(4)
        made[:3, 3] = xyz
        for each in turns:
            made[:3, :3] = made[:3, :3] @ each.as_matrix()
        return made

    about = Rotation.from_rotvec
    turret = pose((0, 0, 0.1), Rotation.from_euler("xyz", (0, 0, 0.5)), about((0, 0, turn)))
    gun = turret @ pose((0.2, 0, 0.1), about((-np.pi / 2, 0, 0)), about((0, 0, -lift)))
    ram = gun @ pose((0.3, 0, 0)) @ pose((slide, 0, 0))
    for (place, _), expected in zip(poses[1:], (turret, gun, ram), strict=True):
        np.testing.assert_allclose(place, expected[:3, 3], atol=1e-9)
    # The barrel's visual in the base frame: with the link's frame turned as the base's at zero.
    (barrel,) = model.joints[2].visuals
    place, turned = poses[2]
    at = np.add(place, matrix_from_quaternion(np.array(turned)) @ barrel.position_m)
    np.testing.assert_allclose(at, (gun @ (0.25, 0, 0, 1))[:3], atol=1e-9)
    assert not {part.name for part in model.visuals} & {barrel.name}


def test_mass_and_collisions_of_moving_links_belong_to_the_base(tmp_path: Path) -> None:
    moving = vehicle(tmp_path, TURRET).model
    fixed = vehicle(
        tmp_path,
        re.sub('type="(revolute|prismatic)"', 'type="fixed"', TURRET).replace(
            '"turret" type="continuous"', '"turret" type="fixed"'
        ),
    ).model
    assert fixed.joints == ()
    assert moving.chassis == fixed.chassis
    assert moving.collisions == fixed.collisions
    assert moving.mounts == fixed.mounts
    assert len(moving.visuals) + 2 == len(fixed.visuals)


HELD = {
    "no speed": ('velocity="0.2"', 'velocity="0"'),
    "limits without zero": ('lower="-0.1"', 'lower="0.1"'),
    "equal limits": ('lower="-0.1" upper="0.4"', 'lower="0" upper="0"'),
    "no limit": ('<limit lower="-0.1" upper="0.4" effort="9" velocity="0.2"/>', ""),
    "another's shadow": ("<!-- gun -->", '<mimic joint="pan"/>'),
}


@pytest.mark.parametrize(("old", "new"), HELD.values(), ids=HELD)
def test_joints_that_no_servo_can_move_are_held(tmp_path: Path, old: str, new: str) -> None:
    assert old in TURRET
    model = vehicle(tmp_path, TURRET.replace(old, new)).model
    assert [(j.name, j.parent) for j in model.joints] == [
        *(("pan", None), ("turret", None), ("ram", "turret"))
    ]
    # What hung on the gun hangs on the turret now, turned as the file says.
    assert len(model.joints[1].visuals) == 2


def test_joints_that_carry_wheels_are_held(tmp_path: Path) -> None:
    steered = CART.replace(
        """    <parent link="base_link"/>
    <child link="left_wheel"/>""",
        """    <parent link="mast"/>
    <child link="left_wheel"/>""",
    )
    assert steered != CART
    assert vehicle(tmp_path, steered).model.joints == ()
