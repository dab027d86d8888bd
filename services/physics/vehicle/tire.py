# SPDX-License-Identifier: Apache-2.0
"""Tire model: dry friction with an elastic tread. Its only state is the tread's deflection.

Bullet's own friction acts along the axes of the world: a skid-steered vehicle turns up to twice as
fast on one heading as on another (measured, with and without its friction cone). Here friction is
Coulomb's, the same in every direction of the ground unless the tire has an `axle_ratio`. While it
sticks, the tread is a spring and damper and does not creep; it slips at its friction limit.
"""

from math import sqrt

from groundlink.core.clock import TICK_SECONDS

TREAD_STIFFNESS = 0.02
"""Tangential stiffness in units of the mass on the wheel over the tick squared. A vehicle swings at
9 Hz on its treads, which is stable in an explicit step. The rover's comes to 44 kN/m, of the order
of a small pneumatic tire's; at 135 N it deflects by 3 mm before it slips."""

TREAD_DAMPING = 0.15
"""Damping in units of that mass over the tick: half of what stops a swing at once."""


class Tire:
    """One tire.

    Parameters
    ----------
    borne_kg
        mass that rests on it.
    axle_ratio
        friction along the axle as a share of that in the rolling direction.
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
        """Force per m/s of slip in a tick while it sticks, N s/m."""

        self.limit_n = 0.0
        """Friction times load; 0 off the ground."""

        self._x_m = self._y_m = 0.0
        self.lift()

    def lift(self) -> None:
        """Take it off the ground: no grip, no deflection."""
        self._x_m = self._y_m = self._along_n = self._aside_n = self.limit_n = 0.0
        self.resisting_n = 0.0

    def meet(
        self, forward_mps: float, left_mps: float, limit_n: float, resisting_n: float = 0.0
    ) -> None:
        """Set the motion of the wheel's hub over the ground in this tick.

        Parameters
        ----------
        limit_n
            friction times load: the largest force in the rolling direction.
        resisting_n
            rolling resistance, which acts on its shaft.
        """
        # In coordinates where the friction ellipse is a circle.
        self._along_n = -self._stiffness * self._x_m - self.firmness * forward_mps
        self._aside_n = -self._stiffness * self._y_m - self.firmness * left_mps * self._axle_ratio
        self.limit_n = limit_n
        self.resisting_n = resisting_n

    @property
    def deflection_m(self) -> tuple[float, float]:
        """Deflection of the tread, forward and to the left."""
        return self._x_m, self._y_m

    @deflection_m.setter
    def deflection_m(self, deflection_m: tuple[float, float]) -> None:
        self._x_m, self._y_m = deflection_m

    @property
    def rolling_mps(self) -> float:
        """Speed of the tread at which it neither pushes nor brakes."""
        return -self._along_n / self.firmness

    def along(self, tread_mps: float) -> tuple[float, float]:
        """Return the forward force, N, at a speed of the tread, and its derivative, N s/m."""
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
        """Return the ground's force on the tire, N, forward and to the left; update the tread."""
        limit, stiffness = self.limit_n, self._stiffness
        if limit <= 0.0:
            self.lift()
            return 0.0, 0.0
        forward, aside = self._along_n + self.firmness * tread_mps, self._aside_n
        size = sqrt(forward * forward + aside * aside)
        if size > limit:
            forward *= limit / size
            aside *= limit / size
            # A slipping tread is deflected by the force that it carries.
            self._x_m, self._y_m = -forward / stiffness, -aside / stiffness
        else:
            # Deflection at the tick's start, and the slip since then.
            slip = -(forward + stiffness * self._x_m) / self.firmness
            self._x_m += slip * TICK_SECONDS
            slip = -(aside + stiffness * self._y_m) / self.firmness
            self._y_m += slip * TICK_SECONDS
        return forward, aside * self._axle_ratio
