# SPDX-License-Identifier: Apache-2.0
"""Contacts of a vehicle's chassis, recorded tick by tick.

Recording does not influence the motion. The solid that a contact point belongs to is determined
only when contacts are reported.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.messages.ground_truth import Contact
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid

RecordedContact = tuple[int, int, Vector3, float]
"""Tick, other body, point in the world (m), normal force (N)."""

NamedContact = tuple[int, str, float]
"""Tick, name of the solid that was touched, normal force (N)."""


class ChassisContacts:
    """Contacts of one vehicle's chassis since they were last reported."""

    __slots__ = ("_named", "_touches")

    def __init__(self) -> None:
        self._named: tuple[NamedContact, ...] = ()
        self._touches: list[RecordedContact] = []

    def touched(self, touch: RecordedContact) -> None:
        """Add a contact point of one tick."""
        self._touches.append(touch)

    def named(self, bodies: Mapping[int, Sequence[Solid]]) -> tuple[NamedContact, ...]:
        """Return each contact point since contacts were last reported, and keep it."""
        if self._touches:
            touches, self._touches = self._touches, []
            names = _names(touches, bodies)
            self._named += tuple(
                (tick, name, force)
                for name, (tick, _, _, force) in zip(names, touches, strict=True)
            )
        return self._named

    def remember(self, contacts: Sequence[NamedContact]) -> None:
        """Continue with contact points of a predecessor."""
        self._named = tuple(contacts)

    def report(self, bodies: Mapping[int, Sequence[Solid]]) -> tuple[Contact, ...]:
        """Return the contacts since the last call, in the order of the first ones.

        Parameters
        ----------
        bodies
            solids of each body.
        """
        if not self._touches and not self._named:
            return ()
        touches, self._named = self.named(bodies), ()
        largest: dict[str, tuple[float, int]] = {}
        ticks: dict[str, set[int]] = {}
        for tick, name, force in touches:
            ticks.setdefault(name, set()).add(tick)
            if name not in largest or force > largest[name][0]:
                largest[name] = force, tick
        return tuple(
            Contact(name, force, tick, len(ticks[name])) for name, (force, tick) in largest.items()
        )


def _names(touches: Sequence[RecordedContact], bodies: Mapping[int, Sequence[Solid]]) -> list[str]:
    """Return for each contact the solid of the other body whose surface is nearest."""
    numbers = np.array([body for _, body, _, _ in touches])
    points = np.array([point for _, _, point, _ in touches])
    names = [""] * len(touches)
    for number in set(numbers.tolist()):
        solids, which = bodies[number], np.flatnonzero(numbers == number)
        apart = [np.abs(_outside_m(solid, points[which])) for solid in solids]
        for i, nearest in zip(which.tolist(), np.argmin(apart, axis=0).tolist(), strict=True):
            names[i] = solids[nearest].name
    return names


def _outside_m(solid: Solid, points: Floats) -> Floats:
    """Return distances of points in the world, shape (N, 3), to a solid; negative inside."""
    local = (points - solid.position_m) @ matrix_from_quaternion(solid.orientation)
    over = _over(solid.shape, local)
    outside: Floats = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    inside: Floats = np.minimum(over.max(axis=1), 0.0)
    return outside + inside


def _over(shape: Shape, local: Floats) -> Floats:
    """Return distances of points beyond each of a shape's limits, shape (N, limits)."""
    if isinstance(shape, Box):
        sides: Floats = np.abs(local) - np.array(shape.size_m) / 2
        return sides
    if isinstance(shape, Cylinder):
        radial = np.linalg.norm(local[:, :2], axis=1) - shape.radius_m
        return np.stack([radial, np.abs(local[:, 2]) - shape.length_m / 2], axis=-1)
    if isinstance(shape, Mesh):  # a mesh has a body of its own
        return np.concatenate([local - shape.high_m, shape.low_m - local], axis=-1)
    beyond: Floats = np.linalg.norm(local, axis=1, keepdims=True) - shape.radius_m
    return beyond
