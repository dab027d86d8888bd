# SPDX-License-Identifier: Apache-2.0
"""The same drive with other sensors: which have to be simulated again, and one file of both.

Everything is derived from recordings; nothing is run here.
"""

import heapq
import itertools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from groundlink.bus.pipe import PipedMessage
from groundlink.bus.topics import sensor_outputs
from groundlink.core.errors import UserError
from groundlink.episode import journal as journals
from groundlink.ros.base import Base, is_latched, made_topics
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.streams import faults_topic, missing_readings_topic
from groundlink.scenario import Scenario

from . import metadata
from .differences import first_difference
from .reader import Recording
from .repeated_readings import RepeatedReadings
from .ros_channels import RosFile
from .verifying import scenario_difference

COMMIT_MESSAGES = 4096
"""Messages that are kept in memory before they are written."""


def check_drive(recorded: Scenario, given: Scenario) -> None:
    """Check that two scenarios differ in sensors, weather and light only.

    Raises
    ------
    UserError
        when anything else differs: the vehicles would drive another way.
    """
    if found := scenario_difference(recorded, _as_seen_in(given, recorded)):
        raise UserError(
            f"the scenario differs from the recorded one in more than sensors, weather and light: "
            f"{found}. Fix: change those only (noise by the `seed` of a sensor), or record a run"
        )


def have_same_drive(one: Scenario, other: Scenario) -> bool:
    """Return whether two scenarios differ in sensors, weather and light at most."""
    return _as_seen_in(other, one) == one


def sensors_to_simulate(recorded: Scenario, given: Scenario) -> list[str]:
    """Return the sensors of a scenario whose readings are not those of the recorded one.

    With another weather or light these are all. Else they are the changed ones and those that read
    a changed one; if a base driver reads one of them, also all others that base drivers read, since
    `/tf` has parts of several.
    """
    before = {name: recorded.sensor(name) for name in recorded.sensor_names()}
    if _surroundings(recorded) != _surroundings(given):
        return given.sensor_names()
    changed = set()
    for name in given.sensor_names():
        was, now = before.get(name), given.sensor(name)
        assert now
        if was is None or first_difference(*(msgspec.to_builtins(pair[1]) for pair in (was, now))):
            changed.add(name)
    for vehicle in given.vehicles:
        for sensor in vehicle.sensors:
            if f"{vehicle.name}/{getattr(sensor, 'encoders', '')}" in changed:
                changed.add(f"{vehicle.name}/{sensor.name}")
    read_by_bases = _read_by_bases(given)
    if changed & read_by_bases or _read_by_bases(recorded) - read_by_bases:
        changed |= read_by_bases
    return [name for name in given.sensor_names() if name in changed]


def _read_by_bases(scenario: Scenario) -> set[str]:
    """Return the sensors from whose readings base drivers make messages."""
    found = set()
    for vehicle in scenario.vehicles:
        keys = {*Base(scenario, vehicle, "").keys.values()}
        for sensor in vehicle.sensors:
            of_sensor = (
                output.row.key_in("", vehicle=vehicle.name, sensor=sensor.name)
                for output in sensor_outputs(sensor)
            )
            if not keys.isdisjoint(of_sensor):
                found.add(f"{vehicle.name}/{sensor.name}")
    return found


def _topics(scenario: Scenario, sensor: str) -> set[str]:
    """Return all recorded topics of a sensor; none if the scenario lacks it."""
    if (pair := scenario.sensor(sensor)) is None:
        return set()
    outputs = {output.ros_topic for output in sensor_outputs(pair[1])}
    return {*outputs, faults_topic(sensor), missing_readings_topic(sensor)}


def _as_seen_in(scenario: Scenario, given: Scenario) -> Scenario:
    """Return a scenario with the sensors, weather and light of another one."""
    sensors = {vehicle.name: vehicle.sensors for vehicle in given.vehicles}
    vehicles = tuple(
        replace(vehicle, sensors=sensors.get(vehicle.name, vehicle.sensors))
        for vehicle in scenario.vehicles
    )
    world = replace(scenario.world, weather=given.world.weather, light=given.world.light)
    return replace(scenario, vehicles=vehicles, world=world)


def _surroundings(scenario: Scenario) -> tuple[object, ...]:
    """Return what sensors feel of a world, and vehicles do not."""
    return scenario.world.weather, scenario.world.light


def end_nanos(recording: Recording) -> int:
    """Return the first stamp that a recording does not have."""
    return recording.end_nanos or recording.last_nanos + 1


class TopicPlan(NamedTuple):
    """Where the topics of a resimulated recording come from."""

    sensors: list[str]
    """Sensors that are simulated, as `vehicle/sensor`."""

    copied: list[str]
    """Topics that are copied."""

    simulated: set[str]
    """Topics of the repeated run, without the latched ones."""

    latched: set[str]
    """Topics that are made from the scenario alone."""


def topic_plan(recording: Recording, given: Scenario) -> TopicPlan:
    """Return the plan of a recording with the sensors of another scenario."""
    before = recording.run.scenario
    sensors = sensors_to_simulate(before, given)
    of_sensors = {
        topic for name in {*before.sensor_names(), *sensors} for topic in _topics(before, name)
    }
    kept_sensors = set(given.sensor_names()) - set(sensors)
    kept = {topic for name in kept_sensors for topic in _topics(given, name)}
    new = {topic for name in sensors for topic in _topics(given, name)}
    made = made_topics(given)
    latched = {topic for topic in made if is_latched(topic)}
    if _read_by_bases(given) & {*sensors}:
        new |= made
    replaced = (of_sensors - kept) | new | latched | {DIAGNOSTICS_TOPIC}
    copied = [topic for topic in recording.types if topic not in replaced]
    return TopicPlan(sensors, copied, new - latched, latched)


def separate_parts(plan: TopicPlan, given: Scenario) -> list[TopicPlan]:
    """Return the parts of a plan that can be simulated one by one, without the copied topics.

    Each sensor is a part, but those that base drivers read are one part with what is made of them.
    """
    read = _read_by_bases(given)
    together = [name for name in plan.sensors if name in read]
    alone = [[name] for name in plan.sensors if name not in read]
    of_sensors = set().union(*(_topics(given, name) for name in plan.sensors))
    parts = []
    for sensors in [together, *alone] if together else alone:
        topics = set().union(*(_topics(given, name) for name in sensors)) & plan.simulated
        topics |= plan.simulated - of_sensors if sensors is together else set()
        parts.append(TopicPlan(sensors, [], topics, set()))
    return parts


def write_resimulated(
    recording: Recording,
    again: RepeatedReadings,
    messages: Iterable[PipedMessage],
    given: Scenario,
    out: Path,
    show: Callable[[float], None] = lambda share: None,
) -> tuple[int, int]:
    """Write a recording with the readings of some sensors from a repeated run.

    Parameters
    ----------
    again
        reader of the repeated run.
    messages
        messages of the repeated run from its start, in which the sensors of `sensors_to_simulate`
        run; none if there are none.
    given
        scenario of the new file, with its sensors.
    out
        path of a new file.
    show
        receives the share that is done, 0 to 1.

    Returns
    -------
    tuple[int, int]
        counts of copied and of new messages.

    Raises
    ------
    FileExistsError
        when there is a file.
    """
    before, plan = recording.run.scenario, topic_plan(recording, given)
    copied, new = plan.copied, plan.simulated | plan.latched
    first, end = recording.first_nanos, recording.end_nanos or recording.last_nanos + 1
    added = itertools.chain(
        again.latched(first),
        again.read(messages, plan.simulated, plan.sensors, end) if plan.sensors else (),
    )
    rates = again.declared_hz | {t: facts.declared_hz for t, facts in recording.topics.items()}
    rates |= {topic: again.declared_hz.get(topic) for topic in new - plan.latched}
    file = RosFile(out)
    try:
        run = replace(recording.run, scenario=_as_seen_in(before, given))
        file.mcap.add_metadata(metadata.RUN_RECORD, metadata.run_entries(run))
        for topic in copied:
            file.topic(topic, recording.types[topic], latched=is_latched(topic))
        for topic in sorted(new & again.types.keys()):
            file.topic(topic, again.types[topic], latched=is_latched(topic))
        counts = [0, 0]
        old = ((False, message) for message in recording.read(copied)) if copied else iter(())
        news = ((True, message) for message in added if message.nanos >= first)
        merged = heapq.merge(old, news, key=lambda pair: pair[1].nanos)
        for number, (is_new, message) in enumerate(merged):
            topic, ros_type = message.topic, message.ros_type
            written = file.topic(topic, ros_type, latched=is_latched(topic))
            written.write(message.nanos, memoryview(message.cdr))
            counts[is_new] += 1
            if number % COMMIT_MESSAGES == 0:
                file.commit(rates)
                show((message.nanos - first) / (end - first))
        if recording.journal is not None:
            scenario = _as_seen_in(recording.journal.scenario, given)
            journal = replace(recording.journal, scenario=scenario)
            file.add_journal(recording.last_nanos, journals.dumped(journal))
        file.lacks({t: count for t, count in recording.dropped.items() if t in copied})
        if recording.end_nanos is not None:
            file.end(recording.end_nanos)
        file.commit(rates)
    finally:
        file.close()
    return counts[0], counts[1]
