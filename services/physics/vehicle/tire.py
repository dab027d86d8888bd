# SPDX-License-Identifier: Apache-2.0
"""The grip of a tire on the ground: dry friction with an elastic tread.

Rule: pure; motion over the ground and load in, force out, and the tread's deflection is all that is
remembered.

Bullet's own friction acts along the axes of the world, so that a skid-steered vehicle turns up to
twice as fast on one heading as on another (measured, with and without its friction cone). Here the
law is Coulomb's, the same in every direction of the ground unless the tire says otherwise: while it
sticks, the tread is a spring and damper and holds without creeping; it slips at the limit of its
load.
"""

from __future__ import annotations

from math import sqrt

from groundlink.core.clock import TICK_SECONDS

TREAD_STIFFNESS = 0.02
"""Tangential, in units of the mass that rests on the wheel over the tick squared: a vehicle that
rests on its treads swings at 9 Hz, which an explicit step bears though it rolls and yaws more
easily than it slides. The rover's comes to 44 kN/m, of the order of a small pneumatic tire's; at
135 N it gives way by 3 mm before it slips."""

TREAD_DAMPING = 0.15
"""Likewise, in units of that mass over the tick: half of what stops a swing at once."""


class Tire:
    """One tire.

    Parameters
    ----------
    borne_kg
        the mass that rests on it.
    axle_ratio
        friction along the axle as a share of that in rolling direction.
    """

    __slots__ = (
        "_along_n",
        "_aside_n",
        "_axle_ratio",
        "_stiffness",
        "_x_m",
        "_y_m",
        "firmness",
        "limit_n",
        "resisting_n",
    )

    def __init__(self, *, borne_kg: float, axle_ratio: float) -> None:
        self._axle_ratio = axle_ratio
        self._stiffness = TREAD_STIFFNESS * borne_kg / TICK_SECONDS**2
        self.firmness = self._stiffness * TICK_SECONDS + TREAD_DAMPING * borne_kg / TICK_SECONDS
        """Force for each m/s of slip in a tick while it sticks, N s/m."""

        self.limit_n = 0.0
        """Friction times load: 0 off the ground."""

        self._x_m = self._y_m = 0.0
        self.lift()

    def lift(self) -> None:
        """Take it off the ground: there is no grip and no memory."""
        self._x_m = self._y_m = self._along_n = self._aside_n = self.limit_n = 0.0
        self.resisting_n = 0.0

    def meet(
        self, forward_mps: float, left_mps: float, limit_n: float, resisting_n: float = 0.0
    ) -> None:
        """Take how the wheel's hub moves over the ground in this tick.

        Parameters
        ----------
        limit_n
            friction times load: the most that it holds in rolling direction.
        resisting_n
            against rolling, which its shaft feels.
        """
        # In coordinates where the ellipse of friction is a circle.
        self._along_n = -self._stiffness * self._x_m - self.firmness * forward_mps
        self._aside_n = -self._stiffness * self._y_m - self.firmness * left_mps * self._axle_ratio
        self.limit_n = limit_n
        self.resisting_n = resisting_n

    @property
    def deflection_m(self) -> tuple[float, float]:
        """How far the tread is bent, forward and to the left."""
        return self._x_m, self._y_m

    @deflection_m.setter
    def deflection_m(self, deflection_m: tuple[float, float]) -> None:
        self._x_m, self._y_m = deflection_m

    @property
    def rolling_mps(self) -> float:
        """The speed of the tread at which it neither pushes nor brakes."""
        return -self._along_n / self.firmness

    def along(self, tread_mps: float) -> tuple[float, float]:
        """Return the force forward, N, at a speed of the tread, and its gain with it, N s/m."""
        forward, aside, limit = (
            self._along_n + self.firmness * tread_mps,
            self._aside_n,
            self.limit_n,
        )
        square = forward * forward + aside * aside
        if square <= limit * limit:
            return forward, self.firmness
        share = limit / sqrt(square)
        return forward * share, self.firmness * share * aside * aside / square

    def settle(self, tread_mps: float) -> tuple[float, float]:
        """Return the ground's force on the tire, N, forward and to the left, and remember it."""
        limit, stiffness = self.limit_n, self._stiffness
        if limit <= 0.0:
            self.lift()
            return 0.0, 0.0
        forward, aside = self._along_n + self.firmness * tread_mps, self._aside_n
        size = sqrt(forward * forward + aside * aside)
        if size > limit:
            forward *= limit / size
            aside *= limit / size
            # A tread that slips is bent by the force that it carries.
            self._x_m, self._y_m = -forward / stiffness, -aside / stiffness
        else:
            # What was sprung at the tick's begin, and the way that it slipped since then.
            slip = -(forward + stiffness * self._x_m) / self.firmness
            self._x_m += slip * TICK_SECONDS
            slip = -(aside + stiffness * self._y_m) / self.firmness
            self._y_m += slip * TICK_SECONDS
        return forward, aside * self._axle_ratio
