# SPDX-License-Identifier: Apache-2.0
"""Soil that gives way under wheels and tracks: parameters of Bekker, Wong, Janosi and Hanamoto.

Plain data. `services.physics.soil` computes sinkage and forces.
"""

from typing import Annotated

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec


class Soil(Spec, frozen=True, kw_only=True):
    """Mechanical parameters of a homogeneous soil, as a bevameter measures them."""

    k_c: NonNegative
    """Cohesive modulus of sinkage by Bekker, N/m^(n+1)."""

    k_phi: Positive
    """Frictional modulus of sinkage by Bekker, N/m^(n+2)."""

    n: Annotated[float, Meta(gt=0, le=2)]
    """Exponent of sinkage: the pressure under a plate of width b at depth z is
    (k_c / b + k_phi) z^n."""

    cohesion_pa: NonNegative
    """Cohesion c of the Mohr-Coulomb criterion."""

    friction_angle_deg: Annotated[float, Meta(ge=0, lt=60)]
    """Angle of internal friction phi."""

    shear_displacement_m: Positive
    """K by Janosi and Hanamoto: the displacement at which 63 % of the shear strength act."""

    density_kgpm3: Positive
    """Bulk density, for the passive pressure on the side of a wheel."""

    unloading_npm3: NonNegative = 0.0
    """k_0 by Wong: stiffness of unloading and reloading at no depth. The stiffness at depth z is
    k_0 + A_u z; zero for both: the soil does not rebound."""

    unloading_npm4: NonNegative = 0.0
    """A_u by Wong."""

    stress_angle: Annotated[float, Meta(ge=0, lt=1)] = 0.4
    """c_1 by Wong and Reece: the angle of the largest radial stress on a wheel without slip, as a
    share of the entry angle."""

    stress_angle_by_slip: Annotated[float, Meta(ge=0, lt=1)] = 0.3
    """c_2 by Wong and Reece: growth of that share with slip."""

    slip_sinkage: Annotated[float, Meta(ge=0, le=2)] = 1.0
    """Share of the slip-sinkage by Lyasko, which multiplies the sinkage of a plate by
    (1 + s) / (1 - s / 2) at a slip s; 0: sinkage by load alone."""

    def __post_init__(self) -> None:
        if self.stress_angle + self.stress_angle_by_slip >= 1.0:
            raise ValueError(
                "`stress_angle` and `stress_angle_by_slip` add up to 1 or more; expected less"
            )
