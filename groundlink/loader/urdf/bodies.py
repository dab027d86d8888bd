# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies of a URDF: links that move together are merged.

Wheels turn; all other links belong to the base. Links on fixed joints merge with their parent.
Links on joints with a servo move, but their mass and collisions count for the base at position
zero. All other joints are held at zero, and so are joints between the base and a wheel.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from groundlink.core.errors import did_you_mean
from groundlink.core.frames import Floats

from .elements import XmlElement
from .robot import Robot, UrdfInertial, UrdfJoint, UrdfLink, UrdfShape

BASE_LINK = "base_link"
"""Base frame (REP 105), also below a massless `base_footprint`."""

Placed = tuple[Floats, UrdfShape]
"""Pose of a shape in its body's frame, shape (4, 4), and the shape."""


@dataclass(frozen=True, eq=False)
class Body:
    """Links that move together, in one frame."""

    element: XmlElement
    """Element of the link whose frame is the body's."""

    body_from_link: dict[str, Floats]
    """Poses of the links, shape (4, 4) each."""

    inertial: UrdfInertial
    visuals: tuple[Placed, ...]
    collisions: tuple[Placed, ...]


@dataclass(frozen=True, eq=False)
class WheelBody:
    """A body that rotates on the base."""

    joint: UrdfJoint
    center_m: Floats
    """Center of the axle in the base frame, shape (3,)."""

    body: Body
    """In a frame at `center_m` with the axes of the base frame."""


@dataclass(frozen=True, eq=False)
class MovingBody:
    """Links moved by a servo; their masses and collisions belong to the base."""

    joint: UrdfJoint
    parent: str | None
    """Parent joint; None for the base."""

    at_m: Floats
    """Position of the joint in its parent's frame at zero, shape (3,)."""

    axis: Floats
    """Unit vector, shape (3,)."""

    visuals: tuple[Placed, ...]
    """In a frame at the joint with the axes of the base frame at position zero."""


def bodies(
    robot: Robot, wheels: Sequence[str], casters: Container[str]
) -> tuple[str, Body, dict[str, WheelBody], dict[str, MovingBody]]:
    """Return the base link's name, the base, and wheels and moving bodies by their joints' names.

    Casters may have a joint of any type; they are simulated as sliding balls.

    Raises
    ------
    ScenarioError
        when a joint cannot carry a wheel, or a moving body has no mass.
    """
    joints = [_wheel_joint(robot, name, is_caster=name in casters) for name in wheels]
    root_from = {robot.root: np.eye(4)}
    carrier: dict[str, str | None] = {robot.root: None}  # the wheel that a link belongs to
    rigid = {robot.root: robot.root}  # the link that it moves as one with, whatever is held
    for joint in robot.joints.values():
        root_from[joint.child] = root_from[joint.parent] @ joint.parent_from_child
        above = carrier[joint.parent]
        carrier[joint.child] = joint.name if joint in joints else above
        if joint in joints and above is not None:
            raise joint.element.mistake(f"a wheel on the wheel `{above}`; take one of them out")
        rigid[joint.child] = rigid[joint.parent] if joint.kind == "fixed" else joint.child
    _check_masses(robot, rigid)
    base = BASE_LINK if rigid.get(BASE_LINK) == robot.root else robot.root
    base_from_root = np.linalg.inv(root_from[base])
    base_from = {link: base_from_root @ pose for link, pose in root_from.items()}
    turning = {}
    for joint in joints:
        at = np.eye(4)
        at[:3, 3] = -(center := base_from[joint.child][:3, 3])
        own = {link: at @ base_from[link] for link, by in carrier.items() if by == joint.name}
        turning[joint.name] = WheelBody(joint, center, _merged(robot, joint.child, own))
        axle = base_from[joint.child][:3, :3] @ joint.axis
        if abs(axle[1]) < 0.999 and joint.name not in casters:  # 2.6 degrees
            across = " ".join(f"{part:.3g}" for part in axle)
            raise joint.element.mistake(
                f"its axis points along ({across}) of `{base}`; a wheel's axle lies along y, "
                "where x is forward: mend <axis> or the <origin>s on the way there"
            )
    still = {link: pose for link, pose in base_from.items() if carrier[link] is None}
    body = _merged(robot, base, still)
    if body.inertial.mass_kg <= 0:
        raise body.element.mistake(
            "neither it nor what is fixed to it has a mass; give it an <inertial>"
        )
    mover = _movers(robot, joints, still)
    body = replace(body, visuals=_visuals(robot, {k: v for k, v in still.items() if not mover[k]}))
    moving = {}
    for name in dict.fromkeys(filter(None, mover.values())):
        joint, by = robot.joints[name], mover[robot.joints[name].parent]
        center = base_from[joint.child][:3, 3]
        at = np.eye(4)
        at[:3, 3] = -center
        own = {link: at @ still[link] for link in still if mover[link] == name}
        moving[name] = MovingBody(
            joint=joint,
            parent=by,
            at_m=center - base_from[robot.joints[by].child][:3, 3] if by else center,
            axis=base_from[joint.child][:3, :3] @ joint.axis,
            visuals=_visuals(robot, own),
        )
    return base, body, turning, moving


def _movers(
    robot: Robot, wheels: Sequence[UrdfJoint], still: Container[str]
) -> dict[str, str | None]:
    """Return by link the joint that moves it; None for the base and wheels."""
    above = {joint.child: joint for joint in robot.joints.values()}
    held, ahead = set(), [*wheels]
    while ahead:  # Joints between the base and a wheel, such as steering joints, are held.
        held.add(joint := ahead.pop())
        ahead += [above[joint.parent]] if joint.parent in above else []
    mover: dict[str, str | None] = {robot.root: None}
    for joint in robot.joints.values():
        moves = joint.motion is not None and joint not in held and joint.child in still
        mover[joint.child] = joint.name if moves else mover[joint.parent]
    return mover


def _wheel_joint(robot: Robot, name: str, *, is_caster: bool) -> UrdfJoint:
    if name not in robot.joints:
        hint = did_you_mean(name, robot.joints) if robot.joints else "the file has none"
        raise robot.element.mistake(f"no joint `{name}`, which is to be a wheel's; {hint}")
    joint = robot.joints[name]
    if joint.kind != "continuous" and not is_caster:
        raise joint.element.mistake(
            f'it is `{joint.kind}`, but is to carry a wheel; expected type="continuous"'
        )
    return joint


def _check_masses(robot: Robot, rigid: Mapping[str, str]) -> None:
    """Refuse moving bodies without mass; `rigid` maps each link to the link it moves with."""
    heavy = {
        rigid[name]
        for name, link in robot.links.items()
        if link.inertial and link.inertial.mass_kg > 0
    }
    for joint in robot.joints.values():
        if joint.kind != "fixed" and joint.child not in heavy:
            raise robot.links[joint.child].element.mistake(
                f"no mass, though the joint `{joint.name}` moves it; give it an <inertial>, or "
                'make the joint type="fixed"'
            )


def _merged(robot: Robot, name: str, body_from: dict[str, Floats]) -> Body:
    """Return the body of links with given poses."""
    links: list[tuple[Floats, UrdfLink]] = [(p, robot.links[link]) for link, p in body_from.items()]
    return Body(
        robot.links[name].element,
        body_from,
        _sum([(pose, link.inertial) for pose, link in links if link.inertial]),
        _visuals(robot, body_from),
        tuple((pose @ g.link_from_shape, g) for pose, link in links for g in link.collisions),
    )


def _visuals(robot: Robot, body_from: dict[str, Floats]) -> tuple[Placed, ...]:
    """Return the visuals of links with given poses."""
    return tuple(
        (pose @ shape.link_from_shape, shape)
        for link, pose in body_from.items()
        for shape in robot.links[link].visuals
    )


def _sum(parts: Sequence[tuple[Floats, UrdfInertial]]) -> UrdfInertial:
    """Return the total inertia of bodies in one frame (parallel axis theorem)."""
    mass = sum(part.mass_kg for _, part in parts)
    if mass <= 0:
        return UrdfInertial(0.0, np.zeros(3), np.zeros((3, 3)))
    placed = [(p.mass_kg, at[:3, :3] @ p.center_m + at[:3, 3], at[:3, :3], p) for at, p in parts]
    center = sum((m * place for m, place, _, _ in placed), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for part_mass, place, turn, part in placed:
        arm = place - center
        tensor += turn @ part.inertia_kgm2 @ turn.T
        tensor += part_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return UrdfInertial(mass, center, tensor)
