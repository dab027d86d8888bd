# SPDX-License-Identifier: Apache-2.0
"""Tire models: dry friction with an elastic tread, whose state is the tread's deflection.

Bullet's own friction acts along the axes of the world: a skid-steered vehicle turns up to twice as
fast on one heading as on another (measured, with and without its friction cone). Here friction is
Coulomb's, the same in every direction of the ground unless the tire has an `axle_ratio`. While it
sticks, the tread is a spring and damper and does not creep; it slips at its friction limit. A
creeping tire slips below that limit, too, while it rolls.
"""

from math import atan, cbrt, hypot, sin, sqrt
from typing import ClassVar

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.vehicle import TireSlip

TREAD_STIFFNESS = 0.02
"""Tangential stiffness in units of the mass on the wheel over the tick squared. A vehicle swings at
9 Hz on its treads, which is stable in an explicit step. The rover's comes to 44 kN/m, of the order
of a small pneumatic tire's; at 135 N it deflects by 3 mm before it slips."""

TREAD_DAMPING = 0.15
"""Damping in units of that mass over the tick: half of what stops a swing at once."""


SMALL = 1e-3
"""Share of the limit below which force is linear in slip."""


class Tire:
    """One tire.

    Parameters
    ----------
    borne_kg
        mass that rests on it.
    axle_ratio
        friction along the axle as a share of that in the rolling direction.
    """

    MEMORY: ClassVar[tuple[str, ...]] = (
        *("_along_n", "_aside_n", "_x_m", "_y_m"),
        *("firmness", "limit_n", "resisting_n"),
    )

    __slots__ = (
        "_along_n",
        "_aside_n",
        "_axle_ratio",
        "_sticking",
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
        self._sticking = self._stiffness * TICK_SECONDS + TREAD_DAMPING * borne_kg / TICK_SECONDS
        """Force per m/s of the tread's deflection in a tick, N s/m."""

        self.firmness = self._sticking
        """Force per m/s of slip in a tick below the limit, N s/m."""

        self.limit_n = 0.0
        """Friction times load; 0 off the ground."""

        self._x_m = self._y_m = 0.0
        self.lift()

    def lift(self) -> None:
        """Take it off the ground: no grip, no deflection."""
        self._x_m = self._y_m = self._along_n = self._aside_n = self.limit_n = 0.0
        self.resisting_n = 0.0

    def meet(
        self,
        forward_mps: float,
        left_mps: float,
        limit_n: float,
        resisting_n: float = 0.0,
        load_n: float = 0.0,
    ) -> None:
        """Set the motion of the wheel's hub over the ground in this tick.

        Parameters
        ----------
        limit_n
            friction times load: the largest force in the rolling direction.
        resisting_n
            rolling resistance, which acts on its shaft.
        load_n
            of the tire; only one that creeps needs it.
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
            slip = -(forward + stiffness * self._x_m) / self._sticking
            self._x_m += slip * TICK_SECONDS
            slip = -(aside + stiffness * self._y_m) / self._sticking
            self._y_m += slip * TICK_SECONDS
        return forward, aside * self._axle_ratio


class CreepingTire(Tire):
    """A tire whose tread leaves the ground as it rolls: the brush model, alike in all directions.

    At a steady slip its force is that of Pacejka, Tire and Vehicle Dynamics (2012), section 3.2:
    with s the slip over the rolling speed, F = L (1 - (1 - C s / 3 L)^3) up to the limit L. The
    deflection follows with a relaxation length of C over the tread's stiffness.
    """

    MEMORY = (*Tire.MEMORY, "_rolling_mps")

    __slots__ = ("_rolling_mps", "_slip")

    def __init__(self, slip: TireSlip, *, borne_kg: float, axle_ratio: float) -> None:
        super().__init__(borne_kg=borne_kg, axle_ratio=axle_ratio)
        self._slip = slip
        self._rolling_mps = 0.0

    def meet(
        self,
        forward_mps: float,
        left_mps: float,
        limit_n: float,
        resisting_n: float = 0.0,
        load_n: float = 0.0,
    ) -> None:
        """Set the motion of the wheel's hub over the ground in this tick; see `Tire`."""
        self.firmness = self._sticking
        super().meet(forward_mps, left_mps, limit_n, resisting_n)
        if limit_n <= 0.0 or self._rolling_mps == 0.0:
            return
        # The tread deflects by what is left of the slip after the creep that its force causes.
        creep = self._sticking * self._rolling_mps / self._secant_n(load_n, limit_n)
        along, aside = 1 / (1 + creep), 1 / (1 + creep * self._axle_ratio**2)
        self._along_n *= along
        self._aside_n *= aside
        self.firmness *= along

    def _secant_n(self, load_n: float, limit_n: float) -> float:
        """Return force over slip at the force of the last tick, N."""
        slip = self._slip
        stiffness = slip.cornering_stiffness_nprad * sin(2 * atan(load_n / slip.load_n))
        used = min(self._stiffness * hypot(self._x_m, self._y_m) / limit_n, 1.0)
        if used < SMALL:
            return stiffness
        return stiffness * used / (3 * (1 - cbrt(1 - used)))

    def settle(self, tread_mps: float) -> tuple[float, float]:
        """Return the ground's force on the tire, N, forward and to the left; update the tread."""
        self._rolling_mps = abs(tread_mps)
        return super().settle(tread_mps)
