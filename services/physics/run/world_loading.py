# SPDX-License-Identifier: Apache-2.0
"""Worlds of a run: how tools see the present one, and what a run becomes in another one."""

from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.core.fields import Vector3
from groundlink.episode.world_queries import NamedPoseReport, QueryRefused, WorldReport
from groundlink.loader.checks import check_scenario
from groundlink.loader.document import Document, SourceLine
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario import Scenario
from groundlink.scene.entities import Corners, box_around, upright, vehicle_solids
from groundlink.scene.loaded_world import has_world, with_world
from groundlink.scene.spawn_checks import ground_of
from groundlink.scene.spawn_pose import spawn_pose

from .spawn_resources import loadable_world


class WorldSource(NamedTuple):
    """Where a world was loaded from, as a tool named it; both empty: where the run was started."""

    uri: str = ""
    text: str = ""


def scenario_in(run: Scenario, source: WorldSource) -> Scenario:
    """Return the scenario of a run in a world, which is read and checked.

    Raises
    ------
    QueryRefused
        when the world cannot be read, or the run's vehicles cannot be in it.
    """
    scenario = with_world(run, loadable_world(*source))
    here = SourceLine(Path(source.uri or "text"), 1)
    try:
        check_scenario(scenario, Document({}, {(): here}))
    except UserError as problem:
        line = str(problem).removeprefix(f"{here}: ")
        raise QueryRefused(
            "failed", f"{here.file}: this run's vehicles cannot be in this world: {line}"
        ) from None
    return scenario


def world_report(scenario: Scenario, source: WorldSource) -> WorldReport:
    """Return name, source and description of a scenario's world."""
    world = scenario.world
    shipped = SHIPPED / "worlds" / f"{world.name}.yaml"
    uri = f"worlds/{world.name}" if shipped.is_file() else ""
    found = WorldReport(world.name, uri, world.description or scenario.description, world.tags)
    return replace(found, uri=source.uri, text=source.text) if any(source) else found


def named_poses(scenario: Scenario) -> list[NamedPoseReport]:
    """Return the named poses of a world, and where its vehicles start, as `<vehicle>_start`."""
    if not has_world(scenario):
        return []
    found = []
    for name, named in scenario.world.poses.items():
        x, y, z = named.position_m
        box: tuple[Vector3 | None, Vector3 | None] = (None, None)
        if named.box is not None:
            box = named.box.low_m, named.box.high_m
        pose = upright(x, y, z, named.yaw_deg)
        found.append(NamedPoseReport(name, named.description, named.tags, *pose, *box))
    ground = ground_of(scenario)
    for vehicle in scenario.vehicles:
        corners: Corners = box_around(vehicle_solids(vehicle.model))
        pose = spawn_pose(vehicle, ground)
        text = f"Start pose of `{vehicle.name}`"
        found.append(NamedPoseReport(f"{vehicle.name}_start", text, ("start",), *pose, *corners))
    return found
