# SPDX-License-Identifier: Apache-2.0
"""The same drive with other sensors: which have to be simulated again, and one file of both.

Everything is derived from recordings; nothing is run here.
"""

import heapq
from collections.abc import Iterator
from pathlib import Path

import msgspec
from msgspec.structs import replace

from groundlink.bus.topics import sensor_outputs
from groundlink.core.errors import UserError
from groundlink.episode import journal as journals
from groundlink.ros.base import Base, is_latched, made_topics
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.streams import faults_topic, missing_readings_topic
from groundlink.scenario import Scenario

from . import metadata
from .differences import first_difference
from .reader import RecordedMessage, Recording
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
    if found := scenario_difference(_as_seen_in(given, recorded), recorded):
        raise UserError(
            f"the scenario differs from the recorded one in more than sensors, weather and light: "
            f"{found}. Fix: give the recorded scenario and change those, or record another run"
        )


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


def write_resimulated(
    recording: Recording, again: Recording | None, given: Scenario, out: Path
) -> tuple[int, int]:
    """Write a recording with the readings of some sensors from a repeated run.

    Parameters
    ----------
    again
        recording of a repeated run, in which the sensors of `sensors_to_simulate` ran; None if none
        had to.
    given
        scenario of the new file, with its sensors.
    out
        path of a new file.

    Returns
    -------
    tuple[int, int]
        counts of copied and of new messages.

    Raises
    ------
    FileExistsError
        when there is a file.
    """
    before = recording.run.scenario
    simulated = sensors_to_simulate(before, given) if again else []
    names = {*before.sensor_names(), *simulated}
    of_sensors = {topic for name in names for topic in _topics(before, name)}
    kept_sensors = set(given.sensor_names()) - set(simulated)
    kept = {topic for name in kept_sensors for topic in _topics(given, name)}
    new = {topic for name in simulated for topic in _topics(given, name)}
    made = made_topics(given)
    if _read_by_bases(given) & {*simulated}:
        new |= made
    elif again is not None:
        new |= {topic for topic in made if is_latched(topic)}
    replaced = (of_sensors - kept) | new | {DIAGNOSTICS_TOPIC}
    copied = [topic for topic in recording.types if topic not in replaced]
    rates = {topic: facts.declared_hz for topic, facts in recording.topics.items()}
    file = RosFile(out)
    try:
        run = replace(recording.run, scenario=_as_seen_in(before, given))
        file.mcap.add_metadata(metadata.RUN_RECORD, metadata.run_entries(run))
        for topic in copied:
            file.topic(topic, recording.types[topic], latched=is_latched(topic))
        if again is not None:
            rates |= {topic: facts.declared_hz for topic, facts in again.topics.items()}
            for topic in sorted(new & again.types.keys()):
                file.topic(topic, again.types[topic], latched=is_latched(topic))
        counts = [0, 0]
        messages = _merged(recording, copied, again, sorted(new))
        for number, (is_new, message) in enumerate(messages):
            topic, ros_type = message.topic, message.ros_type
            written = file.topic(topic, ros_type, latched=is_latched(topic))
            written.write(message.nanos, memoryview(message.cdr))
            counts[is_new] += 1
            if number % COMMIT_MESSAGES == 0:
                file.commit(rates)
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


def _merged(
    recording: Recording, copied: list[str], again: Recording | None, new: list[str]
) -> Iterator[tuple[bool, RecordedMessage]]:
    """Yield messages of both recordings in order of time, and whether each is new."""
    first, last = recording.first_nanos, recording.last_nanos
    old = ((False, message) for message in recording.read(copied)) if copied else iter(())
    added = (
        (True, message)
        for message in (again.read(new) if again and new else ())
        if first <= message.nanos <= last
    )
    return heapq.merge(old, added, key=lambda pair: pair[1].nanos)
