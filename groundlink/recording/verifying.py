# SPDX-License-Identifier: Apache-2.0
"""Verification of a recording: what can be compared with a repeated run, and how to repeat it.

Everything is derived from the recording; nothing is run here.
"""

from collections.abc import Iterator

import msgspec
from msgspec.structs import replace

from groundlink.bus.topics import sensor_outputs
from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ, Schedule
from groundlink.core.errors import UserError
from groundlink.episode import journal as journals
from groundlink.episode.fault_messages import Faults
from groundlink.messages.base import Command
from groundlink.messages.navigation import JointState
from groundlink.ros.base import made_topics
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.streams import CLOCK_TOPIC, faults_topic, incoming, missing_readings_topic
from groundlink.scenario import Scenario
from groundlink.scenario.faults import Fault
from groundlink.scene.build import world_hash
from groundlink.scene.loaded_world import in_present_world

from .comparison import ComparedSpan
from .differences import Difference, first_difference
from .metadata import versions
from .missing_readings import messages_of
from .reader import RecordedMessage, Recording

UNDER_WAY_NANOS = NANOS
"""Maximum time in transit at the end of a recording that was ended early, and until all
subscriptions of a late recorder are active."""

ENDLESS_TICK = 2**62
"""Beyond any run."""


def compared_span(recording: Recording) -> ComparedSpan:
    """Return the comparable span of a recording, up to its end or that of its journal.

    Raises
    ------
    UserError
        when nothing can be compared.
    """
    clock = recording.topics.get(CLOCK_TOPIC)
    if clock is None or not clock.messages:
        raise UserError(f"{recording.path}: no messages recorded; expected at least /clock")
    first, end = clock.first_nanos, recording.end_nanos
    begun = first if first == recording.run.epoch_nanos else first + UNDER_WAY_NANOS
    if end is None:
        found = ComparedSpan(first, clock.last_nanos + 1, begun, clock.last_nanos - UNDER_WAY_NANOS)
    else:
        found = ComparedSpan(first, end, begun, end)
    journal = recording.journal
    known_nanos = journal.epoch_nanos + journal.tick * TICK_NANOS if journal else clock.last_nanos
    if known_nanos < clock.last_nanos:
        end = min(found.end_nanos, known_nanos - UNDER_WAY_NANOS)
        found = ComparedSpan(first, end, begun, end)
    if found.end_nanos <= found.first_nanos:
        raise UserError(f"{recording.path}: too short to compare. Fix: record longer")
    return found


def in_recorded_world(recording: Recording, scenario: Scenario) -> Scenario:
    """Return a scenario in the world of the recording, if that was loaded into the run."""
    journal = recording.journal
    if journal is None or not journal.in_loaded_world:
        return scenario
    return in_present_world(scenario, journal.scenario)


def silent_sensors(recording: Recording, scenario: Scenario) -> list[str]:
    """Return the sensors without any recorded message."""
    recorded = {name for name, topic in recording.topics.items() if topic.messages}
    return [
        name for name in scenario.sensor_names() if recorded.isdisjoint(_topics(scenario, name))
    ]


def _topics(scenario: Scenario, sensor: str) -> list[str]:
    """Return the recorded topics of a sensor."""
    pair = scenario.sensor(sensor)
    outputs = sensor_outputs(pair[1]) if pair else []
    return [*(output.ros_topic for output in outputs), faults_topic(sensor)]


def with_later_vehicles(recording: Recording, scenario: Scenario) -> Scenario:
    """Return a scenario with the vehicles added before the recording began."""
    known = {vehicle.name for vehicle in recording.started_as.vehicles}
    later = (v for v in recording.run.scenario.vehicles if v.name not in known)
    return replace(scenario, vehicles=(*scenario.vehicles, *later))


def later_sensors(recording: Recording) -> list[str]:
    """Return the sensors of vehicles added later, which are not started."""
    known = recording.started_as.sensor_names()
    return [name for name in recording.run.scenario.sensor_names() if name not in known]


def not_compared(recording: Recording) -> dict[str, str]:
    """Return the topics that are not compared, with the reason of each."""
    scenario, run = recording.run.scenario, recording.run.run
    found = {DIAGNOSTICS_TOPIC: "counters and durations of processes, which differ between runs"}
    found |= dict.fromkeys(
        made_topics(scenario), "computed from the scenario and from compared topics"
    )
    for stream in incoming(scenario, run):
        why = "an input of the run, applied again from the recording"
        found[stream.topic] = why if stream.is_command else "from ROS"
    for vehicle in scenario.vehicles:
        found |= dict.fromkeys((s.topic for s in vehicle.streams), "from another process")
    for name in scenario.sensor_names():
        found[missing_readings_topic(name)] = "missing readings of the recorded run"
    for vehicle in scenario.vehicles:
        for spec in vehicle.sensors:
            topic = faults_topic(f"{vehicle.name}/{spec.name}")
            changes = {tick for fault in spec.faults for tick in (fault.begin_tick, fault.end_tick)}
            if any(news.tick not in changes for news in messages_of(recording, topic, Faults)):
                found[topic] = "published by a process that joined late"
    for name in live_faults(recording):
        found[faults_topic(name)] = "changed during the run; the repeated run has it from the start"
    of_sensors = dict.fromkeys(
        silent_sensors(recording, scenario), "no messages of this sensor recorded"
    )
    of_sensors |= dict.fromkeys(
        later_sensors(recording), "of a vehicle that was added during the run"
    )
    for name, why in of_sensors.items():
        found |= dict.fromkeys(_topics(scenario, name), why)
    return {topic: why for topic, why in sorted(found.items()) if topic in recording.types}


def compared_messages(recording: Recording) -> Iterator[RecordedMessage]:
    """Yield the messages that must be repeated, in order of time."""
    ignored, run = not_compared(recording), recording.run
    due = Schedule.at(run.scenario.time.clock_rate_hz)
    for recorded in recording.read([topic for topic in recording.types if topic not in ignored]):
        # A restored run publishes its clock at once, even if none is due.
        is_clock = recorded.topic == CLOCK_TOPIC
        if not is_clock or _is_due(due, (recorded.nanos - run.epoch_nanos) // TICK_NANOS):
            yield recorded


def _is_due(schedule: Schedule, tick: int) -> bool:
    later = schedule.first_at_or_after(tick)
    return tick in (schedule.tick(later - 1), schedule.tick(later))


def live_faults(recording: Recording) -> dict[str, tuple[Fault, ...]]:
    """Return all faults of sensors whose faults were changed at run time."""
    found = {}
    for vehicle in recording.run.scenario.vehicles:
        for sensor in vehicle.sensors:
            name = f"{vehicle.name}/{sensor.name}"
            faults = _merged(sensor.faults, messages_of(recording, faults_topic(name), Faults))
            if faults != sensor.faults:
                found[name] = faults
    return found


def _merged(known: tuple[Fault, ...], reports: Iterator[Faults]) -> tuple[Fault, ...]:
    """Return faults that reproduce the reported ones at every tick."""
    for news in reports:
        known = (*known, *(fault for fault in news.active if fault not in known))
        known = tuple(
            replace(fault, for_s=(news.tick - fault.begin_tick) / TICK_RATE_HZ)
            if fault.is_on(news.tick) and fault not in news.active
            else fault
            for fault in known
        )
    return known


def replay_journal(recording: Recording, scenario: Scenario) -> journals.Journal:
    """Return the journal that repeats the recorded run with a scenario."""
    changed = live_faults(recording)
    vehicles = tuple(
        replace(
            vehicle,
            sensors=tuple(
                replace(sensor, faults=changed.get(f"{vehicle.name}/{sensor.name}", sensor.faults))
                for sensor in vehicle.sensors
            ),
        )
        for vehicle in scenario.vehicles
    )
    checkpoint_s = recording.started_as.time.checkpoint_s
    time = replace(
        scenario.time,
        mode="fast",
        lockstep="sensors",
        overload="slow",
        checkpoint_s=checkpoint_s,
    )
    again = replace(scenario, vehicles=vehicles, time=time)
    # Messages in transit at the end need further ticks.
    journal = recording.journal or _guessed(recording)
    return replace(journal, scenario=again, acks={}, tick=ENDLESS_TICK)


def _guessed(recording: Recording) -> journals.Journal:
    """Return a journal with each command applied at its stamp, as in fast runs."""
    run, entries = recording.run, []
    streams = {s.topic: s for s in incoming(run.scenario, run.run) if s.is_command}
    for recorded in recording.read([*streams]):
        stream = streams[recorded.topic]
        vehicle = stream.key.split("/")[2]
        nanos = recorded.nanos - run.epoch_nanos
        tick = nanos // TICK_NANOS
        if stream.message is JointState:
            joints = from_cdr(recorded.cdr, JointState, Moment(nanos, 0))
            joints = replace(joints, stamp_nanos=nanos)
            entries.append(journals.encode_entry(journals.JointsCommanded(tick, vehicle, joints)))
        else:
            command = from_cdr(recorded.cdr, Command, Moment(nanos, 0))
            entries.append(journals.encode_entry(journals.Commanded(tick, vehicle, command)))
    return journals.Journal(
        made_on=journals.this_platform(),
        run=run.run,
        episode=0,
        epoch_nanos=run.epoch_nanos,
        scenario=run.scenario,
        tick=0,
        digest="",
        entries=tuple(entries),
    )


def scenario_difference(recorded: Scenario, given: Scenario) -> Difference | None:
    """Return the first relevant difference between scenarios, or None."""
    alike = replace(
        given,
        name=recorded.name,
        description=recorded.description,
        gateway=recorded.gateway,
        expect=recorded.expect,
        time=replace(recorded.time, clock_rate_hz=given.time.clock_rate_hz),
    )
    return first_difference(*(msgspec.to_builtins(each) for each in (recorded, alike)))


def caveats(recording: Recording, scenario: Scenario, extent: ComparedSpan) -> Iterator[str]:
    """Yield the differences from the conditions of the recording, and their consequences."""
    run, journal, then = recording.run, recording.journal, recording.started_as
    if then.name != scenario.name:
        yield f"scenario name differs: `{then.name}` recorded, `{scenario.name}` given"
    if found := scenario_difference(then, scenario):
        yield f"scenario differs: {found}"
    if journal and journal.in_loaded_world:
        yield f"the world `{then.world.name}` was loaded during the run; the run is repeated in it"
    if world_hash(then) != world_hash(scenario):
        yield "world hash differs: most messages may differ"
    if then.world != run.scenario.world:
        changes = journal and any(
            isinstance(entry, journals.WorldChanged) for entry in journal.read()
        )
        yield "the world had been changed before the recording began; " + (
            "the journal repeats the changes"
            if changes
            else "the journal begins at a later reset, so the changes are not repeated"
        )
    here = versions()
    others = [f"{name} {v}" for name, v in run.versions.items() if here.get(name) != v]
    if journal and journal.made_on.processor != journals.this_platform().processor:
        others.insert(0, journal.made_on.processor)
    if others:
        yield f"recorded with {', '.join(others)}; last digits may differ on this host"
    epoch_nanos = run.epoch_nanos
    if journal is None:
        yield "no journal: commands are applied at their stamps, world changes are not repeated"
    if extent.first_nanos > epoch_nanos:
        seconds = (extent.first_nanos - epoch_nanos) / NANOS
        yield f"the recording begins at {seconds:.3f} s: earlier messages are not compared"
    if recording.end_nanos is None:
        seconds = (extent.end_nanos - epoch_nanos) / NANOS
        yield f"the recording was ended early: compared up to {seconds:.3f} s"
    if absent := silent_sensors(recording, scenario):
        yield f"no messages recorded of {', '.join(absent)}: not started, not compared"
    for sensor, faults in live_faults(recording).items():
        kinds = ", ".join(fault.kind for fault in faults) or "none"
        yield f"faults of `{sensor}` were changed during the run and are repeated: {kinds}"
