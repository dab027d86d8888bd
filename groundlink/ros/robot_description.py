# SPDX-License-Identifier: Apache-2.0
"""Robot description: URDF of a vehicle with its visuals, joints and sensor mounts.

It is made from the scenario alone and needs no further files. It differs from the model in physics,
which has springs and spherical wheels. Names are without the vehicle's `frame_prefix`, which URDF
cannot express; robot_state_publisher and RViz add it. The joint of a wheel is continuous if the
vehicle's encoders measure its angle, and otherwise fixed, so that no frame waits for an unknown
angle. Masses are left out, since KDL does not support a root link with inertia. A mesh is replaced
by its bounding box.
"""

from collections.abc import Collection, Sequence
from math import cos, isinf, radians, sin
from typing import NamedTuple
from xml.etree import ElementTree

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import IDENTITY_QUATERNION, matrix_from_quaternion, rpy_from_matrix
from groundlink.messages.navigation import Transform
from groundlink.scenario.joints import Arm, Joint
from groundlink.scenario.running_gear import Ackermann, Tracked, Wheel
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Box, Cylinder, Material, Mesh, Shape, Solid, Sphere

Element = ElementTree.Element

_ACROSS = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
"""link_from_cylinder: the wheel's axle is y in the link; a cylinder's axis is its z."""


class Ros2Control(NamedTuple):
    """Topics on which `topic_based_ros2_control` commands joints and reads their states."""

    commands_topic: str
    states_topic: str


def urdf(
    model: VehicleModel,
    mounts: Sequence[Transform],
    turning: Collection[str],
    materials: dict[str, Material],
    ros2_control: Ros2Control | None = None,
) -> str:
    """Return a URDF document.

    Parameters
    ----------
    mounts
        parent_from_child of each sensor's frame, without prefix.
    turning
        joints with published positions: wheels by their names, tracks, steering joints.
    materials
        materials of the world, in addition to the model's own.
    ros2_control
        its topics; None: no block for it.
    """
    colors = model.materials | materials
    robot = Element("robot", name=model.name)
    base = _sub(robot, "link", name=model.base_frame)
    chassis = model.chassis
    box = Solid("chassis", Box(size_m=chassis.size_m), "", chassis.center_m)
    for solid in model.visuals or (box,):
        _show(base, "visual", solid, colors)
    for solid in (*((box,) if chassis.collides else ()), *model.collisions):
        _show(base, "collision", solid, {})
    drive = model.drive
    if isinstance(drive, Tracked):
        for track in drive.shafts(model.wheels):
            if track.name in turning:
                _track(robot, model.base_frame, track.name, model.wheels[track.wheels[0]])
    for arm in model.arms:
        link = _arm(robot, model, arm)
        for solid in arm.visuals:
            _show(link, "visual", solid, colors)
    for wheel in model.wheels:
        carrier, at = _carrier(model, wheel)
        if isinstance(drive, Ackermann) and wheel.name in drive.steered:
            name = drive.steering_joints[drive.steered.index(wheel.name)]
            if name in turning:
                carrier, at = _steering(robot, carrier, name, at, drive), (0.0, 0.0, 0.0)
        link = _wheel(robot, carrier, wheel, at, turns=wheel.name in turning)
        roller = Cylinder(radius_m=wheel.radius_m, length_m=wheel.width_m)
        tread = Solid(wheel.name, roller, wheel.material, orientation=_ACROSS)
        for solid in wheel.visuals or (tread,):
            _show(link, "visual", solid, colors)
        _show(link, "collision", tread, {})
    for part in model.joints:
        link = _part(robot, model.base_frame, part)
        for solid in part.visuals:
            _show(link, "visual", solid, colors)
    for mount in mounts:
        joint = _sub(robot, "joint", name=f"{mount.child}_joint", type="fixed")
        _sub(joint, "parent", link=mount.parent)
        _sub(joint, "child", link=mount.child)
        _origin(joint, mount.translation_m, mount.rotation)
        _sub(robot, "link", name=mount.child)
    if ros2_control is not None:
        _add_ros2_control(robot, model, ros2_control)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def _add_ros2_control(robot: Element, model: VehicleModel, topics: Ros2Control) -> None:
    """Add the block that `controller_manager` reads."""
    system = _sub(robot, "ros2_control", name=f"{model.name}_system", type="system")
    hardware = _sub(system, "hardware")
    _sub(hardware, "plugin").text = "topic_based_ros2_control/TopicBasedSystem"
    for name, value in (
        ("joint_commands_topic", topics.commands_topic),
        ("joint_states_topic", topics.states_topic),
        # By default the plugin sends no velocities as long as the positions are zero.
        ("trigger_joint_command_threshold", "-1"),
    ):
        _sub(hardware, "param", name=name).text = value
    for interface in model.joint_interfaces():
        joint = _sub(system, "joint", name=interface.name)
        _sub(joint, "command_interface", name=interface.commands[0])
        for state in ("position", "velocity"):
            _sub(joint, "state_interface", name=state)


def _track(robot: Element, base: str, name: str, first: Wheel) -> None:
    """Add the shaft of a track, at the track's first wheel."""
    joint = _sub(robot, "joint", name=name, type="continuous")
    _sub(joint, "parent", link=base)
    _sub(joint, "child", link=f"{name}_link")
    _origin(joint, first.center_m, IDENTITY_QUATERNION)
    _sub(joint, "axis", xyz="0 1 0")
    _sub(robot, "link", name=f"{name}_link")


def _steering(robot: Element, base: str, name: str, at: Vector3, drive: Ackermann) -> str:
    """Add a joint that steers a wheel, and return the name of its link."""
    joint = _sub(robot, "joint", name=name, type="revolute")
    _sub(joint, "parent", link=base)
    _sub(joint, "child", link=f"{name}_link")
    _origin(joint, at, IDENTITY_QUATERNION)
    _sub(joint, "axis", xyz="0 0 1")
    most, speed = _text(radians(drive.max_steering_deg)), radians(drive.steering_speed_degps)
    effort = _text(drive.steering_torque_nm)
    _sub(joint, "limit", lower=f"-{most}", upper=most, effort=effort, velocity=_text(speed))
    _sub(robot, "link", name=f"{name}_link")
    return f"{name}_link"


def _wheel(robot: Element, carrier: str, wheel: Wheel, at: Vector3, *, turns: bool) -> Element:
    """Add a wheel with its spring at rest under load, and return its link."""
    joint = _sub(robot, "joint", name=wheel.name, type="continuous" if turns else "fixed")
    _sub(joint, "parent", link=carrier)
    _sub(joint, "child", link=f"{wheel.name}_link")
    half = wheel.yaw_rad / 2
    _origin(joint, at, (0.0, 0.0, sin(half), cos(half)))
    if turns:
        _sub(joint, "axis", xyz="0 1 0")
    return _sub(robot, "link", name=f"{wheel.name}_link")


def _part(robot: Element, base: str, part: Joint) -> Element:
    """Add a joint other than a wheel joint, and return its link."""
    low, high = part.limits
    endless = isinf(low) or isinf(high)
    kind = "continuous" if part.kind == "revolute" and endless else part.kind
    joint = _sub(robot, "joint", name=part.name, type=kind)
    _sub(joint, "parent", link=f"{part.parent}_link" if part.parent else base)
    _sub(joint, "child", link=f"{part.name}_link")
    _origin(joint, part.at_m, IDENTITY_QUATERNION)
    _sub(joint, "axis", xyz=_text(*part.unit_axis))
    bounds = {} if endless else {"lower": _text(low), "upper": _text(high)}
    _sub(joint, "limit", **bounds, effort="0", velocity=_text(part.max_speed))
    return _sub(robot, "link", name=f"{part.name}_link")


def _carrier(model: VehicleModel, wheel: Wheel) -> tuple[str, Vector3]:
    """Return the link that carries a wheel, and where in its frame."""
    for arm in model.arms:
        if wheel.name in arm.wheels:
            return f"{arm.name}_link", _apart(arm.pivot_m, wheel.center_m)
    return model.base_frame, wheel.center_m


def _arm(robot: Element, model: VehicleModel, arm: Arm) -> Element:
    """Add an arm that swings freely, and return its link."""
    origins = {other.name: other.pivot_m for other in model.arms}
    joint = _sub(robot, "joint", name=arm.name, type="revolute")
    _sub(joint, "parent", link=f"{arm.parent}_link" if arm.parent else model.base_frame)
    _sub(joint, "child", link=f"{arm.name}_link")
    at = _apart(origins[arm.parent], arm.pivot_m) if arm.parent else arm.pivot_m
    _origin(joint, at, IDENTITY_QUATERNION)
    _sub(joint, "axis", xyz="0 1 0")
    low, high = _text(radians(arm.lower_deg)), _text(radians(arm.upper_deg))
    _sub(joint, "limit", lower=low, upper=high, effort="0", velocity="10")
    return _sub(robot, "link", name=f"{arm.name}_link")


def _apart(origin: Vector3, place: Vector3) -> Vector3:
    (x, y, z), (ox, oy, oz) = place, origin
    return x - ox, y - oy, z - oz


def _show(link: Element, tag: str, solid: Solid, colors: dict[str, Material]) -> None:
    """Add a solid; it is colored if its material is known."""
    at, shape = solid.position_m, solid.shape
    if isinstance(shape, Mesh):
        low, high = shape.low_m, shape.high_m
        middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        turned = matrix_from_quaternion(solid.orientation) @ middle
        x, y, z = (float(p + q) for p, q in zip(at, turned, strict=True))
        at = (x, y, z)
        sx, sy, sz = (max(b - a, 1e-3) for a, b in zip(low, high, strict=True))
        shape = Box(size_m=(sx, sy, sz))
    element = _sub(link, tag)
    _origin(element, at, solid.orientation)
    _geometry(_sub(element, "geometry"), shape)
    if color := colors.get(solid.material):
        material = _sub(element, "material", name=solid.material)
        # Convert linear light for displays, with gamma 2.2.
        screen = [component ** (1 / 2.2) for component in color.color]
        _sub(material, "color", rgba=_text(*screen, 1.0))


def _geometry(geometry: Element, shape: Shape) -> None:
    if isinstance(shape, Box):
        _sub(geometry, "box", size=_text(*shape.size_m))
    elif isinstance(shape, Cylinder):
        _sub(geometry, "cylinder", radius=_text(shape.radius_m), length=_text(shape.length_m))
    elif isinstance(shape, Sphere):
        _sub(geometry, "sphere", radius=_text(shape.radius_m))


def _origin(element: Element, at: Vector3, orientation: Quaternion) -> None:
    rpy = rpy_from_matrix(matrix_from_quaternion(orientation))
    _sub(element, "origin", xyz=_text(*at), rpy=_text(*rpy))


def _sub(parent: Element, tag: str, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _text(*numbers: float) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
