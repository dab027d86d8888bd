# SPDX-License-Identifier: Apache-2.0
"""Wheels that sink where the ground is soil: thrust by slip, resistance, sinkage, ruts.

On firm ground a wheel has the tire of its vehicle, to the bit. On soil its tread leaves the ground
as it rolls, so that its steady forces are those of `services.physics.soil` at this load, slip and
rut. At standstill, tread and soil are springs up to the same limits, which hold a vehicle on a
slope. `soil_wheel.c` computes them.
"""

from collections import defaultdict
from collections.abc import Sequence
from ctypes import POINTER, Structure, addressof, c_double, c_int32, c_void_p
from itertools import pairwise

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.running_gear import Tracked, Wheel
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Soil
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.dynamics.bodies import pointers
from services.physics.dynamics.ground import FIRM
from services.physics.soil.table import SoilTable, tire_table, track_table, wheel_table
from services.physics.soil.tire import InflatedTire
from services.physics.soil.track import TrackSection
from services.physics.soil.wheel import DEEPEST

from .tire import TREAD_STIFFNESS

LINKS = 6.0
"""Diameter of a road wheel over the pitch of the links, where the pitch is unknown."""


class SoilWheel(Structure):
    """A wheel in a world with soils.

    Parameters
    ----------
    tables
        for each soil, of a vehicle that drives forward and of one that drives backward.
    borne_kg
        the mass that rests on the wheel on level ground.
    """

    MEMORY = (
        *("_tread_mps", "_rut", "slip", "sinkage_m", "_drag_m", "_drag_n"),
        *("_soil", "_under", "_mapped"),
    )

    _fields_ = (
        ("_tables", POINTER(POINTER(SoilTable))),
        ("_leaders", c_void_p * 2),
        ("_apart_m", c_double * 2),
        ("_width_m", c_double),
        ("_digging_m", c_double),
        ("_deepest_m", c_double),
        ("_spring_npm", c_double),
        ("_firm_ratio", c_double),
        ("_travel_m", c_double),
        ("_stop_npm", c_double),
        ("_swivels", c_int32),
        ("_tread_mps", c_double),
        ("_rut", c_double),
        ("slip", c_double),
        ("sinkage_m", c_double),
        ("_drag_m", c_double),
        ("_drag_n", c_double),
        ("_soil", c_double),
        ("_under", c_double),
        ("_mapped", c_double),
        ("_ahead_m", c_double * 2),
    )
    slip: float
    """Of its tread, in the direction of travel, as `WheelInSoil` has it."""

    sinkage_m: float

    def __init__(
        self, model: VehicleModel, wheel: Wheel, tables: Sequence[SoilTable], *, borne_kg: float
    ) -> None:
        self._kept = pointers(tables)
        spring = wheel.suspension or model.suspension
        super().__init__(
            self._kept,
            _width_m=wheel.width_m,
            _digging_m=wheel.radius_m,
            _deepest_m=DEEPEST * wheel.radius_m,
            _spring_npm=spring.stiffness_npm,
            _firm_ratio=wheel.axle_friction_ratio,
            _travel_m=spring.travel_m,
            _stop_npm=TREAD_STIFFNESS * borne_kg / TICK_SECONDS**2,
            _swivels=wheel.caster,
            _soil=FIRM,
            _under=FIRM,
        )

    def run_behind(self, leader: "SoilWheel", way_m: float) -> None:
        """Make this wheel roll in the rut of another that is ahead; on the way back it leads."""
        for wheel, other, back in ((self, leader, 0), (leader, self, 1)):
            wheel._leaders[back], wheel._apart_m[back] = addressof(other), way_m

    @property
    def is_in_soil(self) -> bool:
        """Whether it stood on soil in the last tick."""
        return bool(self._soil != FIRM)


def soil_wheels(
    model: VehicleModel,
    borne_kg: Sequence[float],
    soils: Sequence[Soil],
    pitch_m: float | None,
    tire_pressure_pa: float | None = None,
) -> list[SoilWheel]:
    """Return the wheels of a vehicle in a world with soils, in the model's order.

    Parameters
    ----------
    borne_kg
        the mass that rests on each wheel on level ground.
    pitch_m
        of the links of a track; None: unknown.
    tire_pressure_pa
        of all inflated tires; None: that of each wheel.
    """
    wheels = []
    for wheel, mass in zip(model.wheels, borne_kg, strict=True):
        load_n = mass * GRAVITY_MPS2
        tables: list[SoilTable] = []
        for soil in soils:
            if isinstance(model.drive, Tracked):
                tables += [track_table(soil, t, load_n) for t in _sections(model, wheel, pitch_m)]
            elif wheel.inflation:
                air_pa = tire_pressure_pa or wheel.inflation.pressure_pa
                pressure_pa = air_pa + wheel.inflation.carcass_pa
                tire = InflatedTire(wheel.radius_m, wheel.width_m, pressure_pa)
                tables += [tire_table(soil, tire, load_n)] * 2
            else:
                tables += [wheel_table(soil, wheel.radius_m, wheel.width_m, load_n)] * 2
        wheels.append(SoilWheel(model, wheel, tables, borne_kg=mass))
    lines: dict[int, list[tuple[float, SoilWheel]]] = defaultdict(list)
    for wheel, in_soil in zip(model.wheels, wheels, strict=True):
        x, y, _ = wheel.center_m
        lines[round(y / wheel.width_m)].append((x, in_soil))
    for line in lines.values():
        for (x, in_soil), (next_x, leader) in pairwise(sorted(line, key=lambda place: place[0])):
            if next_x > x:
                in_soil.run_behind(leader, next_x - x)
    return wheels


def _sections(
    model: VehicleModel, wheel: Wheel, pitch_m: float | None
) -> tuple[TrackSection, TrackSection]:
    """Return the section of a track around a road wheel, for both directions of travel."""
    x, y, _ = wheel.center_m
    beside = [w.center_m[0] for w in model.wheels if w.center_m[1] * y > 0.0 and model.stands_on(w)]
    front, rear = max(beside), min(beside)
    length = (front - rear) / max(len(beside) - 1, 1) or wheel.radius_m
    diameter = 2 * wheel.radius_m
    pitch = pitch_m or diameter / LINKS
    return (
        TrackSection(wheel.width_m, length, max(front - x, 0.0), diameter, pitch),
        TrackSection(wheel.width_m, length, max(x - rear, 0.0), diameter, pitch),
    )
