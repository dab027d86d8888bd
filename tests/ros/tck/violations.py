# SPDX-License-Identifier: Apache-2.0
"""Ways to violate the standard, each with the clause that must fail.

A violation changes one kind of message of the reference simulator: a request before it is handled,
or a response before it is sent.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from simulation_interfaces import srv
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Bounds, Resource, Result, SimulationState, TagsFilter
from simulation_interfaces.msg import SpawnResult as Spawned

OK = Result.RESULT_OK
NOT_FOUND = Result.RESULT_NOT_FOUND
FAILED = Result.RESULT_OPERATION_FAILED


class Violation(NamedTuple):
    """What a simulator does wrong, in which message, and the clause that must fail."""

    name: str
    message: Any
    change: Callable[[Any], None]
    clause: str


def code(wrong: int, right: int) -> Callable[[Any], None]:
    """Answer one code instead of another."""

    def change(response: Any) -> None:
        if response.result.result == right:
            response.result.result = wrong

    return change


def put(path: str, value: Any) -> Callable[[Any], None]:
    """Set a field."""

    def change(message: Any) -> None:
        *parents, last = path.split(".")
        for parent in parents:
            message = getattr(message, parent)
        setattr(message, last, value)

    return change


def if_scope(wanted: int, instead: int) -> Callable[[Any], None]:
    """Reset another scope."""

    def change(request: Any) -> None:
        if request.scope == wanted:
            request.scope = instead

    return change


def as_text(request: Any) -> None:
    """Compare a filter as plain text."""
    request.filters.filter = request.filters.filter.replace("[", r"\[").replace("(", r"\(")


def any_tag(request: Any) -> None:
    request.filters.tags.filter_mode = TagsFilter.FILTER_MODE_ANY


def swapped(bounds: Any) -> None:
    bounds.points = bounds.points[::-1]


def drop_uri_when_both(request: Any) -> None:
    if request.entity_resource.resource_string:
        request.entity_resource.uri = ""


def renamed(response: Any) -> None:
    if response.entity_name:
        response.entity_name += "_"


def move_x(response: Any) -> None:
    response.state.pose.position.x += 1.0


def twice(response: Any) -> None:
    response.entities = [*response.entities, *response.entities]


def one_state_less(response: Any) -> None:
    response.states = response.states[1:]


def never_stop(request: Any) -> None:
    if request.state.state == SimulationState.STATE_STOPPED:
        request.state.state = SimulationState.STATE_PAUSED


def any_world(request: Any) -> None:
    if request.world_resource == Resource():
        request.world_resource.resource_string = "world hall\n"


def as_state(wrong: int, right: int) -> Callable[[Any], None]:
    """Return a change of responses that replaces one state of the simulation by another."""

    def change(response: Any) -> None:
        if response.state.state == right:
            response.state.state = wrong

    return change


def rename_world(response: Any) -> None:
    response.world.name += "_2"


def no_text(request: Any) -> None:
    request.world_resource.resource_string = ""


def one_step_more(request: Any) -> None:
    if request.steps > 1:
        request.steps += 1


def skip_feedback(feedback: Any) -> None:
    if feedback.completed_steps == 3:
        feedback.completed_steps, feedback.remaining_steps = 2, 3


def miscount(feedback: Any) -> None:
    feedback.remaining_steps += 1


def unknown_feature(response: Any) -> None:
    response.features.features.append(99)


def no_tags_kept(request: Any) -> None:
    request.info.tags = []


def forget_summary(response: Any) -> None:
    response.result.result = OK


def first_failure_hides_the_rest(response: Any) -> None:
    response.results = response.results[:1]


def flat(response: Any) -> None:
    response.state.pose.orientation.w = 0.0


SpawnEntity, SpawnEntities = srv.SpawnEntity, srv.SpawnEntities
SetState = srv.SetSimulationState
Reset = srv.ResetSimulation.Request
State = srv.GetSimulationState.Response
Load = srv.LoadWorld.Response
UnloadResponse = srv.UnloadWorld.Response

VIOLATIONS = (
    Violation(
        "announces a code that the standard lacks",
        srv.GetSimulatorFeatures.Response,
        unknown_feature,
        "test_features_are_codes_of_the_standard",
    ),
    Violation(
        "spawns under another name",
        SpawnEntity.Response,
        renamed,
        "test_spawned_entity_has_the_requested_name[SPAWNING]",
    ),
    Violation(
        "renames without being allowed to",
        SpawnEntity.Request,
        put("allow_renaming", True),
        "test_taken_name_is_refused_without_renaming[SPAWNING]",
    ),
    Violation(
        "never renames",
        SpawnEntity.Request,
        put("allow_renaming", False),
        "test_taken_name_is_replaced_with_renaming[SPAWNING]",
    ),
    Violation(
        "reports a missing resource as a failure of any kind",
        SpawnEntity.Response,
        code(FAILED, Spawned.NO_RESOURCE),
        "test_request_without_resource_is_refused[SPAWNING]",
    ),
    Violation(
        "prefers the resource string to the uri",
        SpawnEntity.Request,
        drop_uri_when_both,
        "test_resource_string_is_ignored_beside_a_uri[SPAWNING]",
    ),
    Violation(
        "can't tell an unknown format from a malformed file",
        SpawnEntity.Response,
        code(Spawned.RESOURCE_PARSE_ERROR, Spawned.UNSUPPORTED_FORMAT),
        "test_unknown_format_is_refused[SPAWNING]",
    ),
    Violation(
        "reports a malformed file as missing",
        SpawnEntity.Response,
        code(NOT_FOUND, Spawned.RESOURCE_PARSE_ERROR),
        "test_malformed_file_is_refused[SPAWNING]",
    ),
    Violation(
        "takes any namespace",
        SpawnEntity.Request,
        put("entity_namespace", ""),
        "test_invalid_namespace_is_refused[SPAWNING]",
    ),
    Violation(
        "reports an invalid pose as success",
        SpawnEntity.Response,
        code(OK, Spawned.INVALID_POSE),
        "test_invalid_pose_is_refused[zero_quaternion-SPAWNING]",
    ),
    Violation(
        "spawns at one place",
        SpawnEntity.Request,
        put("initial_pose.pose.position.x", 9.0),
        "test_entity_is_where_it_was_spawned[SPAWNING]",
    ),
    Violation(
        "takes any frame for the world's",
        SpawnEntity.Request,
        put("initial_pose.header.frame_id", ""),
        "test_unknown_frame_is_refused[SPAWNING]",
    ),
    Violation(
        "sums a failed request up as success",
        SpawnEntities.Response,
        forget_summary,
        "test_one_failed_request_is_told_by_its_result",
    ),
    Violation(
        "answers many requests with one result",
        SpawnEntities.Response,
        first_failure_hides_the_rest,
        "test_results_are_in_the_order_of_the_requests",
    ),
    Violation(
        "deletes what does not exist",
        srv.DeleteEntity.Response,
        code(OK, NOT_FOUND),
        "test_unknown_entity_is_not_found",
    ),
    Violation("lists names twice", srv.GetEntities.Response, twice, "test_names_are_unique"),
    Violation(
        "compares a filter as text",
        srv.GetEntities.Request,
        as_text,
        "test_names_match_an_extended_regular_expression[character_class]",
    ),
    Violation(
        "ignores the filter by name",
        srv.GetEntities.Request,
        put("filters.filter", ""),
        "test_names_match_an_extended_regular_expression[anchors]",
    ),
    Violation(
        "ignores bounds",
        srv.GetEntities.Request,
        put("filters.bounds", Bounds()),
        "test_sphere_finds_what_overlaps",
    ),
    Violation(
        "ignores categories",
        srv.GetEntities.Request,
        put("filters.categories", []),
        "test_any_of_the_categories_matches",
    ),
    Violation(
        "takes any tag for all",
        srv.GetEntities.Request,
        any_tag,
        "test_any_or_all_tags_match[all]",
    ),
    Violation(
        "leaves out a state",
        srv.GetEntitiesStates.Response,
        one_state_less,
        "test_states_are_those_of_the_entities",
    ),
    Violation(
        "reports another place",
        srv.GetEntityState.Response,
        move_x,
        "test_pose_that_was_set_is_read_back",
    ),
    Violation(
        "reports a quaternion of no length",
        srv.GetEntityState.Response,
        flat,
        "test_pose_is_valid",
    ),
    Violation(
        "sets the pose without its flag",
        srv.SetEntityState.Request,
        put("set_pose", True),
        "test_pose_is_ignored_without_its_flag",
    ),
    Violation(
        "never sets a twist",
        srv.SetEntityState.Request,
        put("set_twist", False),
        "test_twist_that_was_set_is_read_back",
    ),
    Violation(
        "moves static objects",
        srv.SetEntityState.Response,
        code(OK, FAILED),
        "test_static_object_is_not_moved[twist]",
    ),
    Violation(
        "reports an invalid pose as a failure of any kind",
        srv.SetEntityState.Response,
        code(FAILED, srv.SetEntityState.Response.INVALID_POSE),
        "test_invalid_pose_is_not_set[nan_in_quaternion]",
    ),
    Violation(
        "loses tags",
        srv.SetEntityInfo.Request,
        no_tags_kept,
        "test_info_that_was_set_is_read_back",
    ),
    Violation(
        "orders the corners of a box the other way",
        srv.GetEntityBounds.Response,
        lambda response: swapped(response.bounds),
        "test_bounds_of_an_entity_are_a_volume",
    ),
    Violation(
        "says nothing of an unknown source",
        srv.GetSpawnables.Response,
        put("result.error_message", ""),
        "test_unrecognized_source_is_named_and_no_failure",
    ),
    Violation(
        "ignores tags of named poses",
        srv.GetNamedPoses.Request,
        put("tags", TagsFilter()),
        "test_named_poses_are_filtered_by_tags[any]",
    ),
    Violation(
        "pauses instead of stopping",
        SetState.Request,
        never_stop,
        "test_transition_succeeds[playing-stopped]",
    ),
    Violation(
        "reports no change of state as success",
        SetState.Response,
        code(OK, SetState.Response.ALREADY_IN_TARGET_STATE),
        "test_state_is_set_once[playing]",
    ),
    Violation(
        "says that it steps while it plays",
        srv.StepSimulation.Response,
        code(OK, FAILED),
        "test_step_is_refused_while_playing",
    ),
    Violation(
        "steps one too many",
        srv.StepSimulation.Request,
        one_step_more,
        "test_steps_are_counted",
    ),
    Violation(
        "miscounts remaining steps",
        SimulateSteps.Feedback,
        miscount,
        "test_feedback_adds_up",
    ),
    Violation(
        "repeats a feedback",
        SimulateSteps.Feedback,
        skip_feedback,
        "test_feedback_follows_each_step",
    ),
    Violation(
        "resets the state alone by default",
        srv.ResetSimulation.Request,
        if_scope(Reset.SCOPE_DEFAULT, Reset.SCOPE_STATE),
        "test_default_scope_is_all",
    ),
    Violation(
        "despawns when time is reset",
        srv.ResetSimulation.Request,
        if_scope(Reset.SCOPE_TIME, Reset.SCOPE_ALL),
        "test_reset_of_time_keeps_entities",
    ),
    Violation(
        "takes scopes for numbers",
        srv.ResetSimulation.Request,
        if_scope(Reset.SCOPE_TIME | Reset.SCOPE_SPAWNED, Reset.SCOPE_TIME),
        "test_scopes_are_bits",
    ),
    Violation(
        "ignores tags of worlds",
        srv.GetAvailableWorlds.Request,
        put("filter", TagsFilter()),
        "test_worlds_are_filtered_by_tags[any]",
    ),
    Violation(
        "loads a world without a resource",
        srv.LoadWorld.Request,
        any_world,
        "test_world_without_resource_is_refused",
    ),
    Violation(
        "plays the loaded world",
        State,
        as_state(SimulationState.STATE_PLAYING, SimulationState.STATE_STOPPED),
        "test_loaded_world_is_stopped_and_empty",
    ),
    Violation(
        "tells another world than the loaded one",
        srv.GetCurrentWorld.Response,
        rename_world,
        "test_loaded_world_is_the_current_one",
    ),
    Violation(
        "loads a file of any format",
        srv.LoadWorld.Response,
        code(OK, Load.UNSUPPORTED_FORMAT),
        "test_world_of_unknown_format_is_refused",
    ),
    Violation(
        "loads a file that is not there",
        srv.LoadWorld.Response,
        code(OK, Result.RESULT_NOT_FOUND),
        "test_world_that_is_missing_is_refused",
    ),
    Violation(
        "ignores a world's text",
        srv.LoadWorld.Request,
        no_text,
        "test_world_is_loaded_from_a_string",
    ),
    Violation(
        "loads a malformed text",
        srv.LoadWorld.Response,
        code(OK, Load.RESOURCE_PARSE_ERROR),
        "test_malformed_string_is_no_world",
    ),
    Violation(
        "tells no state of no world",
        State,
        as_state(SimulationState.STATE_PAUSED, SimulationState.STATE_NO_WORLD),
        "test_unloaded_world_leaves_nothing",
    ),
    Violation(
        "tells the world that was unloaded",
        srv.GetCurrentWorld.Response,
        code(OK, srv.GetCurrentWorld.Response.NO_WORLD_LOADED),
        "test_no_world_is_current_after_unloading",
    ),
    Violation(
        "loads a world after another one only",
        State,
        as_state(SimulationState.STATE_NO_WORLD, SimulationState.STATE_STOPPED),
        "test_world_is_loaded_after_unloading",
    ),
    Violation(
        "steps without a world",
        srv.StepSimulation.Response,
        code(OK, FAILED),
        "test_nothing_is_stepped_without_a_world",
    ),
    Violation(
        "plays without a world",
        srv.SetSimulationState.Response,
        code(OK, SetState.Response.STATE_TRANSITION_ERROR),
        "test_state_is_not_set_without_a_world[playing]",
    ),
    Violation(
        "reports a malformed world as one of unknown format",
        srv.LoadWorld.Response,
        code(Load.UNSUPPORTED_FORMAT, Load.RESOURCE_PARSE_ERROR),
        "test_malformed_world_is_refused",
    ),
    Violation(
        "unloads no world with success",
        srv.UnloadWorld.Response,
        code(OK, UnloadResponse.NO_WORLD_LOADED),
        "test_world_is_unloaded_once",
    ),
)
