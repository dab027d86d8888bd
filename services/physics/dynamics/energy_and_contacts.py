# SPDX-License-Identifier: Apache-2.0
"""What a vehicle's motors have done and what it has touched, kept tick by tick.

Rule: pure sums over what physics has read from the engine anyway; it changes nothing of the motion.
Which solid a touched body's point belongs to is only worked out when it is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.messages.vitals import Contact
from groundlink.world.solids import Box, Cylinder, Mesh, Shape, Solid

Touch = tuple[int, int, Vector3, float]
"""Tick, number of the other body, point in the world (m), normal force (N)."""


class EnergyAndContacts:
    """Energy and contacts of one vehicle."""

    __slots__ = ("_braking", "_driving", "_touches")

    def __init__(self) -> None:
        self._driving = self._braking = 0.0
        self._touches: list[Touch] = []

    def worked(self, driving_w: float, braking_w: float) -> None:
        """Add a tick: the power of the motors where they drive and where they brake."""
        self._driving += driving_w
        self._braking += braking_w

    @property
    def motor_work_j(self) -> float:
        """Work of the motors where they drive, J."""
        return self._driving * TICK_SECONDS

    @property
    def braked_j(self) -> float:
        """Work that they took up where they brake, J."""
        return self._braking * TICK_SECONDS

    def touched(self, touch: Touch) -> None:
        """Add a contact point of one tick."""
        self._touches.append(touch)

    def contacts(self, bodies: Mapping[int, Sequence[Solid]]) -> tuple[Contact, ...]:
        """Return what was touched since the last call, in the order of first touch.

        Parameters
        ----------
        bodies
            the solids that each of the engine's bodies is made of.
        """
        if not self._touches:
            return ()
        touches, self._touches = self._touches, []
        names = _names(touches, bodies)
        largest: dict[str, tuple[float, int]] = {}
        ticks: dict[str, set[int]] = {}
        for name, (tick, _, _, force) in zip(names, touches, strict=True):
            ticks.setdefault(name, set()).add(tick)
            if name not in largest or force > largest[name][0]:
                largest[name] = force, tick
        return tuple(
            Contact(name, force, tick, len(ticks[name])) for name, (force, tick) in largest.items()
        )


def _names(touches: Sequence[Touch], bodies: Mapping[int, Sequence[Solid]]) -> list[str]:
    """Return for each touch the solid of the touched body whose surface is nearest to its point."""
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
    """Return how far points in the world, shape (N, 3), are outside a solid; inside is negative."""
    local = (points - solid.position_m) @ matrix_from_quaternion(solid.orientation)
    over = _over(solid.shape, local)
    outside: Floats = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    inside: Floats = np.minimum(over.max(axis=1), 0.0)
    return outside + inside


def _over(shape: Shape, local: Floats) -> Floats:
    """Return how far points are beyond each of a shape's limits, shape (N, limits)."""
    if isinstance(shape, Box):
        sides: Floats = np.abs(local) - np.array(shape.size_m) / 2
        return sides
    if isinstance(shape, Cylinder):
        radial = np.linalg.norm(local[:, :2], axis=1) - shape.radius_m
        return np.stack([radial, np.abs(local[:, 2]) - shape.length_m / 2], axis=-1)
    if isinstance(shape, Mesh):  # never one of several in a body
        return np.concatenate([local - shape.high_m, shape.low_m - local], axis=-1)
    beyond: Floats = np.linalg.norm(local, axis=1, keepdims=True) - shape.radius_m
    return beyond
