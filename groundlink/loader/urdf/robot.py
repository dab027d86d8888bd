# SPDX-License-Identifier: Apache-2.0
"""URDF files as a tree of links and joints.

The result is a tree with one root, and all numbers are finite and physically possible. Elements for
other programs (`gazebo`, `transmission`, `sensor`) are ignored.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundlink.core.errors import did_you_mean
from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats, quaternion_from_rpy, transform
from groundlink.loader.document import ScenarioError
from groundlink.scenario.vehicle import ROUNDED

from .elements import EXPAND_HINT, XmlElement, parse

DEFAULT_SPEED_RADPS = 1.0
"""Speed of a continuous joint without a limit."""

KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
"""Joint types, http://wiki.ros.org/urdf/XML/joint."""

SHAPES = ("box", "cylinder", "sphere", "mesh")


@dataclass(frozen=True, eq=False)
class UrdfInertial:
    """Mass properties of a body."""

    mass_kg: float
    center_m: Floats
    """Center of mass, shape (3,)."""

    inertia_kgm2: Floats
    """About the center of mass, along the axes of the body's frame, shape (3, 3)."""


@dataclass(frozen=True, eq=False)
class UrdfShape:
    """A visual or collision shape of a link."""

    element: XmlElement
    """Element of the shape, one of `SHAPES`."""

    link_from_shape: Floats
    """Shape (4, 4)."""

    color: tuple[float, ...] | None
    """sRGB color and alpha; None if not given."""


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A link with its mass properties and shapes."""

    element: XmlElement
    inertial: UrdfInertial | None
    visuals: tuple[UrdfShape, ...]
    collisions: tuple[UrdfShape, ...]


@dataclass(frozen=True)
class JointLimits:
    """Position and speed limits of a joint."""

    lower: float | None
    """Smallest position, rad or m; None for no limit."""

    upper: float | None
    max_speed: float
    """In rad/s or m/s."""


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint between two links."""

    element: XmlElement
    name: str
    kind: str
    parent: str
    child: str
    parent_from_child: Floats
    """Pose with the joint at zero, shape (4, 4)."""

    axis: Floats
    """Unit vector in the child's frame, shape (3,)."""

    motion: JointLimits | None
    """None for a joint that no servo can move."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree of links."""

    element: XmlElement
    name: str
    links: Mapping[str, UrdfLink]
    joints: Mapping[str, UrdfJoint]
    """By name; those nearer to the root come first."""

    root: str


def read_urdf(file: Path) -> Robot:
    """Return the robot of a URDF file.

    Raises
    ------
    ScenarioError
        for the first mistake.
    """
    if file.suffix == ".xacro":
        raise ScenarioError(f"{file}: xacro, not URDF. Fix: {EXPAND_HINT.format(name=file.name)}")
    top = parse(file)
    if top.tag != "robot":
        raise top.mistake("expected <robot name=...> as the outermost element of a URDF")
    _once(top.all("link"))
    _once(top.all("joint"))
    colors = _colors(top)
    links = {e.text("name"): _link(e, colors) for e in top.all("link")}
    if not links:
        raise top.mistake("there is no <link> in it; a vehicle needs a body and wheels")
    joints = [_joint(element, links) for element in top.all("joint")]
    return Robot(top, top.text("name"), links, *_tree(top, links, joints))


def _once(elements: Iterable[XmlElement]) -> None:
    names = set()
    for element in elements:
        if (name := element.text("name")) in names:
            raise element.mistake("there are two of this name; rename one")
        names.add(name)


_Color = tuple[float, ...] | None


def _colors(top: XmlElement) -> dict[str, _Color]:
    """Return colors by material name, defined by the robot or by a visual."""
    visuals = [visual for link in top.all("link") for visual in link.all("visual")]
    materials = [m for element in (top, *visuals) for m in element.all("material") if m.children]
    return {m.attributes["name"]: _color(m) for m in reversed(materials) if "name" in m.attributes}


def _color(material: XmlElement) -> _Color:
    """Return the color of a material; textures are ignored."""
    if (color := material.first("color")) is None:
        return None
    rgba = color.numbers("rgba", 4)
    if not all(0 <= part <= 1 for part in rgba):
        raise color.mistake(f"`rgba` is `{color.text('rgba')}`; expected four shares from 0 to 1")
    return rgba


def _link(element: XmlElement, colors: Mapping[str, _Color]) -> UrdfLink:
    inertial = element.first("inertial")
    return UrdfLink(
        element,
        None if inertial is None else _inertial(inertial, element),
        tuple(_geometry(e, colors) for e in element.all("visual")),
        tuple(_geometry(e, colors) for e in element.all("collision")),
    )


def _inertial(element: XmlElement, link: XmlElement) -> UrdfInertial:
    mass = element.need("mass").number("value")
    if mass < 0:
        raise link.mistake(f"its mass is {mass:g} kg; expected more than 0")
    moments = element.need("inertia")
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    xx, yy, zz, xy, xz, yz = (moments.number(n, 0.0 if n[1] != n[2] else None) for n in names)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least, middle, largest = np.linalg.eigvalsh(tensor)
    why = ""
    if least <= 0:
        why = "the least principal moment is not above 0"
    elif largest > ROUNDED * (least + middle):
        why = f"the largest principal moment, {largest:g}, is above the sum of the others"
    if mass > 0 and why:
        raise moments.mistake(
            f"{mass:g} kg of `{link.text('name')}` have no such inertia ({why}); give the one of a "
            "solid of its mass and size"
        )
    pose = _pose(element)
    rotation = pose[:3, :3]
    return UrdfInertial(mass, pose[:3, 3], rotation @ tensor @ rotation.T)


def _geometry(element: XmlElement, colors: Mapping[str, _Color]) -> UrdfShape:
    geometry = element.need("geometry")
    shape = next((e for e in geometry.children if e.tag in SHAPES), None)
    if shape is None:
        found = f" of `{geometry.children[0].tag}`" if geometry.children else ""
        raise geometry.mistake(f"no shape{found} is known; expected one of {', '.join(SHAPES)}")
    color = None
    if (material := element.first("material")) is not None:
        color = _color(material)
        name = material.attributes.get("name", "")
        if name and not material.children:
            if name not in colors:
                hint = did_you_mean(name, colors) if colors else "give it a <color>"
                raise material.mistake(f"no such material in this file; {hint}")
            color = colors[name]
    return UrdfShape(shape, _pose(element), color)


def _joint(element: XmlElement, links: Iterable[str]) -> UrdfJoint:
    kind = element.text("type")
    if kind not in KINDS:
        raise element.mistake(f"unknown type `{kind}`; {did_you_mean(kind, KINDS)}")
    ends = []
    for end in ("parent", "child"):
        link = element.need(end).text("link")
        if link not in links:
            raise element.need(end).mistake(f"no link `{link}`; {did_you_mean(link, links)}")
        ends.append(link)
    at = element.first("axis")
    axis = np.array((1.0, 0.0, 0.0) if at is None else at.numbers("xyz", 3))
    length = np.linalg.norm(axis)
    if length < 1e-9:
        if kind != "fixed":
            raise (at or element).mistake("an axis of no length; give it a direction")
        axis, length = np.array([1.0, 0.0, 0.0]), np.float64(1)
    name = element.text("name")
    pose, motion = _pose(element), _motion(element, kind)
    return UrdfJoint(element, name, kind, ends[0], ends[1], pose, axis / length, motion)


def _motion(element: XmlElement, kind: str) -> JointLimits | None:
    """Return the limits of a joint; None if it is fixed, mimics another, or excludes zero."""
    if kind not in ("revolute", "continuous", "prismatic") or element.first("mimic"):
        return None
    limit, endless = element.first("limit"), kind == "continuous"
    if limit is None:
        return JointLimits(None, None, DEFAULT_SPEED_RADPS) if endless else None
    speed = limit.number("velocity", DEFAULT_SPEED_RADPS if endless else 0.0)
    lower, upper = limit.number("lower", 0.0), limit.number("upper", 0.0)
    if speed <= 0:
        return None
    if endless:
        return JointLimits(None, None, speed)
    return JointLimits(lower, upper, speed) if lower <= 0.0 <= upper and lower < upper else None


def _pose(element: XmlElement) -> Floats:
    """Return the pose of an element's origin, shape (4, 4)."""
    origin = element.first("origin")
    if origin is None:
        return np.eye(4)
    zero: Vector3 = (0.0, 0.0, 0.0)
    roll, pitch, yaw = origin.numbers("rpy", 3, zero)
    return transform(origin.numbers("xyz", 3, zero), quaternion_from_rpy(roll, pitch, yaw))


def _tree(
    top: XmlElement, links: Mapping[str, UrdfLink], joints: list[UrdfJoint]
) -> tuple[dict[str, UrdfJoint], str]:
    """Return the joints from the root outwards, and the root."""
    carriers: dict[str, UrdfJoint] = {}
    for joint in joints:
        if (first := carriers.setdefault(joint.child, joint)) is not joint:
            raise joint.element.mistake(
                f"`{joint.child}` has a second parent joint `{first.name}`; expected one parent: "
                "take one of the joints out"
            )
    roots = [link for link in links if link not in carriers]
    if len(roots) > 1:
        raise links[roots[1]].element.mistake(
            f"no joint has it as child, as with `{roots[0]}`, so the robot falls into "
            f"{len(roots)} parts; join them with <joint>s"
        )
    below: dict[str, list[UrdfJoint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    ordered: dict[str, UrdfJoint] = {}
    reached = list(roots)
    for link in reached:
        for joint in below.get(link, ()):
            ordered[joint.name] = joint
            reached.append(joint.child)
    for joint in joints:
        if joint.name not in ordered:
            passed = set()
            # The joint may only lead to the cycle: follow parents until one repeats.
            while joint.name not in passed:
                passed.add(joint.name)
                joint = carriers[joint.parent]
            raise joint.element.mistake(
                f"from `{joint.child}` one comes back to it: the joints run in a circle; "
                "take one out, as a URDF is a tree"
            )
    return ordered, roots[0]
