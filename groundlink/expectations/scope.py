# SPDX-License-Identifier: Apache-2.0
"""What the expectations of a scenario refer to: vehicles, places, topics, objects; and mistakes."""

from collections.abc import Iterator
from typing import NamedTuple

from groundlink.core.errors import did_you_mean
from groundlink.messages.navigation import Odometry, PoseStamped
from groundlink.ros.base import made_topics
from groundlink.ros.streams import RosStream, incoming, outgoing
from groundlink.scenario.expectations import (
    CompletesRoute,
    Expectation,
    NeverTouches,
    PoseExpectation,
    Reaches,
    StaysOnRoute,
    TopicExpectation,
    VehicleExpectation,
)
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.entities import static_entities


class ExpectationMistake(NamedTuple):
    """A mistake in an expectation."""

    number: int
    """Number of the expectation in the scenario."""

    field: str
    text: str

    @property
    def path(self) -> tuple[str | int, ...]:
        """Path of the field in the scenario."""
        return ("expect", self.number, self.field)


def vehicle_of(expectation: VehicleExpectation, scenario: Scenario) -> Vehicle | None:
    """Return the vehicle of an expectation; None if there is none or if it is not clear."""
    if expectation.vehicle is None:
        return scenario.vehicles[0] if len(scenario.vehicles) == 1 else None
    return next((v for v in scenario.vehicles if v.name == expectation.vehicle), None)


def places(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return the named places of the world, x and y in meters."""
    poses = {name: pose.position_m[:2] for name, pose in scenario.world.poses.items()}
    return scenario.world.checkpoints | poses


def place_of(expectation: Reaches, scenario: Scenario) -> tuple[float, float] | None:
    """Return the place that is to be reached, x and y in meters; None if the name is unknown."""
    place = expectation.place
    return places(scenario).get(place) if isinstance(place, str) else place


def estimates(scenario: Scenario, run: str) -> dict[str, tuple[Vehicle, RosStream]]:
    """Return the streams of estimated poses, each with its vehicle, by topic."""
    found = {}
    for vehicle in scenario.vehicles:
        truth = scenario.ground_truth_topic(vehicle)
        for stream in (*outgoing(scenario, run), *incoming(scenario, run)):
            is_of_vehicle = stream.key.split("/")[2] == vehicle.name
            is_pose = issubclass(stream.message, Odometry | PoseStamped)
            if is_of_vehicle and is_pose and stream.topic != truth:
                found[stream.topic] = vehicle, stream
    return found


def parts_of(name: str, scenario: Scenario) -> frozenset[str]:
    """Return the names that contacts with an object have; empty for an unknown object."""
    entities = static_entities(scenario, {})
    if name in entities:
        return frozenset(entities[name].parts)
    known = {part for entity in entities.values() for part in entity.parts}
    known |= {actor.name for actor in scenario.world.actors}
    known |= {vehicle.name for vehicle in scenario.vehicles}
    return frozenset({name} & known)


def mistakes(scenario: Scenario) -> Iterator[ExpectationMistake]:
    """Yield the mistakes in the expectations of a scenario."""
    titles: set[str] = set()
    for number, expectation in enumerate(scenario.expect):
        if expectation.title in titles:
            yield ExpectationMistake(
                number,
                "name",
                f"another expectation has the name `{expectation.title}`. Fix: add a `name`",
            )
        titles.add(expectation.title)
        for field, text in _mistakes(expectation, scenario):
            yield ExpectationMistake(number, field, text)


def _mistakes(expectation: Expectation, scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield field and mistake."""
    if isinstance(expectation, VehicleExpectation):
        vehicle = vehicle_of(expectation, scenario)
        if vehicle is None:
            names = [vehicle.name for vehicle in scenario.vehicles]
            given = expectation.vehicle
            yield (
                "vehicle",
                f"expected one of {', '.join(names)}, since there are several vehicles"
                if given is None
                else f"no vehicle `{given}`; {did_you_mean(given, names)}",
            )
        elif isinstance(expectation, CompletesRoute | StaysOnRoute) and vehicle.route is None:
            yield "kind", f"`{vehicle.name}` has no route. Fix: add `route` to the vehicle"
    if isinstance(expectation, Reaches) and place_of(expectation, scenario) is None:
        known = places(scenario)
        hint = (
            did_you_mean(str(expectation.place), known)
            if known
            else "the world names none. Fix: give x and y in meters"
        )
        yield "place", f"no pose or checkpoint `{expectation.place}`; {hint}"
    if isinstance(expectation, NeverTouches):
        for name in expectation.allowed:
            if not parts_of(name, scenario):
                yield "allowed", f"no object `{name}`; {_hint_of_objects(name, scenario)}"
    if isinstance(expectation, PoseExpectation):
        known_poses = estimates(scenario, "")
        if expectation.topic not in known_poses:
            hint = "no vehicle has an estimate of its pose. Fix: add `from_ros.pose`"
            if known_poses:
                hint = did_you_mean(expectation.topic, known_poses)
            yield "topic", f"no estimated pose on `{expectation.topic}`; {hint}"
    elif isinstance(expectation, TopicExpectation):
        if expectation.topic not in (topics := _topics(scenario)):
            yield (
                "topic",
                f"no topic `{expectation.topic}`; {did_you_mean(expectation.topic, topics)}",
            )


def _topics(scenario: Scenario) -> set[str]:
    """Return all topics from and to ROS."""
    streams = (*outgoing(scenario, ""), *incoming(scenario, ""))
    return {stream.topic for stream in streams} | made_topics(scenario)


def _hint_of_objects(name: str, scenario: Scenario) -> str:
    entities = static_entities(scenario, {})
    actors = [actor.name for actor in scenario.world.actors]
    return did_you_mean(name, [*entities, *actors, *(v.name for v in scenario.vehicles)])
