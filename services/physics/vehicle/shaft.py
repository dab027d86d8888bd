# SPDX-License-Identifier: Apache-2.0
"""Shaft: wheels that turn together, their motor and the grip of their tires.

Solved implicitly, so that neither a light wheel nor a stiff tread makes it oscillate. A motor holds
its target speed within its torque.
"""

from collections.abc import Sequence

from groundlink.core.clock import TICK_SECONDS

from .tire import Tire

STEPS = 40
"""Most iterations of Newton's method; it usually takes three."""

SLOW_RADPS = 0.05
"""Speed below which rolling resistance fades, so that it does not hold the shaft."""


class TurningShaft:
    """One shaft.

    Parameters
    ----------
    tires
        of its wheels.
    radius_m
        ratio of the treads' speed to the shaft's.
    inertia_kgm2
        of all turning parts, seen from the shaft.
    damping_nmsprad
        of its bearings, seen from the shaft.
    """

    MEMORY = ("angle_rad", "speed_radps", "tread_mps", "torque_nm")

    __slots__ = (
        "_damping",
        "_radius",
        "angle_rad",
        "inertia_kgm2",
        "speed_radps",
        "tires",
        "torque_nm",
        "tread_mps",
    )

    def __init__(
        self, tires: Sequence[Tire], *, radius_m: float, inertia_kgm2: float, damping_nmsprad: float
    ) -> None:
        self.tires = tuple(tires)
        self._radius = radius_m
        self._damping = damping_nmsprad
        self.inertia_kgm2 = inertia_kgm2
        self.angle_rad = self.speed_radps = self.tread_mps = 0.0
        self.torque_nm = 0.0
        """Of the motor in the last tick."""

    def roll(self, tread_mps: float) -> None:
        """Set the speed to that of treads, whose deflections are gone."""
        self.tread_mps = tread_mps
        self.speed_radps = tread_mps / self._radius
        for tire in self.tires:
            tire.lift()

    def turn(self, asked_radps: float, least_nm: float, most_nm: float) -> None:
        """Advance by a tick toward a target speed, within torque limits."""
        before, radius = self.speed_radps, self._radius
        damping = self._damping
        if resisting := sum([tire.resisting_n for tire in self.tires]):
            damping += resisting * radius / max(abs(before), SLOW_RADPS)
        inertia = self.inertia_kgm2 / TICK_SECONDS
        speed = asked_radps
        grip = 0.0
        for tire in self.tires:
            grip += tire.along(speed * radius)[0]
        torque = inertia * (speed - before) + damping * speed + radius * grip
        if not least_nm <= torque <= most_nm:
            torque = min(max(torque, least_nm), most_nm)
            speed = self._driven_by(torque, inertia, damping)
        self.torque_nm = torque
        self.speed_radps = speed
        self.angle_rad += speed * TICK_SECONDS
        self.tread_mps = speed * radius

    def _driven_by(self, torque: float, inertia: float, damping: float) -> float:
        """Return the speed after a tick with a torque of the motor."""
        before, radius = self.speed_radps, self._radius
        gripping = [tire for tire in self.tires if tire.limit_n > 0.0]
        most = radius * sum([tire.limit_n for tire in gripping])
        # The treads push or brake with at most their grip.
        low = (inertia * before + torque - most) / (inertia + damping)
        high = low + 2 * most / (inertia + damping)
        speed = (low + high) / 2
        if gripping:
            # Start where the treads neither push nor brake: from there their force rises ever less.
            rolling = sum([tire.rolling_mps for tire in gripping]) / (radius * len(gripping))
            speed = min(max(rolling, low), high)
        for _ in range(STEPS):
            excess = inertia * (speed - before) + damping * speed - torque
            slope = inertia + damping
            for tire in gripping:
                force, firmness = tire.along(speed * radius)
                excess += radius * force
                slope += radius * radius * firmness
            if abs(excess) < 1e-9 * slope:
                break
            if excess > 0.0:
                high = speed
            else:
                low = speed
            speed -= excess / slope
            if not low <= speed <= high:
                speed = (low + high) / 2
        return speed
