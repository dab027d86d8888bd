# SPDX-License-Identifier: Apache-2.0
"""The grip of a tyre on the ground: dry friction with an elastic tread.

Rule: pure; slip and load in, force out, and the tread's deflection is all that is remembered.

Bullet's own friction acts along the axes of the world, so that a skid-steered vehicle turns up to
twice as fast on one heading as on another (measured, with and without its friction cone). Here the
law is Coulomb's, the same in every direction of the ground unless the tyre says otherwise: while it
sticks, the tread is a spring and damper and holds without creeping; it slips at the limit of its
load.
"""

from __future__ import annotations

from math import sqrt

from groundlink.clock import TICK_SECONDS

TREAD_STIFFNESS = 0.16
"""Tangential, in units of the wheel's mass as the tread feels it over the tick squared: as stiff as
an explicit step bears. The rover's comes to 30 kN/m, of the order of a small pneumatic tyre's; at
135 N it gives way by 4 mm before it slips."""

TREAD_DAMPING = 0.8
"""Likewise, in units of that mass over the tick; from 2 on, the wheel would rattle."""


class Tyre:
    """One tyre.

    Parameters
    ----------
    rim_mass_kg
        what the tread has to push to turn the wheel: its inertia over its radius squared.
    axle_ratio
        friction along the axle as a share of that in rolling direction.
    """

    __slots__ = ("_axle_ratio", "_damping", "_stiffness", "_x_m", "_y_m")

    def __init__(self, *, rim_mass_kg: float, axle_ratio: float) -> None:
        self._axle_ratio = axle_ratio
        self._stiffness = TREAD_STIFFNESS * rim_mass_kg / TICK_SECONDS**2
        self._damping = TREAD_DAMPING * rim_mass_kg / TICK_SECONDS
        self._x_m = self._y_m = 0.0

    def force(self, slip_x: float, slip_y: float, limit: float) -> tuple[float, float]:
        """Return the ground's force on the tyre in this tick, N, forward and to the left.

        Parameters
        ----------
        slip_x, slip_y
            velocity of the tread over the ground, m/s, in rolling direction and to the left.
        limit
            friction times load, N: the most that it holds in rolling direction.
        """
        if limit <= 0.0:
            self._x_m = self._y_m = 0.0
            return 0.0, 0.0
        # In coordinates where the ellipse of friction is a circle; the flow rule of plasticity.
        ratio, stiffness, damping = self._axle_ratio, self._stiffness, self._damping
        x = self._x_m + slip_x * TICK_SECONDS
        y = self._y_m + slip_y * ratio * TICK_SECONDS
        fx = -stiffness * x - damping * slip_x
        fy = -stiffness * y - damping * slip_y * ratio
        size = sqrt(fx * fx + fy * fy)
        if size > limit:
            fx *= limit / size
            fy *= limit / size
            # A tread that slips is bent by the force that it carries.
            x = -fx / stiffness
            y = -fy / stiffness
        self._x_m, self._y_m = x, y
        return fx, fy * ratio
