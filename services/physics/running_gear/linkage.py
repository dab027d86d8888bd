# SPDX-License-Identifier: Apache-2.0
"""Arms between body and wheels: rockers and bogies that swing freely, and the bar between two.

To the backend an arm is a link with mass on a joint about y. What the ground does to a wheel is
applied to the base and, as a generalized force, to the joints of all arms that carry the wheel. The
differential bar is a stiff spring that holds the sum of both angles at zero: its torque acts on
both arms, and the backend turns the base the other way. `linkage.c` computes them.
"""

from ctypes import POINTER, Structure, addressof, c_double, c_int32, c_size_t, c_void_p, pointer

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.joints import Arm
from groundlink.scenario.vehicle import VehicleModel

BAR_STIFFNESS = 0.3
"""Stiffness of the differential bar in units of an arm's moment of inertia over the tick squared:
it gives way by less than a degree, and an explicit step is stable."""

BAR_DAMPING = 0.2
"""Damping in units of that moment over the tick."""

_VECTOR = c_double * 3


class SwingingArm(Structure):
    """One arm at rest."""

    _fields_ = (
        ("_parent", c_void_p),
        ("_pivot", _VECTOR),
        ("angle_rad", c_double),
        ("_sine", c_double),
        ("_cosine", c_double),
        ("_rate", c_double),
        ("at_m", _VECTOR),
        ("_moves", c_double * 2),
        ("_torque", c_double),
    )
    angle_rad: float
    """From the base, about y."""

    def __init__(self, arm: Arm, parent: "SwingingArm | None") -> None:
        self._carrier = parent
        super().__init__(
            parent and addressof(parent),
            _VECTOR(*arm.pivot_m),
            _cosine=1.0,
            at_m=_VECTOR(*arm.pivot_m),
        )


class ArmLinkage(Structure):
    """The arms of one vehicle."""

    _fields_ = (
        ("_arms", POINTER(POINTER(SwingingArm))),
        ("count", c_size_t),
        ("_coupled", c_int32 * 2),
        ("_stiffness", c_double),
        ("_damping", c_double),
    )
    count: int

    def __init__(self, model: VehicleModel) -> None:
        found: dict[str | None, SwingingArm] = {}
        for arm in model.arms:
            found[arm.name] = SwingingArm(arm, found.get(arm.parent))
        self.arms = list(found.values())
        self.by_wheel = {wheel: found[arm.name] for arm in model.arms for wheel in arm.wheels}
        self._kept = (POINTER(SwingingArm) * len(self.arms))(*map(pointer, self.arms))
        pair = (model.linkage.differential if model.linkage else None) or ()
        names = [arm.name for arm in model.arms]
        coupled = [names.index(name) for name in pair] or [-1, -1]
        inertia = min((arm.inertia_kgm2 for arm in model.arms if arm.name in pair), default=0.0)
        super().__init__(
            self._kept,
            len(self.arms),
            (c_int32 * 2)(*coupled),
            BAR_STIFFNESS * inertia / TICK_SECONDS**2,
            BAR_DAMPING * inertia / TICK_SECONDS,
        )


def carried_by(model: VehicleModel, name: str) -> list[Arm]:
    """Return an arm and all arms that it carries."""
    found: list[Arm] = []
    for arm in model.arms:
        if arm.name == name or arm.parent in [outer.name for outer in found]:
            found.append(arm)
    return found


def balance_rows(model: VehicleModel) -> list[tuple[list[float], float]]:
    """Return what the loads of the wheels' springs must balance: coefficients and sum, in kg m.

    An arm's own weight and the loads on it have no moment about its pivot; of two coupled arms the
    moments are equal.
    """
    rows: dict[str, tuple[list[float], float]] = {}
    for arm in model.arms:
        outer, pivot_x = carried_by(model, arm.name), arm.pivot_m[0]
        carried = {wheel for part in outer for wheel in part.wheels}
        arms = [
            wheel.center_m[0] - pivot_x if wheel.name in carried else 0.0 for wheel in model.wheels
        ]
        weights = sum(part.mass_kg * (part.mass_center_m[0] - pivot_x) for part in outer)
        rows[arm.name] = arms, weights
    found: list[tuple[list[float], float]] = []
    if model.linkage and (pair := model.linkage.differential):
        (one, of_one), (other, of_other) = (rows.pop(name) for name in pair)
        found.append(([a - b for a, b in zip(one, other, strict=True)], of_one - of_other))
    return found + list(rows.values())
