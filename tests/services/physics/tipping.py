# SPDX-License-Identifier: Apache-2.0
"""Statics of a vehicle that stands across a slope: the angle at which it tips, on its springs.

A cross-section of rigid chassis and wheels on springs, without an engine: at each slope the base
heaves and leans until its potential energy is least. Wheels do not slip, treads do not bend.
"""

from math import atan, cos, degrees, radians, sin

import numpy as np
from scipy.optimize import minimize

from groundlink.scenario.vehicle import VehicleModel
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.vehicle.vehicle import spring_loads

STOP_NPM = 1e7
"""Stiffness of the end of a spring's travel."""


def rigid_deg(model: VehicleModel) -> float:
    """Return the slope across which a vehicle without springs tips."""
    mass, _, z = center_of_mass(model)
    assert mass > 0
    half_track = max(abs(wheel.center_m[1]) for wheel in model.wheels)
    return degrees(atan(half_track / (z + model.base_height_m)))


def center_of_mass(model: VehicleModel) -> tuple[float, float, float]:
    """Return the mass (kg) and the center of all bodies, y and z in the base frame (m)."""
    bodies = [(model.chassis.mass_kg, model.chassis.center_m)]
    bodies += [(wheel.mass_kg, wheel.center_m) for wheel in model.wheels]
    mass = sum(kg for kg, _ in bodies)
    return mass, *(sum(kg * at[axis] for kg, at in bodies) / mass for axis in (1, 2))


def tipping_deg(model: VehicleModel) -> float:
    """Return the steepest slope across which a vehicle finds an equilibrium, to 0.1 degrees."""
    wheels = model.wheels
    y, z, radius = (
        np.array(column)
        for column in zip(*((*w.center_m[1:], w.radius_m) for w in wheels), strict=True)
    )
    springs = [wheel.suspension or model.suspension for wheel in wheels]
    travel = np.array([spring.travel_m for spring in springs])
    stiffness = np.array([spring.stiffness_npm for spring in springs])
    preload = np.array(spring_loads(model))
    wheel_kg = np.array([wheel.mass_kg for wheel in wheels])
    chassis_kg, (_, center_y, center_z) = model.chassis.mass_kg, model.chassis.center_m
    lower = int(np.argmin(y))

    def energy(state: np.ndarray, slope: float) -> float:
        height, lean = state
        # Positions of wheels along the base's z: on the ground, or as far down as they go.
        grounded = (radius - height - y * sin(lean)) / cos(lean) - z
        hanging = np.maximum(-(preload + wheel_kg * GRAVITY_MPS2) / stiffness, -travel)
        position = np.maximum(grounded, hanging)
        beyond = np.maximum(np.abs(position) - travel, 0.0)
        stored = preload * position + stiffness * position**2 / 2 + STOP_NPM * beyond**2 / 2
        aside = y * cos(lean) - (z + position) * sin(lean)
        # The lower side rolls sideways on its tire without slip; downhill is towards negative y.
        shift = -aside[lower] - radius[lower] * lean
        across = np.append(aside + shift, center_y * cos(lean) - center_z * sin(lean) + shift)
        up = np.append(
            height + y * sin(lean) + (z + position) * cos(lean),
            height + center_y * sin(lean) + center_z * cos(lean),
        )
        weights = GRAVITY_MPS2 * np.append(wheel_kg, chassis_kg)
        return float(stored.sum() + weights @ (up * cos(slope) + across * sin(slope)))

    state, steepest = np.array([model.base_height_m, 0.0]), 0.0
    for step in (0.5, 0.1):
        while steepest < 80.0:
            found = minimize(
                energy,
                state,
                (radians(steepest + step),),
                method="Nelder-Mead",
                options={"xatol": 1e-7, "fatol": 1e-9, "initial_simplex": state + SIMPLEX},
            )
            if abs(found.x[1] - state[1]) > radians(5.0):
                break
            state, steepest = found.x, steepest + step
    return steepest


SIMPLEX = np.array([[0.0, 0.0], [1e-3, 0.0], [0.0, 2e-3]])
"""Of a search from the equilibrium on a slope that is up to half a degree less steep."""
