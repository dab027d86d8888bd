# SPDX-License-Identifier: Apache-2.0
"""Standing water: lift, drag and splash of a vehicle, and motors that drown; see `water.c`.

Each part of the vehicle below the surface is lifted by the weight of the water that it displaces,
and dragged along each of its axes by rho / 2 C_D A v^2, with the area A of the part below the
surface across the axis. The surface stays level: there are no waves, and no mass of water moves
with the vehicle.

- A wheel has C_D = 0.75 on its width times its depth, the drag of a tire that displaces the water
  on a runway (EASA, CS-25, AMC 25.1591, "fluid displacement drag"). So it is the resistance of
  splashing in a shallow puddle, too. Wheels in one track share it: water that the first has
  displaced is gone.
- The hull, the box of the chassis, has C_D = 1.05, that of a cube (Hoerner, "Fluid-Dynamic Drag",
  1965), in four columns along x and two along y, so that it rights itself and is slowed as it
  turns.

Tires are full of air. Road wheels of tracks displace what steel of their mass does.
"""

from collections.abc import Sequence
from ctypes import POINTER, Structure, c_double, c_size_t, cast
from math import inf, pi

from msgspec import UnsetType

from groundlink.messages.ground_truth import InWater
from groundlink.scenario.running_gear import Tracked
from groundlink.scenario.vehicle import VehicleModel
from groundlink.scenario.vehicle import Wading as WadingSpec
from groundlink.world.cover import WaterArea

STEEL_KGPM3 = 7850.0


class _Area(Structure):
    """The structure `water_area` of `water.h`."""

    _fields_ = (("low_m", c_double * 2), ("high_m", c_double * 2), ("level_m", c_double))


class _Wheel(Structure):
    """The structure `wading_wheel` of `water.h`."""

    _fields_ = (("width_m", c_double), ("drag_share", c_double), ("tightness", c_double))


class VehicleInWater(Structure):
    """Water around one vehicle.

    Parameters
    ----------
    model
    areas
        all water of the world.
    """

    MEMORY = ("depth_m", "drowned")

    _fields_ = (
        ("_areas", POINTER(_Area)),
        ("_area_count", c_size_t),
        ("_wheels", POINTER(_Wheel)),
        ("_low_m", c_double * 3),
        ("_high_m", c_double * 3),
        ("_tightness", c_double),
        ("_limit_m", c_double),
        ("depth_m", c_double),
        ("drowned", c_double),
    )
    depth_m: float
    """Depth of the lowest point of the deepest wheel below the surface in the last tick."""

    drowned: float
    """1 from the tick on in which the water was too deep for the motors, 0 before."""

    def __init__(self, model: VehicleModel, areas: Sequence[WaterArea]) -> None:
        wading = WadingSpec() if isinstance(model.wading, UnsetType) else model.wading
        chassis = model.chassis
        volume_m3 = chassis.size_m[0] * chassis.size_m[1] * chassis.size_m[2]
        displaced_m3 = volume_m3 if wading.displaced_m3 is None else wading.displaced_m3
        ends = [
            (middle - size / 2, middle + size / 2)
            for middle, size in zip(chassis.center_m, chassis.size_m, strict=True)
        ]
        self._kept = (
            (_Area * len(areas))(*(_Area(a.low_m, a.high_m, a.level_m) for a in areas)),
            (_Wheel * len(model.wheels))(*(_Wheel(*row) for row in _wheels(model))),
        )
        super().__init__(
            *(cast(self._kept[0], POINTER(_Area)), len(areas)),
            cast(self._kept[1], POINTER(_Wheel)),
            *((c_double * 3)(*(end[side] for end in ends)) for side in (0, 1)),
            *(displaced_m3 / volume_m3, inf if wading.depth_m is None else wading.depth_m),
        )

    def report(self) -> InWater | None:
        """Return depth and state of the motors; None for a dry vehicle that has not drowned."""
        if not (self.depth_m or self.drowned):
            return None
        return InWater(self.depth_m, bool(self.drowned))


def _wheels(model: VehicleModel) -> list[tuple[float, float, float]]:
    """Return width, share of the drag and tightness of each wheel."""
    found = []
    for wheel in model.wheels:
        in_track = [
            other
            for other in model.wheels
            if abs(other.center_m[1] - wheel.center_m[1]) < wheel.width_m / 2
        ]
        tightness = 1.0
        if isinstance(model.drive, Tracked):
            disc_m3 = pi * wheel.radius_m**2 * wheel.width_m
            tightness = min(1.0, wheel.mass_kg / STEEL_KGPM3 / disc_m3)
        found.append((wheel.width_m, 1.0 / len(in_track), tightness))
    return found
