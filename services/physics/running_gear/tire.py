# SPDX-License-Identifier: Apache-2.0
"""Tire models: dry friction with an elastic tread, whose state is the tread's deflection.

Bullet's own friction acts along the axes of the world: a skid-steered vehicle turns up to twice as
fast on one heading as on another (measured, with and without its friction cone). Here friction is
Coulomb's, the same in every direction of the ground unless the tire has an `axle_ratio`. While it
sticks, the tread is a spring and damper and does not creep; it slips at its friction limit. A
creeping tire slips below that limit, too, while it rolls. `tire.c` computes it.
"""

from ctypes import Structure, byref, c_double

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.vehicle import TireSlip
from services.physics.dynamics.kernels import kernels

TREAD_STIFFNESS = 0.02
"""Tangential stiffness in units of the mass on the wheel over the tick squared. A vehicle swings at
9 Hz on its treads, which is stable in an explicit step. The rover's comes to 44 kN/m, of the order
of a small pneumatic tire's; at 135 N it deflects by 3 mm before it slips."""

TREAD_DAMPING = 0.15
"""Damping in units of that mass over the tick: half of what stops a swing at once."""


STICKING_MEMORY = (
    *("_along_n", "_aside_n", "_x_m", "_y_m"),
    *("firmness", "limit_n", "resisting_n"),
)
"""Inner state of a tire that does not creep."""


class Tire(Structure):
    """One tire.

    Parameters
    ----------
    borne_kg
        mass that rests on it.
    axle_ratio
        friction along the axle as a share of that in the rolling direction.
    slip
        how its tread creeps as it leaves the ground; None: it does not.

    The brush model of a creeping tire is alike in all directions. At a steady slip its force is
    that of Pacejka, Tire and Vehicle Dynamics (2012), section 3.2: with s the slip over the rolling
    speed, F = L (1 - (1 - C s / 3 L)^3) up to the limit L. The deflection follows with a relaxation
    length of C over the tread's stiffness.
    """

    _fields_ = (
        ("_axle_ratio", c_double),
        ("_axle_ratio_squared", c_double),
        ("_stiffness", c_double),
        ("_sticking", c_double),
        ("_cornering_stiffness", c_double),
        ("_slip_load_n", c_double),
        ("_along_n", c_double),
        ("_aside_n", c_double),
        ("_x_m", c_double),
        ("_y_m", c_double),
        ("firmness", c_double),
        ("limit_n", c_double),
        ("resisting_n", c_double),
        ("_rolling_mps", c_double),
    )
    firmness: float
    """Force per m/s of slip in a tick below the limit, N s/m."""

    limit_n: float
    """Friction times load; 0 off the ground."""

    resisting_n: float

    def __init__(self, *, borne_kg: float, axle_ratio: float, slip: TireSlip | None = None) -> None:
        self.MEMORY = STICKING_MEMORY if slip is None else (*STICKING_MEMORY, "_rolling_mps")
        stiffness = TREAD_STIFFNESS * borne_kg / TICK_SECONDS**2
        # Force per m/s of the tread's deflection in a tick, N s/m.
        sticking = stiffness * TICK_SECONDS + TREAD_DAMPING * borne_kg / TICK_SECONDS
        creep = (0.0, 0.0) if slip is None else (slip.cornering_stiffness_nprad, slip.load_n)
        super().__init__(axle_ratio, axle_ratio**2, stiffness, sticking, *creep, firmness=sticking)

    def lift(self) -> None:
        """Take it off the ground: no grip, no deflection."""
        kernels().tire_lift(byref(self))

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
        kernels().tire_meet(byref(self), forward_mps, left_mps, limit_n, resisting_n, load_n)

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
        rolling: float = -self._along_n / self.firmness
        return rolling

    def along(self, tread_mps: float) -> tuple[float, float]:
        """Return the forward force, N, at a speed of the tread, and its derivative, N s/m."""
        result = (c_double * 2)()
        kernels().tire_along(byref(self), tread_mps, result)
        return result[0], result[1]

    def settle(self, tread_mps: float) -> tuple[float, float]:
        """Return the ground's force on the tire, N, forward and to the left; update the tread."""
        result = (c_double * 2)()
        kernels().tire_settle(byref(self), tread_mps, result)
        return result[0], result[1]
