# SPDX-License-Identifier: Apache-2.0
"""Lights: the sun, or lamps under a ceiling, each with the view of its shadow map.

The values depend on the scenario and the world's extent only. 1 is the light that makes a white
surface white in the picture. True luminances are not modeled, because a camera's exposure cancels
them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundlink.core.frames import Floats
from groundlink.scenario.schema import World
from groundlink.world.bounds import bounds
from groundlink.world.solids import Solid
from groundlink.world.weather import Lamps, Sun

Color = tuple[float, float, float]

BELOW_CEILING_M = 0.04
CLEAR_M = 40e3
"""Visibility in meters on a clear day: far hills are paler than near ones."""

HORIZON, ZENITH = (0.66, 0.72, 0.80), (0.16, 0.32, 0.66)
"""Color of a clear sky."""

WIDE_M = 150.0
"""Size of a world, in meters, beyond which one map of all shadows would be too coarse near the eye.
"""

WINDOW_M = 80.0

DEEP_M = 400.0
"""Height range of objects that cast shadows there. A higher object counts as one of this height."""

REACH = 6.0
"""Tangent of the half angle in which a lamp casts shadows: 80 degrees."""


@dataclass(frozen=True)
class Light:
    """One source that casts shadows."""

    at: tuple[float, float, float, float]
    """A lamp's position and 1, or the unit vector towards the sun and 0; in the world."""

    power: Color
    clip_from_world: Floats
    """The view of its shadow map, clip_from_world, shape (4, 4)."""


@dataclass(frozen=True)
class Lighting:
    """All light in a world, linear."""

    lights: tuple[Light, ...]
    is_sun: bool
    ambient_above: Color
    """Ambient light on surfaces that face up."""

    ambient_below: Color
    horizon: Color
    zenith: Color
    extinction_per_m: float
    """Extinction of fog; 0 without fog."""

    window_m: float | None = None
    """Side of the square around the eye with sharper shadows; None if the world is small enough."""


def lighting(world: World, static: Sequence[Solid]) -> Lighting:
    """Return the light of a world with all static solids."""
    corners = np.array([np.zeros(3), *(corner for solid in static for corner in bounds(solid))])
    low, high = corners.min(axis=0), corners.max(axis=0)
    light = world.sun or world.light or _ceiling_lamp(world)
    # Koschmieder 1924 with the 5 % contrast of the meteorological optical range.
    fog_m = world.weather.fog_visibility_m or (world.terrain and CLEAR_M)
    extinction = math.log(20) / fog_m if fog_m else 0.0
    if isinstance(light, Sun):
        return Lighting(
            lights=(_sun(light, low, high),),
            is_sun=True,
            ambient_above=(0.26, 0.29, 0.36),
            ambient_below=(0.16, 0.15, 0.13),
            extinction_per_m=extinction,
            window_m=WINDOW_M if world.terrain or np.ptp(corners, axis=0).max() > WIDE_M else None,
            horizon=HORIZON,
            zenith=ZENITH,
        )
    return Lighting(
        lights=tuple(_lamp(at, low) for at in light.at_m),
        is_sun=False,
        # A bright room: floor and ceiling reflect most of the light.
        ambient_above=(0.30, 0.30, 0.29),
        ambient_below=(0.34, 0.33, 0.31),
        extinction_per_m=extinction,
        horizon=HORIZON,
        zenith=ZENITH,
    )


def _ceiling_lamp(world: World) -> Lamps:
    assert world.room is not None
    return Lamps(at_m=((0.0, 0.0, world.room.size_m[2] - BELOW_CEILING_M),))


def _sun(sun: Sun, low: Floats, high: Floats) -> Light:
    """Return the sun, with parallel shadows over the whole world."""
    towards = np.array(sun.towards)
    light_from_world = _looking(-towards)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    turned = (low + corners * (high - low)) @ light_from_world.T
    least, most = turned.min(axis=0) - 0.5, turned.max(axis=0) + 0.5
    clip_from_world = np.eye(4)
    clip_from_world[:3, :3] = light_from_world * (2 / (most - least))[:, None]
    clip_from_world[:3, 3] = -(most + least) / (most - least)
    x, y, z = towards.tolist()
    return Light((x, y, z, 0.0), (0.88, 0.84, 0.75), clip_from_world)


def window(light: Light, side_m: float, eye: Floats) -> Floats:
    """Return clip_from_world of the sun's shadows in a square around an eye, shape (4, 4).

    The square moves in steps, so that it is the same for many pictures.
    """
    light_from_world = _looking(-np.array(light.at[:3]))
    step_m = side_m / 4
    middle = np.rint(light_from_world @ eye / step_m) * step_m
    halves = np.array([side_m, side_m, DEEP_M]) / 2
    clip_from_world = np.eye(4)
    clip_from_world[:3, :3] = light_from_world / halves[:, None]
    clip_from_world[:3, 3] = -middle / halves
    return clip_from_world


def _lamp(at: tuple[float, float, float], low: Floats) -> Light:
    """Return a lamp, with shadows down to the lowest solid.

    Its map is parallel to the floor, so that its grid is equally fine at every distance.
    """
    fall = max(at[2] - low[2], 0.1)
    near, far = 0.02, fall + 0.1
    projection = np.array(
        [
            [1 / REACH, 0.0, 0.0, 0.0],
            [0.0, 1 / REACH, 0.0, 0.0],
            [0.0, 0.0, (far + near) / (far - near), -2 * far * near / (far - near)],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
    view = np.eye(4)
    view[:3, :3] = _looking(np.array([0.0, 0.0, -1.0]))
    view[:3, 3] = -view[:3, :3] @ np.array(at)
    # A floor at z = 0 directly below receives three quarters of the light that makes white, see the
    # shader.
    power = 0.75 * max(at[2], 0.1)
    return Light((*at, 1.0), (power, 0.98 * power, 0.93 * power), projection @ view)


def _looking(forward: Floats) -> Floats:
    """Return optical_from_world of a view along a unit vector, shape (3, 3): z is forward."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(forward[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    down = np.cross(forward, helper)
    down /= np.linalg.norm(down)
    return np.stack([np.cross(down, forward), down, forward])
