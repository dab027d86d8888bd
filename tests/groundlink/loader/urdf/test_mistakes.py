# SPDX-License-Identifier: Apache-2.0
"""Every mistake in a URDF is one line that names file, line, element and mend."""

import re
from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.loader import ScenarioError, load
from tests.groundlink.loader.urdf.carts import CART, JOINTS, LINKS, MODEL, scenario, vehicle
from tests.groundlink.loader.urdf.test_model import stl

LEFT_INERTIAL = re.search(r"    <inertial><mass.*\n", CART)
assert LEFT_INERTIAL
BOX = '<box size="0.5 0.3 0.1"/>'
LOOSE = '  <link name="arm"/>\n'
BACK = """\
  <joint name="back" type="fixed">
    <parent link="camera"/>
    <child link="{}"/>
  </joint>
"""
RING = """\
  <link name="a"/>
  <link name="b"/>
  <joint name="there" type="fixed"><parent link="a"/><child link="b"/></joint>
  <joint name="back" type="fixed"><parent link="b"/><child link="a"/></joint>
"""

MISTAKES = {
    "empty": (CART, "", ["cart.urdf:1: not valid XML: no element found"]),
    "no XML": (CART, "hello", ["cart.urdf:1: not valid XML: syntax error"]),
    "cut off": (JOINTS, "<joint", ["cart.urdf:", "not valid XML"]),
    "no robot": (CART, "<sdf/>", ["cart.urdf:1: <sdf>: expected <robot name=...>"]),
    "no name": ('<robot name="cart">', "<robot>", [":2: <robot>: `name=", "is missing"]),
    "no links": (LINKS + JOINTS, "", ["no <link> in it"]),
    "entities": ("<robot", "<!DOCTYPE robot>\n<robot", [":2: <!DOCTYPE>: ", "delete it"]),
    "xacro": (
        LINKS,
        '<xacro:include filename="x"/>\n',
        ["xacro", "`xacro cart.urdf > robot.urdf`"],
    ),
    "two roots": (LINKS, LINKS + LOOSE, ['<link name="arm">', "2 parts", "`base_footprint`"]),
    "circle": (JOINTS, JOINTS + BACK.format("base_footprint"), ["run in a circle", "take one out"]),
    "ring beside": (LINKS, LINKS + RING, ["run in a circle"]),
    "to itself": (
        '<parent link="mast"/>',
        '<parent link="camera"/>',
        ['<joint name="tilt">', "run in a circle"],
    ),
    "below one to itself": (
        LINKS,
        LINKS
        + '<joint name="hung" type="fixed"><parent link="a"/><child link="c"/></joint>\n'
        + '<link name="a"/><link name="c"/>\n'
        + '<joint name="own" type="fixed"><parent link="a"/><child link="a"/></joint>\n',
        ['<joint name="own">', "from `a` one comes back to it"],
    ),
    "below a circle": (
        LINKS,
        LINKS
        + '<joint name="hung" type="fixed"><parent link="a"/><child link="c"/></joint>\n'
        + '<link name="c"/>\n'
        + RING,
        ['<joint name="back">', "from `a` one comes back to it"],
    ),
    "two parents": (
        JOINTS,
        JOINTS + BACK.format("left_wheel"),
        ['<joint name="back">', "`left_wheel` has a second parent joint `left_wheel_joint`"],
    ),
    "unknown link": (
        '<child link="mast"/>',
        '<child link="mats"/>',
        ["<child>: no link `mats`; did you mean `mast`?"],
    ),
    "twice": ('<link name="camera"/>', '<link name="mast"/>', ['<link name="mast">', "two of"]),
    "joint without a type": (
        'name="tilt" type="fixed"',
        'name="tilt"',
        ['<joint name="tilt">', "`type="],
    ),
    "unknown type": ('type="revolute"', 'type="hinge"', ["unknown type `hinge`"]),
    "no child": ('    <child link="mast"/>\n', "", ['<joint name="pan">: <child> is missing']),
    "no axis": ('<axis xyz="0 0 1"/>\n    <limit', '<axis xyz="0 0 0"/>\n    <limit', ["<axis>"]),
    "massless wheel": (
        LEFT_INERTIAL.group(),
        "",
        ['<link name="left_wheel">', "no mass", "`left_wheel_joint` moves it", "<inertial>"],
    ),
    "massless arm": (
        '<mass value="2"/>',
        '<mass value="0"/>',
        ['<link name="mast">', "no mass", "`pan` moves it", 'type="fixed"'],
    ),
    "negative mass": ('<mass value="2"/>', '<mass value="-2"/>', ["its mass is -2 kg"]),
    "no number": ('<mass value="2"/>', '<mass value="two"/>', ["<mass>: `value` is `two`"]),
    "not finite": ('<mass value="2"/>', '<mass value="nan"/>', ["<mass>: `value` is `nan`"]),
    "no inertia": (
        'ixx="0.01" iyy="0.01" izz="0.001"',
        'ixx="0" iyy="0" izz="0"',
        ["<inertia>", "`mast`", "no such inertia"],
    ),
    "more inertia than there is": (
        'ixx="0.01" iyy="0.01" izz="0.001"',
        'ixx="0.01" iyy="0.01" izz="0.03"',
        ["<inertia>", "`mast`", "0.03, is above the sum"],
    ),
    "not expanded": ('xyz="0.2 0 0.1"', 'xyz="${x} 0 0.1"', ["<origin>: `xyz`", "xacro cart.urdf"]),
    "two numbers": ('xyz="0.2 0 0.1"', 'xyz="0.2 0"', ["<origin>: `xyz` is `0.2 0`; expected 3"]),
    "flat box": (BOX, '<box size="0.5 0.3 0"/>', ["<box>: `size`", "more than 0"]),
    "unknown shape": (BOX, '<capsule radius="1"/>', ["no shape of `capsule`", "mesh"]),
    "no shape": (f"<geometry>{BOX}</geometry>", "", ["<visual>: <geometry> is missing"]),
    "unknown color": (
        '<material name="orange"/>',
        '<material name="oragne"/>',
        ["no such material", "`orange`?"],
    ),
    "bright color": ('rgba="1 0.5 0 1"', 'rgba="255 128 0 1"', ["<color>: `rgba`", "0 to 1"]),
    "no mesh": (BOX, '<mesh filename="hull.stl"/>', ["<mesh>: there is no file", "hull.stl"]),
    "no mesh in a package": (
        BOX,
        '<mesh filename="package://cart_description/hull.stl"/>',
        ["no `hull.stl` in a folder `cart_description`"],
    ),
    "a mesh on the net": (BOX, '<mesh filename="http://a/b.stl"/>', ["expected a file's name"]),
    "Collada": (BOX, '<mesh filename="hull.dae"/>', ["<mesh>: ", "Collada", "GLB or OBJ"]),
    "no mesh's format": (BOX, '<mesh filename="cart.yaml"/>', ["<mesh>: ", "expected"]),
    "a cut-off mesh": (BOX, '<mesh filename="cut.stl"/>', ["<mesh>: ", "cut.stl: no triangles"]),
    "a flat mesh": (BOX, '<mesh filename="good.stl" scale="1 0 1"/>', ["makes it flat"]),
    "millimeters": (
        BOX,
        '<mesh filename="large.stl"/>',
        ["<mesh>: it is 1000 x 2000 x 3000 m large", 'scale="0.001 0.001 0.001"'],
    ),
    "millimeters of a box": (BOX, '<box size="500 300 100"/>', ["<box>: ", "millimeters"]),
    "wheel that is fixed": (
        '"left_wheel_joint" type="continuous"',
        '"left_wheel_joint" type="fixed"',
        ['<joint name="left_wheel_joint">', 'expected type="continuous"'],
    ),
    "wheel across": (
        'xyz="0 0.2 0" rpy="-1.5707963267948966 0 0"',
        'xyz="0 0.2 0"',
        ['<joint name="left_wheel_joint">', "(0 0 1)", "along y"],
    ),
    "wheel without a shape": (
        '    <collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>\n',
        "",
        ["the wheel on `right_wheel_joint` has no shape"],
    ),
    "wheel on a wheel": (
        '<parent link="base_link"/>\n    <child link="right_wheel"/>',
        '<parent link="left_wheel"/>\n    <child link="right_wheel"/>',
        ["a wheel on the wheel `left_wheel_joint`"],
    ),
}


def problem(folder: Path, urdf: str | bytes = CART, model: str = MODEL) -> str:
    """Return the error that a cart gives, without the folder's name."""
    for name, content in (("good", stl()), ("large", stl(1000)), ("cut", stl()[:100])):
        (folder / f"{name}.stl").write_bytes(content)
    (folder / "hull.dae").touch()
    with pytest.raises(ScenarioError) as caught:
        load(scenario(folder, urdf, model))
    text = str(caught.value)
    assert "\n" not in text
    return text.replace(f"{folder}/", "")


@pytest.mark.parametrize(("old", "new", "expected"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_a_urdf(tmp_path: Path, old: str, new: str, expected: list[str]) -> None:
    assert old in CART
    text = problem(tmp_path, CART.replace(old, new))
    assert re.match(r"cart\.urdf:\d+: ", text)
    for part in expected:
        assert part in text


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    assert problem(tmp_path, b"\x89PNG\r\n\x1a\n\0\0").startswith("cart.urdf:1: not valid XML")


def test_a_base_without_mass(tmp_path: Path) -> None:
    urdf = CART.replace('type="revolute"', 'type="fixed"')
    for mass in (10, 2):
        urdf = urdf.replace(f'<mass value="{mass}"/>', '<mass value="0"/>')
    assert '<link name="base_link">: neither it nor what is fixed' in problem(tmp_path, urdf)


def test_a_long_chain_of_links_is_none(tmp_path: Path) -> None:
    """Neither deeper than the interpreter can go, nor slower than the file is long."""
    links = "".join(f'<link name="l{i}"/>\n' for i in range(5000))
    joint = '<joint name="j{1}" type="fixed"><parent link="{0}"/><child link="l{1}"/></joint>\n'
    joints = "".join(joint.format(f"l{i - 1}" if i else "camera", i) for i in range(5000))
    urdf = CART.replace("</robot>", links + joints + "</robot>")
    assert len(vehicle(tmp_path, urdf).model.mounts) > 5000


BESIDE = {
    "no file": ("cart.urdf", "carts.urdf", ["cart.yaml:1: `urdf`: no such file", "carts.urdf"]),
    "no joint": ("right_wheel_joint:", "rigth_wheel_joint:", ["`right_wheel_joint`?"]),
    "no wheels": (
        MODEL[MODEL.index("wheels") : MODEL.index("drive")],
        "",
        ["cart.yaml:1: `wheels`: expected", "left_wheel_joint, right_wheel_joint"],
    ),
    "wheels in a list": (
        MODEL[MODEL.index("wheels") : MODEL.index("drive")],
        "wheels: [left_wheel_joint, right_wheel_joint]\n",
        ["cart.yaml:2: `wheels`: expected"],
    ),
    "unknown field": ("friction: 0.9", "fricton: 0.9", ["cart.yaml:3: ", "`friction`?"]),
    "no drive": (MODEL[MODEL.index("drive") :], "", ["drive`", "is missing"]),
    "one wheel": ("  right_wheel_joint:\n", "", ["cart.yaml:", "two driven wheels, not 1"]),
    "two driven wheels": ("caster: true, ", "", ["caster_joint", "continuous"]),
}


@pytest.mark.parametrize(("old", "new", "expected"), BESIDE.values(), ids=BESIDE)
def test_a_mistake_beside_a_urdf(tmp_path: Path, old: str, new: str, expected: list[str]) -> None:
    assert old in MODEL
    text = problem(tmp_path, model=MODEL.replace(old, new))
    for part in expected:
        assert part in text


def test_a_urdf_alone(tmp_path: Path) -> None:
    file = scenario(tmp_path)
    text = file.read_text(encoding="utf-8").replace("cart.yaml", "cart.urdf")
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"write `model: \{urdf: cart.urdf, wheels: .*drive:"):
        load(file)


@pytest.mark.parametrize("name", ["cart.xacro", "cart.urdf.xacro"])
def test_xacro(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(CART, encoding="utf-8")
    text = problem(tmp_path, model=MODEL.replace("cart.urdf", name))
    assert text == f"{name}: xacro, not URDF. Fix: expand it first: `xacro {name} > robot.urdf`"


def test_a_mistake_ends_a_command_with_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = scenario(tmp_path, CART.replace(LINKS, ""))
    assert main(["check", str(file)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
