# SPDX-License-Identifier: Apache-2.0
"""True map of a scenario: the occupancy map of its static world, as a planar scanner sees it.

Vehicles and actors are not in it. Physics publishes this map, and `groundlink world map` writes it.
"""

from collections.abc import Sequence

from groundlink.core.errors import UserError
from groundlink.scenario.schema import Scenario
from groundlink.world.occupancy import Heights, MapGrid, OccupancyMap, grid_around, occupancy
from groundlink.world.solids import Solid

from .build import WorldError
from .spawn_checks import ground_of

PLANAR = "lidar_2d"
"""Kind of planar scanners."""

HEIGHTS_M: Heights = (0.1, 1.0)
"""Heights of obstacles in a scenario without a planar scanner."""


def default_heights_m(scenario: Scenario) -> Heights:
    """Return the height of the first planar scanner above the ground, twice; else `HEIGHTS_M`."""
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            if sensor.kind == PLANAR:
                height_m = vehicle.model.base_height_m + sensor.mount.xyz_m[2]
                return height_m, height_m
    return HEIGHTS_M


def true_map(
    scenario: Scenario,
    static: Sequence[Solid],
    *,
    resolution_m: float,
    heights_m: Heights | None = None,
    grid: MapGrid | None = None,
) -> OccupancyMap:
    """Return the map of a scenario's world.

    Parameters
    ----------
    static
        solids of the world, from `build.solids`.
    heights_m
        default: `default_heights_m`.
    grid
        default: cells of `resolution_m` around the world.

    Raises
    ------
    UserError
        when the world is empty or too large for its cells.
    """
    ground = ground_of(scenario)
    grid = grid or grid_around(static, ground, resolution_m)
    return occupancy(grid, static, ground, heights_m or default_heights_m(scenario))


def check_true_map(scenario: Scenario, static: Sequence[Solid]) -> None:
    """Refuse a scenario that asks for a map too large for its cells.

    Raises
    ------
    WorldError
        when it does.
    """
    if scenario.true_map is None:
        return
    try:
        grid_around(static, ground_of(scenario), scenario.true_map.resolution_m)
    except UserError as error:
        raise WorldError(("true_map", "resolution_m"), str(error)) from None
