# SPDX-License-Identifier: Apache-2.0
"""Plots of terramechanics: wheels and tracks in soil, and vehicles on slopes of it."""

from functools import cache
from math import cos, exp, radians, sin, tan

import msgspec
import numpy as np
from matplotlib.figure import Figure

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.frames import Floats
from groundlink.loader.document import read
from groundlink.loader.material_library import soil_library
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Material, Soil
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.dynamics.bullet import BulletBackend
from services.physics.soil.table import track_table, wheel_table
from services.physics.soil.tire import InflatedTire, tire_forces, tire_sinkage
from services.physics.soil.track import TrackSection
from services.physics.soil.wheel import wheel_forces, wheel_sinkage
from services.physics.trials.track import drive, put

from .measured_wheel import MEASURED, SAND
from .measured_wheel import RADIUS_M as MEASURED_RADIUS_M
from .measured_wheel import WIDTH_M as MEASURED_WIDTH_M
from .page_style import GRAY, SERIES, label, side_by_side

RADIUS_M, WIDTH_M, LOAD_N = 0.1651, 0.1143, 135.0
"""A wheel of the rover."""

TIRE_RADIUS_M, TIRE_WIDTH_M, TIRE_N = 0.45, 0.3, 8e3
"""A tire of a light truck."""

SHOWN = ("lete_sand", "dry_sand", "clayey_soil_55")

ROAD_WHEELS, SPACING_M, TRACK_M, DIAMETER_M, PITCH_M, ROAD_WHEEL_N = (
    5,
    0.96,
    0.58,
    0.81,
    0.137,
    35e3,
)
"""A track of the tank."""


@cache
def _soils() -> dict[str, Soil]:
    return msgspec.convert(soil_library(), dict[str, Soil])


def wheel() -> Figure:
    """Sinkage, drawbar pull and resistance of a wheel over slip."""
    figure, (left, middle, right) = side_by_side(3)
    slips, dots = np.linspace(-0.3, 1.0, 131), np.linspace(-0.3, 1.0, 27)
    for name, color in zip(SHOWN, SERIES, strict=False):
        soil = _soils()[name]
        sunk = wheel_sinkage(soil, RADIUS_M, WIDTH_M, np.array(LOAD_N), slips)
        forces = wheel_forces(soil, RADIUS_M, WIDTH_M, sunk, slips)
        table = wheel_table(soil, RADIUS_M, WIDTH_M, LOAD_N)
        found = [table.at(LOAD_N, float(slip)) for slip in dots]
        shown = name.replace("_", " ")
        for axes, exact, values in (
            (left, 100 * sunk, [100 * r.sinkage_m for r in found]),
            (middle, forces.drawbar_n, [r.thrust_n - r.resistance_n for r in found]),
            (right, forces.resistance_n, [r.resistance_n for r in found]),
        ):
            axes.plot(slips, exact, color=color)
            axes.plot(dots, values, "o", color=color, markersize=2.5, label=shown)
    middle.axhline(0.0, color=GRAY, linewidth=0.8)
    label(left, "Wheel of the rover, 135 N", "slip", "sinkage, cm")
    label(middle, "Drawbar pull", "slip", "force, N")
    label(right, "Motion resistance", "slip", "force, N")
    middle.set_ylim(-100, 90)
    right.set_ylim(0, 100)
    left.legend()
    return figure


def measured() -> Figure:
    """Sinkage and drawbar pull of a wheel in sand as they were measured, and of the model."""
    figure, (left, right) = side_by_side(2)
    load = np.array(np.mean([row.load_n for row in MEASURED]))
    slips, dots = np.linspace(-0.75, 0.8, 156), [row.slip for row in MEASURED]
    sunk = wheel_sinkage(SAND, MEASURED_RADIUS_M, MEASURED_WIDTH_M, load, slips)
    forces = wheel_forces(SAND, MEASURED_RADIUS_M, MEASURED_WIDTH_M, sunk, slips)
    left.plot(slips, 1000 * sunk, color=SERIES[0], label="model")
    left.plot(
        dots, [1000 * row.sinkage_m for row in MEASURED], "o", color=SERIES[1], label="measured"
    )
    right.plot(slips, forces.drawbar_n / load, color=SERIES[0])
    right.errorbar(
        dots,
        [row.drawbar_n / row.load_n for row in MEASURED],
        [row.scatter_n / row.load_n for row in MEASURED],
        fmt="o",
        color=SERIES[1],
    )
    label(left, "Smooth wheel of 116 mm in sand, 24 N", "slip", "sinkage, mm")
    label(right, "Drawbar pull", "slip", "share of the load")
    left.legend()
    return figure


def tire() -> Figure:
    """Sinkage, motion resistance and drawbar pull of an inflated tire over its pressure."""
    figure, (left, middle, right) = side_by_side(3)
    pressures, load, slip = np.linspace(20e3, 400e3, 96), np.array(TIRE_N), np.array(0.15)
    for name, color in zip(SHOWN, SERIES, strict=False):
        soil = _soils()[name]
        tires = [InflatedTire(TIRE_RADIUS_M, TIRE_WIDTH_M, float(p)) for p in pressures]
        sunk = [tire_sinkage(soil, tire, load, slip) for tire in tires]
        found = [
            tire_forces(soil, tire, z, load, slip) for tire, z in zip(tires, sunk, strict=True)
        ]
        rigid = wheel_sinkage(soil, TIRE_RADIUS_M, TIRE_WIDTH_M, load, slip)
        of_rigid = wheel_forces(soil, TIRE_RADIUS_M, TIRE_WIDTH_M, rigid, slip)
        for axes, values, limit in (
            (left, [100 * float(z) for z in sunk], 100 * float(rigid)),
            (middle, [float(f.resistance_n) / 1e3 for f in found], of_rigid.resistance_n / 1e3),
            (right, [float(f.drawbar_n) / 1e3 for f in found], of_rigid.drawbar_n / 1e3),
        ):
            axes.plot(pressures / 1e3, values, color=color, label=name.replace("_", " "))
            axes.axhline(float(limit), color=color, linewidth=0.6, linestyle=":")
    label(left, "Tire of 0.9 x 0.3 m, 8 kN, slip 0.15", "pressure, kPa", "sinkage, cm")
    label(middle, "Motion resistance", "pressure, kPa", "force, kN")
    label(right, "Drawbar pull", "pressure, kPa", "force, kN")
    left.legend()
    return figure


def track() -> Figure:
    """Drawbar pull of a track over slip."""
    figure, (left, right) = side_by_side(2)
    slips = np.geomspace(1e-3, 0.5, 200)
    length = ROAD_WHEELS * SPACING_M
    sections = [
        TrackSection(TRACK_M, SPACING_M, i * SPACING_M, DIAMETER_M, PITCH_M)
        for i in range(ROAD_WHEELS)
    ]
    for name, color in zip(SHOWN, SERIES, strict=False):
        soil = _soils()[name]
        angle, k = radians(soil.friction_angle_deg), soil.shear_displacement_m
        most = TRACK_M * length * soil.cohesion_pa + ROAD_WHEELS * ROAD_WHEEL_N * tan(angle)
        closed = [most * (1 - k / (s * length) * (1 - exp(-s * length / k))) for s in slips]
        left.plot(slips, np.array(closed) / 1e3, color=color)
        dots, thrusts, pulls = slips[::8], [], []
        for slip in dots.tolist():
            rows = [
                track_table(soil, section, ROAD_WHEEL_N).at(ROAD_WHEEL_N, slip, float(i > 0))
                for i, section in enumerate(sections)
            ]
            thrusts.append(sum(row.thrust_n for row in rows) / 1e3)
            pulls.append(thrusts[-1] - sum(row.resistance_n for row in rows) / 1e3)
        left.plot(dots, thrusts, "o", color=color, markersize=2.5, label=name.replace("_", " "))
        right.plot(dots, pulls, "o-", color=color, markersize=2.5, label=name.replace("_", " "))
    for axes in (left, right):
        axes.set_xscale("log")
        axes.legend()
    label(left, "Track of the tank, five wheels of 35 kN: thrust", "slip", "force, kN")
    label(right, "Drawbar pull", "slip", "force, kN")
    return figure


@cache
def _rover() -> VehicleModel:
    return convert(read(SHIPPED / "vehicles" / "rover.yaml"), VehicleModel)


def _pull(soil: Soil, slips: Floats) -> Floats:
    """Return the rover's drawbar pull over its weight; wheels behind roll in ruts."""
    load = np.array(55.0 * GRAVITY_MPS2 / 4)
    first = wheel_sinkage(soil, RADIUS_M, WIDTH_M, load, slips)
    second = wheel_sinkage(soil, RADIUS_M, WIDTH_M, load, slips, first)
    ahead = wheel_forces(soil, RADIUS_M, WIDTH_M, first, slips).drawbar_n
    behind = wheel_forces(soil, RADIUS_M, WIDTH_M, second, slips, first).drawbar_n
    pull: Floats = (ahead + behind) / (2 * load)
    return pull


def slopes() -> Figure:
    """Slip of a rover that climbs, and where it gets stuck."""
    figure, (left, right) = side_by_side(2)
    rover, slips = _rover(), np.linspace(0.02, 1.0, 50)
    for name, grades, color in (
        ("lete_sand", (0.0, 3.0, 6.0, 9.0, 12.0, 15.0, 18.0), SERIES[0]),
        ("dry_sand", (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), SERIES[1]),
    ):
        soil, shown = _soils()[name], name.replace("_", " ")
        left.plot(np.degrees(np.arctan(_pull(soil, slips))), slips, color=color)
        reached = []
        for grade in grades:
            driven, slip = _uphill(rover, soil, grade)
            reached.append(slip)
            if grade in grades[1::4]:
                seconds = np.arange(0, len(driven), 40) / TICK_RATE_HZ
                style = "-" if grade == grades[1] else "--"
                right.plot(
                    seconds, driven[::40], style, color=color, label=f"{shown}, {grade:g} degrees"
                )
        left.plot(grades, reached, "o", color=color, label=shown)
    label(left, "The rover climbs at 0.5 m/s", "slope, degrees", "slip after 20 s")
    left.set_xlim(-0.5, 19)
    left.set_ylim(0.0, 1.05)
    left.legend(loc="lower right")
    label(right, "Way up the slope", "time, s", "m")
    right.legend()
    return figure


def _uphill(model: VehicleModel, soil: Soil, grade_deg: float) -> tuple[Floats, float]:
    """Drive up a slope, which gravity makes of the floor; return way and slip at the end."""
    backend, grade = BulletBackend(), radians(grade_deg)
    backend.set_gravity((-GRAVITY_MPS2 * sin(grade), 0.0, -GRAVITY_MPS2 * cos(grade)))
    materials = {"ground": Material(friction=1.0, soil=soil)}
    with put(model, materials=materials, new_backend=lambda: backend) as simulation:
        driven = drive(simulation, 20.0, (0.5, 0.0))
        [vitals] = simulation.vitals(0)
    return driven.pose[:, 0], float(np.mean([wheel.slip for wheel in vitals.soil or ()]))
