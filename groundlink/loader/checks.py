# SPDX-License-Identifier: Apache-2.0
"""Checks across the fields of a scenario that types cannot express.

The scenario fits the schema already; the document only supplies the file and line of a mistake.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from groundlink.core.errors import did_you_mean
from groundlink.expectations.scope import mistakes as expectation_mistakes
from groundlink.ros.streams import TRUE_MAP_TOPIC
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.lockstep_window import window_mistake
from groundlink.scenario.ros_side import GATEWAY_TOPICS, Stream
from groundlink.scenario.route import Route, ThereAndBack, Waypoints
from groundlink.scenario.schema import RESERVED_NAMES, RESERVED_SENSOR_NAMES, Scenario, Vehicle
from groundlink.scenario.sensor_kinds import kind_of, load_reference
from groundlink.scenario.vehicle import HITCH_APART_M, Towing, VehicleModel
from groundlink.scene.build import UnknownMaterial, WorldError, solids
from groundlink.scene.entities import static_entities
from groundlink.scene.spawn_checks import check_spawns
from groundlink.scene.true_map import check_true_map

from .document import DataPath, Document, ScenarioError
from .material_library import material_library
from .validation_errors import dotted


def _check_hitch(
    hitch: Towing,
    vehicle: Vehicle,
    earlier: Sequence[Vehicle],
    document: Document,
    path: DataPath,
) -> None:
    """Refuse a hitch to no earlier vehicle, or of another height than the coupling."""
    by = next((other for other in earlier if other.name == hitch.vehicle), None)
    if by is None:
        known = ", ".join(other.name for other in earlier) or "none: list it first"
        raise ScenarioError(
            f"{document.mark((*path, 'vehicle'))}: `towed_by.vehicle`: no earlier vehicle "
            f"`{hitch.vehicle}`; expected one of {known}"
        )
    height_m = by.model.base_height_m + hitch.hitch_m[2]
    coupled_m = vehicle.model.base_height_m + hitch.coupling_m[2]
    if abs(height_m - coupled_m) > HITCH_APART_M:
        raise ScenarioError(
            f"{document.mark((*path, 'coupling_m'))}: `towed_by.coupling_m`: is {coupled_m:.3g} m "
            f"above level ground, the hitch {height_m:.3g} m; expected the same height"
        )


def check_scenario(scenario: Scenario, document: Document) -> None:
    """Check names, topics, faults, speeds and spawn places of a scenario.

    Raises
    ------
    ScenarioError
        with the first mistake.
    """
    if not scenario.vehicles:
        raise ScenarioError(f"{document.mark(('vehicles',))}: `vehicles`: expected at least one")
    _unique(document, ("vehicles",), [v.name for v in scenario.vehicles])
    for v, vehicle in enumerate(scenario.vehicles):
        here: DataPath = ("vehicles", v)
        _free(document, (*here, "name"), vehicle.name, RESERVED_NAMES)
        if hitch := vehicle.towed_by:
            _check_hitch(hitch, vehicle, scenario.vehicles[:v], document, (*here, "towed_by"))
        taken: list[str] = []
        for section, specs in _sections(vehicle):
            for s, spec in enumerate(specs):
                _free(document, (*here, section, s, "name"), spec.name, RESERVED_SENSOR_NAMES)
            _unique(document, (*here, section), [spec.name for spec in specs], taken)
            taken += [spec.name for spec in specs]
        for s, sensor in enumerate(vehicle.sensors):
            if check := kind_of(sensor).check:
                for problem in load_reference(check)(sensor, vehicle, scenario):
                    mark = document.mark((*here, "sensors", s, *problem.path))
                    raise ScenarioError(f"{mark}: {problem.text}")
            _check_faults(sensor, vehicle, document, (*here, "sensors", s, "faults"))
        if vehicle.route is not None:
            check_speeds(vehicle.route, vehicle.model, document, (*here, "route"))
    time = scenario.time
    every_sensor = (sensor for vehicle in scenario.vehicles for sensor in vehicle.sensors)
    if time.mode != "realtime" and (found := window_mistake(time, every_sensor)):
        mark = document.mark(("time", "window_ticks"))
        raise ScenarioError(f"{mark}: `time.window_ticks`: {found}")
    _check_topics(scenario, document)
    try:
        static = solids(scenario)
        check_spawns(scenario, static)
        check_true_map(scenario, static)
    except UnknownMaterial as error:
        known = scenario.world.materials | material_library()
        named = UnknownMaterial(error.path, error.material, known)
        raise ScenarioError(f"{document.mark(error.path)}: {named}") from None
    except WorldError as error:
        raise ScenarioError(f"{document.mark(error.path)}: {error}") from None
    _check_entities(scenario, document)
    check_expectations(scenario, document)


def check_expectations(scenario: Scenario, document: Document) -> None:
    """Raise ScenarioError for an expectation of what the scenario does not have.

    `document` has the list of expectations at `expect`.
    """
    for mistake in expectation_mistakes(scenario):
        mark = document.mark(mistake.path)
        raise ScenarioError(f"{mark}: `{dotted(mistake.path)}`: {mistake.text}")


def _check_entities(scenario: Scenario, document: Document) -> None:
    """Refuse a description of an entity that is not there."""
    if not (described := scenario.world.entities):
        return
    known = {*static_entities(scenario, {}), *(vehicle.name for vehicle in scenario.vehicles)}
    known |= {actor.name for actor in scenario.world.actors}
    for name in sorted(described.keys() - known):
        mark = document.mark(("world", "entities", name))
        raise ScenarioError(f"{mark}: `{name}`: no such entity; {did_you_mean(name, known)}")


class _Use(NamedTuple):
    """Use of a topic at a path of a scenario."""

    topic: str
    path: DataPath
    whose: str


def _check_topics(scenario: Scenario, document: Document) -> None:
    """Refuse topics that two streams share, in either direction."""
    reserved = [_Use(topic, (), "the gateway") for topic in GATEWAY_TOPICS]
    first: dict[str, _Use] = {}
    for use in _sent(scenario):
        _take(use, first, document)
    first |= {use.topic: use for use in reserved}
    for v, vehicle in enumerate(scenario.vehicles):
        subscribed = [("from_ros", topic) for topic in vehicle.from_ros.all_topics()]
        for field, topic in (*subscribed, ("command_topic", vehicle.command_topic)):
            whose = f"`{field}` of `{vehicle.name}`"
            _take(_Use(topic, ("vehicles", v, field), whose), first, document)


def _take(use: _Use, first: dict[str, _Use], document: Document) -> None:
    if (other := first.setdefault(use.topic, use)) is not use:
        where = f" ({document.mark(other.path)})" if other.path else ""
        raise ScenarioError(
            f"{document.mark(use.path)}: {use.whose}: the topic `{use.topic}` is taken by "
            f"{other.whose}{where}. Fix: choose another topic"
        )


def _sent(scenario: Scenario) -> Iterator[_Use]:
    """Yield the topics of all streams to ROS, except those of the gateway itself."""
    yield _Use(scenario.bodies.topic, ("bodies",), "`bodies`")
    if scenario.true_map is not None:
        yield _Use(TRUE_MAP_TOPIC, ("true_map",), "`true_map`")
    for v, vehicle in enumerate(scenario.vehicles):
        truth, whose = ("vehicles", v, "ground_truth"), f"`ground_truth` of `{vehicle.name}`"
        for topic in scenario.true_topics(vehicle):
            yield _Use(topic, truth, whose)
    for v, vehicle in enumerate(scenario.vehicles):
        for section, specs in _sections(vehicle):
            for s, spec in enumerate(specs):
                topics = spec.ros_topics() if isinstance(spec, SensorSpec) else {"": spec.topic}
                for name, topic in topics.items():
                    path: DataPath = ("vehicles", v, section, s, *([] if name else ["topic"]))
                    yield _Use(topic, path, f"`{vehicle.name}/{spec.name}`")


def _sections(vehicle: Vehicle) -> list[tuple[str, Sequence[SensorSpec | Stream]]]:
    """Return what a vehicle publishes, by the section of the scenario."""
    return [("sensors", vehicle.sensors), ("streams", vehicle.streams)]


def _check_faults(sensor: SensorSpec, vehicle: Vehicle, document: Document, path: DataPath) -> None:
    """Refuse faults that the sensor does not support."""
    for i, fault in enumerate(sensor.faults):
        if found := fault_problem(fault, sensor, vehicle):
            where = (*path, i, found[0])
            raise ScenarioError(f"{document.mark(where)}: `{dotted(where)}`: {found[1]}")


def check_speeds(route: Route, model: VehicleModel, document: Document, path: DataPath) -> None:
    """Raise ScenarioError for a route beyond the top speed, or with turns it cannot make."""
    if isinstance(route, ThereAndBack) and model.least_radius_m:
        raise ScenarioError(
            f"{document.mark(path)}: `{dotted(path)}`: `{model.name}` cannot turn in place; "
            "expected a kind other than `there_and_back`"
        )
    most = model.top_speed_mps
    asked: list[tuple[DataPath, float | None]] = [((*path, "speed_mps"), route.speed_mps)]
    if isinstance(route, Waypoints):
        for i, point in enumerate(route.points):
            asked.append(((*path, "points", i, "speed_mps"), point.speed_mps))
    for where, speed in asked:
        if speed is not None and speed > most:
            raise ScenarioError(
                f"{document.mark(where)}: `{dotted(where)}`: {speed:g} m/s is more than the "
                f"{most:.2f} m/s that `{model.name}` can drive. Fix: lower it"
            )


def _free(document: Document, path: DataPath, name: str, reserved: frozenset[str]) -> None:
    if name in reserved:
        mark = document.mark(path)
        raise ScenarioError(
            f"{mark}: `{name}`: reserved for a key of the bus. Fix: choose another name"
        )


def _unique(
    document: Document, path: DataPath, names: list[str], taken: Sequence[str] = ()
) -> None:
    for i, name in enumerate(names):
        if name in names[:i] or name in taken:
            mark = document.mark((*path, i, "name"))
            raise ScenarioError(f"{mark}: the name `{name}` is taken. Fix: choose another")
