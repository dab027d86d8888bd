# SPDX-License-Identifier: Apache-2.0
"""Bodies of vehicles between the engine and their models: motion and contacts in, forces out.

`bodies.h` has the same structures. The engine fills and reads those of all vehicles in one call.
"""

from collections.abc import Sequence
from ctypes import POINTER, Array, Structure, c_double, c_int32, c_size_t, pointer
from typing import Any

from groundlink.core.fields import Vector3

_VECTOR = c_double * 3


class BodyJoint(Structure):
    """A sliding joint of a body."""

    _fields_ = (
        ("position_m", c_double),
        ("velocity_mps", c_double),
        ("force_n", c_double),
        ("link", c_int32),
        ("q", c_int32),
        ("u", c_int32),
    )
    position_m: float
    velocity_mps: float
    force_n: float
    """Along the joint, for the next step."""

    link: int
    q: int
    """Place of its position in the engine's vector; `u`: of its velocity."""

    u: int


class ArticulatedBody(Structure):
    """A body with joints.

    Parameters
    ----------
    number
        that the backend gave it.
    joints
        link and places in the engine's vectors of each joint.
    """

    _fields_ = (
        ("number", c_int32),
        ("joint_count", c_int32),
        ("_joints", POINTER(BodyJoint)),
        ("center_m", _VECTOR),
        ("orientation", c_double * 4),
        ("velocity_mps", _VECTOR),
        ("turn_radps", _VECTOR),
        ("force_n", _VECTOR),
        ("torque_nm", _VECTOR),
    )
    number: int
    joint_count: int
    center_m: Array[c_double]
    """Its center of mass in the world."""

    orientation: Array[c_double]
    """world_from_base, xyzw."""

    velocity_mps: Array[c_double]
    """Of its center of mass in the world."""

    turn_radps: Array[c_double]
    force_n: Array[c_double]
    """At its center of mass in the base's frame, for the next step."""

    torque_nm: Array[c_double]

    def __init__(self, number: int, joints: Sequence[tuple[int, int, int]]) -> None:
        made = [BodyJoint(link=link, q=q, u=u) for link, q, u in joints]
        self.joints = (BodyJoint * len(joints))(*made)
        super().__init__(number, len(joints), self.joints)


class ContactPoint(Structure):
    """A contact point of the last step."""

    _fields_ = (
        ("body", c_int32),
        ("link", c_int32),
        ("other", c_int32),
        ("_point", _VECTOR),
        ("_normal", _VECTOR),
        ("force_n", c_double),
    )
    body: int
    link: int
    other: int
    """The body that it touches."""

    force_n: float
    """Normal force, more than zero."""

    def __init__(
        self, body: int, link: int, other: int, point: Vector3, normal: Vector3, force_n: float
    ) -> None:
        super().__init__(body, link, other, _VECTOR(*point), _VECTOR(*normal), force_n)

    @property
    def point_m(self) -> Vector3:
        """On the other body, in the world."""
        x, y, z = self._point
        return x, y, z

    @property
    def normal(self) -> Vector3:
        """Toward this body."""
        x, y, z = self._normal
        return x, y, z


class Contacts(Structure):
    """Contact points of the last step, each once for either body."""

    _fields_ = (("points", POINTER(ContactPoint)), ("count", c_size_t), ("_room", c_size_t))
    points: Any
    """An array of `ContactPoint`."""

    count: int


class BodyList:
    """The bodies whose motion is sensed and pushed together.

    Attributes
    ----------
    address
        of an array of pointers to the bodies.
    """

    def __init__(self, bodies: Sequence[ArticulatedBody]) -> None:
        self.bodies = bodies
        self.address = pointers(bodies)


def pointers(structures: Sequence[Structure]) -> Any:
    """Return an array of pointers to structures, which the caller keeps."""
    kind = POINTER(type(structures[0])) if structures else POINTER(Structure)
    return (kind * len(structures))(*map(pointer, structures))
