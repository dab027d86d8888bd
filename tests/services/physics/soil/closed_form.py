# SPDX-License-Identifier: Apache-2.0
"""Rigid wheel in soil by Bekker, Wong, Reece, Janosi and Hanamoto, integrated by SciPy.

Written from the formulas alone; it shares no code with the model.
"""

from dataclasses import dataclass
from math import acos, cos, exp, radians, sin, sqrt, tan

from scipy.integrate import quad
from scipy.optimize import brentq

from groundlink.world.solids import Soil


@dataclass(frozen=True)
class RigidWheel:
    soil: Soil
    radius: float
    width: float
    slip: float

    @property
    def modulus(self) -> float:
        s = abs(self.slip)
        lyasko = 1 + self.soil.slip_sinkage * ((1 + s) / (1 - s / 2) - 1)
        return float((self.soil.k_c / self.width + self.soil.k_phi) / lyasko**self.soil.n)

    def radial(self, angle: float, entry: float) -> float:
        share = self.soil.stress_angle + self.soil.stress_angle_by_slip * abs(self.slip)
        if angle < share * entry:
            angle = entry - angle * (1 - share) / share
        height = max(self.radius * (cos(angle) - cos(entry)), 0.0)
        return float(self.modulus * height**self.soil.n)

    def shear(self, angle: float, entry: float) -> float:
        s = self.slip
        hub = 1 - s if s >= 0 else 1 / (1 + s)
        moved = self.radius * (entry - angle - hub * (sin(entry) - sin(angle)))
        most = self.soil.cohesion_pa + self.radial(angle, entry) * tan(
            radians(self.soil.friction_angle_deg)
        )
        used = most * (1 - exp(-abs(moved) / self.soil.shear_displacement_m))
        return used if moved > 0 else -used

    def integral(self, entry: float, radial: bool, tangential: bool, upward: bool) -> float:
        def stress(angle: float) -> float:
            along, across = (sin(angle), cos(angle)) if upward else (cos(angle), -sin(angle))
            total = self.radial(angle, entry) * across if radial else 0.0
            return total + (self.shear(angle, entry) * along if tangential else 0.0)

        share = self.soil.stress_angle + self.soil.stress_angle_by_slip * abs(self.slip)
        found = quad(stress, 0.0, entry, points=[share * entry], limit=200)[0]
        return float(self.radius * self.width * found)

    def sinkage(self, load: float) -> float:
        entry = brentq(lambda e: self.integral(e, True, True, True) - load, 1e-4, 1.5)
        return self.radius * (1 - cos(float(entry)))

    def drawbar(self, sinkage: float) -> float:
        return self.integral(acos(1 - sinkage / self.radius), True, True, False)

    def torque(self, sinkage: float) -> float:
        entry = acos(1 - sinkage / self.radius)
        found = quad(lambda angle: self.shear(angle, entry), 0.0, entry, limit=200)[0]
        return float(self.radius**2 * self.width * found)


def bekker_sinkage(soil: Soil, radius: float, width: float, load: float) -> float:
    """Return the sinkage of a towed wheel by Bekker's formula."""
    k = (soil.k_c / width + soil.k_phi) * width * sqrt(2 * radius)
    return float((3 * load / ((3 - soil.n) * k)) ** (2 / (2 * soil.n + 1)))
