# SPDX-License-Identifier: Apache-2.0
"""Worlds: the list, the current one, loading and unloading."""

from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import pytest
from simulation_interfaces.msg import Resource, SimulationState, TagsFilter
from simulation_interfaces.srv import (
    GetAvailableWorlds,
    GetCurrentWorld,
    LoadWorld,
    SetSimulationState,
    StepSimulation,
    UnloadWorld,
)

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail, not_tested
from simulation_interfaces_tck.resources import BROKEN
from simulation_interfaces_tck.scene import OK, PAUSED, PLAYING, SPAWNERS, STOPPED, SimulatorScene

NO_WORLD = SimulationState.STATE_NO_WORLD
MODES = {"any": TagsFilter.FILTER_MODE_ANY, "all": TagsFilter.FILTER_MODE_ALL}


def _some_world(scene: SimulatorScene) -> Resource:
    """Return a resource to load: the given one, the current world's, or the first available."""
    if scene.world_file:
        return Resource(uri=scene.world_file.as_uri())
    if world := scene.world():
        return world.world_resource
    if "AVAILABLE_WORLDS" in scene.simulator.announced:
        for listed in scene.simulator.expect(OK, GetAvailableWorlds).worlds:
            return listed.world_resource
    not_tested("no world is known that can be loaded")


def _unload(scene: SimulatorScene) -> None:
    """Unload the world, if it can be loaded again."""
    scene.simulator.need("WORLD_LOADING", "WORLD_INFO_GETTING")
    if scene.world() is None:
        not_tested("no world is loaded")
    scene.simulator.expect(OK, UnloadWorld)


def _spawned(scene: SimulatorScene) -> str:
    """Return the name of an entity that was spawned, or nothing if nothing can be."""
    can = any(feature in scene.simulator.announced for feature in SPAWNERS)
    return scene.spawn() if can else ""


@clause("WorldResource.msg: world_resource", "AVAILABLE_WORLDS")
def test_each_world_has_a_resource(scene: SimulatorScene) -> None:
    """Uri and resource string are not both empty."""
    for world in scene.simulator.expect(OK, GetAvailableWorlds).worlds:
        if not (world.world_resource.uri or world.world_resource.resource_string):
            fail(f"GetAvailableWorlds: expected a uri or a resource string, got neither: {world}")


@clause("GetAvailableWorlds.srv: offline_only", "AVAILABLE_WORLDS")
def test_offline_worlds_are_among_all(scene: SimulatorScene) -> None:
    """Only local sources yield no more worlds than all sources."""
    every = {world.world_resource.uri for world in _worlds(scene)}
    offline = {world.world_resource.uri for world in _worlds(scene, offline_only=True)}
    if not offline <= every:
        fail(f"GetAvailableWorlds: offline only: {sorted(offline - every)} are not in the list")


@clause("GetAvailableWorlds.srv: continue_on_error", "AVAILABLE_WORLDS")
def test_failing_source_does_not_hide_the_others(scene: SimulatorScene) -> None:
    """With continue_on_error, a source that fails leaves the worlds of the others."""
    every = {world.world_resource.uri for world in _worlds(scene)}
    sources = ["tck://source/that/does/not/exist"]
    found = _worlds(scene, additional_sources=sources, continue_on_error=True)
    if missing := every - {world.world_resource.uri for world in found}:
        fail(f"GetAvailableWorlds: {sorted(missing)} are missing beside a source that fails")


@pytest.mark.parametrize("mode", MODES)
@clause("GetAvailableWorlds.srv: filter", "WORLD_TAGS", needs=["AVAILABLE_WORLDS"])
def test_worlds_are_filtered_by_tags(scene: SimulatorScene, mode: str) -> None:
    """Only worlds with any or all of the tags are listed."""
    worlds = _worlds(scene)
    tags = sorted({tag for world in worlds for tag in world.tags})
    if not tags:
        not_tested("no world has a tag")
    for wanted in ([tags[0]], [tags[-1], tags[0]], [tags[0], "tck_tag_of_none"]):
        match = any if mode == "any" else all
        expected = sorted(w.name for w in worlds if match(tag in w.tags for tag in wanted))
        only = TagsFilter(tags=wanted, filter_mode=MODES[mode])
        got = sorted(world.name for world in _worlds(scene, filter=only))
        if got != expected:
            fail(f"GetAvailableWorlds: {mode} of {wanted}: expected {expected}, got {got}")


def _worlds(scene: SimulatorScene, **fields: Any) -> list[Any]:
    return [*scene.simulator.expect(OK, GetAvailableWorlds, **fields).worlds]


@clause("GetCurrentWorld.srv: world", "WORLD_INFO_GETTING")
def test_current_world_is_named_or_none_is_loaded(scene: SimulatorScene) -> None:
    """The current world has a resource, unless none is loaded."""
    codes = (OK, GetCurrentWorld.Response.NO_WORLD_LOADED)
    response = scene.simulator.expect(codes, GetCurrentWorld)
    resource = response.world.world_resource
    if response.result.result == OK and not (resource.uri or resource.resource_string):
        fail("GetCurrentWorld: expected a uri or a resource string of the world, got neither")


@clause("LoadWorld.srv: description", "WORLD_LOADING")
def test_loaded_world_is_stopped_and_empty(scene: SimulatorScene) -> None:
    """Loading a world stops the simulation and removes what was spawned."""
    resource = _some_world(scene)
    name = _spawned(scene)
    scene.simulator.expect(OK, LoadWorld, world_resource=resource)
    scene.must_be(STOPPED)
    if name:
        scene.must_lack(name)


@clause("LoadWorld.srv: world", "WORLD_LOADING", needs=["WORLD_INFO_GETTING"])
def test_loaded_world_is_the_current_one(scene: SimulatorScene) -> None:
    """The world that was loaded is the one that is told."""
    resource = _some_world(scene)
    loaded = scene.simulator.expect(OK, LoadWorld, world_resource=resource).world
    current = scene.simulator.expect(OK, GetCurrentWorld).world
    if (loaded.name, loaded.world_resource) != (current.name, current.world_resource):
        fail(f"GetCurrentWorld: expected {loaded}, got {current}")


@clause("LoadWorld.srv: NO_RESOURCE", "WORLD_LOADING")
def test_world_without_resource_is_refused(scene: SimulatorScene) -> None:
    """Uri and resource string may not both be empty."""
    scene.simulator.expect(LoadWorld.Response.NO_RESOURCE, LoadWorld)


@clause("LoadWorld.srv: UNSUPPORTED_FORMAT", "WORLD_LOADING", needs=["WORLD_INFO_GETTING"])
def test_world_of_unknown_format_is_refused(scene: SimulatorScene, tmp_path: Path) -> None:
    """A file whose format is not supported is refused as that."""
    file = tmp_path / "world.tck"
    file.write_text("no format that a simulator knows\n")
    code = LoadWorld.Response.UNSUPPORTED_FORMAT
    scene.simulator.expect(code, LoadWorld, world_resource=Resource(uri=file.as_uri()))


@clause("Resource.msg: uri", "WORLD_LOADING", needs=["WORLD_INFO_GETTING"])
def test_world_that_is_missing_is_refused(scene: SimulatorScene, tmp_path: Path) -> None:
    """A file that does not exist is not loaded."""
    suffix = Path(urlparse(_some_world(scene).uri).path).suffix
    missing = Resource(uri=(tmp_path / f"missing{suffix}").as_uri())
    response = scene.simulator.call(LoadWorld, world_resource=missing)
    if response.result.result == OK:
        fail("LoadWorld: expected a refusal of a file that does not exist, got RESULT_OK")


@clause("LoadWorld.srv: RESOURCE_PARSE_ERROR", "WORLD_LOADING", needs=["WORLD_INFO_GETTING"])
def test_malformed_world_is_refused(scene: SimulatorScene, tmp_path: Path) -> None:
    """A file of a supported format that can't be parsed is refused as that."""
    suffix = Path(urlparse(_some_world(scene).uri).path).suffix
    if not suffix:
        not_tested("the uri of the world does not end in a format")
    file = tmp_path / f"world{suffix}"
    file.write_text(BROKEN)
    code = LoadWorld.Response.RESOURCE_PARSE_ERROR
    scene.simulator.expect(code, LoadWorld, world_resource=Resource(uri=file.as_uri()))


@clause("Resource.msg: resource_string", "WORLD_RESOURCE_STRING")
def test_world_is_loaded_from_a_string(scene: SimulatorScene) -> None:
    """The text of a world's file is loaded as the file is."""
    uri = urlparse(_some_world(scene).uri)
    file = Path(unquote(uri.path))
    if uri.scheme not in ("", "file") or not file.is_file():
        not_tested("the world is no file on this machine")
    text = Resource(resource_string=file.read_text(encoding="utf-8"))
    scene.simulator.expect(OK, LoadWorld, world_resource=text)
    scene.must_be(STOPPED)


@clause("LoadWorld.srv: RESOURCE_PARSE_ERROR", "WORLD_RESOURCE_STRING")
def test_malformed_string_is_no_world(scene: SimulatorScene) -> None:
    """A string that is no world is refused as malformed, or as of no known format."""
    codes = (LoadWorld.Response.RESOURCE_PARSE_ERROR, LoadWorld.Response.UNSUPPORTED_FORMAT)
    broken = Resource(resource_string=BROKEN)
    scene.simulator.expect(codes, LoadWorld, world_resource=broken)


@clause("UnloadWorld.srv: description", "WORLD_UNLOADING")
def test_unloaded_world_leaves_nothing(scene: SimulatorScene) -> None:
    """Unloading removes spawned entities, and the state is that of no world."""
    name = _spawned(scene)
    _unload(scene)
    scene.must_be(NO_WORLD)
    if name:
        scene.must_lack(name)


@clause("GetCurrentWorld.srv: NO_WORLD_LOADED", "WORLD_UNLOADING")
def test_no_world_is_current_after_unloading(scene: SimulatorScene) -> None:
    """Without a world, none is told."""
    _unload(scene)
    code = GetCurrentWorld.Response.NO_WORLD_LOADED
    scene.simulator.expect(code, GetCurrentWorld)


@clause("UnloadWorld.srv: NO_WORLD_LOADED", "WORLD_UNLOADING")
def test_world_is_unloaded_once(scene: SimulatorScene) -> None:
    """Without a world, none can be unloaded."""
    _unload(scene)
    scene.simulator.expect(UnloadWorld.Response.NO_WORLD_LOADED, UnloadWorld)


@clause("UnloadWorld.srv: description", "WORLD_UNLOADING", needs=["WORLD_LOADING"])
def test_world_is_loaded_after_unloading(scene: SimulatorScene) -> None:
    """After unloading, a world can be loaded, and leaves the simulation stopped."""
    resource = _some_world(scene)
    _unload(scene)
    scene.simulator.expect(OK, LoadWorld, world_resource=resource)
    scene.must_be(STOPPED)
    if scene.world() is None:
        fail("GetCurrentWorld: expected the world that was loaded, got NO_WORLD_LOADED")


@clause("SimulationState.msg: STATE_NO_WORLD", "WORLD_UNLOADING", needs=["STEP_SIMULATION_SINGLE"])
def test_nothing_is_stepped_without_a_world(scene: SimulatorScene) -> None:
    """Without a world, the simulation is inactive."""
    _unload(scene)
    response = scene.simulator.call(StepSimulation, steps=1)
    if response.result.result == OK:
        fail("StepSimulation: expected a refusal without a world, got RESULT_OK")


@pytest.mark.parametrize("state", [STOPPED, PLAYING, PAUSED], ids=["stopped", "playing", "paused"])
@clause(
    "SimulationState.msg: STATE_NO_WORLD", "WORLD_UNLOADING", needs=["SIMULATION_STATE_SETTING"]
)
def test_state_is_not_set_without_a_world(scene: SimulatorScene, state: int) -> None:
    """Without a world, the simulation can't be started, stopped or paused."""
    _unload(scene)
    response = scene.simulator.call(SetSimulationState, state=SimulationState(state=state))
    if response.result.result == OK:
        fail("SetSimulationState: expected a refusal without a world, got RESULT_OK")
    scene.must_be(NO_WORLD)
