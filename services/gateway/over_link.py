# SPDX-License-Identifier: Apache-2.0
"""Process ``python -m services.gateway.over_link RUN.mcap``: a recording as ROS receives it.

The messages of a recorded run pass the bridge's sender, the scenario's emulated link and the
bridge's receiver in virtual time, so the same recording always gives the same bytes. Processing
takes no time. Log times of the new file are times of arrival, and its diagnostics have what the
gateway would report. The judge needs ground truth, so that is copied.
"""

import argparse
import heapq
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import NamedTuple

from groundlink.bus.core_topics import GATEWAY
from groundlink.bus.topics import sensor_outputs
from groundlink.core.atomic_file import write_atomically
from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ, exact
from groundlink.core.extras import process_needs
from groundlink.emulation.model import LinkDirection
from groundlink.emulation.script import DIRECTIONS, LinkScript, ScriptPlayer
from groundlink.messages.base import BusMessage, Health
from groundlink.process import runner as process
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.faults import Delay

with process_needs(GATEWAY, "gateway"):
    from groundlink.ros.base import Bases, is_latched
    from groundlink.ros.cdr import ros_type_of
    from groundlink.ros.streams import outgoing
    from udp_bridge import Message
    from udp_bridge.wire.typed import pack_typed, parse_typed
    from udp_bridge.wire.types import TYPED

    from .reports import PeerReports, peer_counters
    from .streams import queue_limits, repair_table, wire_type
    from .subscribers import TopicKey
    from .virtual_link import VirtualLink

with process_needs(GATEWAY, "record"):
    from groundlink.recording import metadata
    from groundlink.recording.reader import RecordedMessage, Recording
    from groundlink.recording.ros_channels import RosFile
    from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, diagnostics

PERIOD_NANOS = NANOS
"""Interval of reports, and of latched messages."""

COMMIT_MESSAGES = 4096


class _Carried(NamedTuple):
    """A topic that the gateway sends to ROS unasked."""

    key: TopicKey
    ros_type: str
    declared_hz: float | None
    sensor: SensorSpec | None

    def sent_nanos(self, stamp_nanos: int, epoch_nanos: int) -> int:
        """Return when a message with this stamp is complete, with the delays of faults."""
        if self.sensor is None:
            return stamp_nanos
        tick = (stamp_nanos - epoch_nanos) // TICK_NANOS
        late_ticks = sum(
            math.ceil(exact(fault.delay_s) * TICK_RATE_HZ)
            for fault in self.sensor.faults
            if isinstance(fault, Delay) and fault.is_on(tick)
        )
        return stamp_nanos + round(self.sensor.measuring_s * NANOS) + late_ticks * TICK_NANOS


def _carried(scenario: Scenario, run: str, bases: Bases) -> dict[str, _Carried]:
    """Return the topics that the gateway sends unasked, by name."""
    sensors = {
        output.ros_topic: sensor
        for vehicle in scenario.vehicles
        for sensor in vehicle.sensors
        for output in sensor_outputs(sensor)
    }
    made: list[tuple[str, type[BusMessage], float | None]]
    made = [(s.topic, s.message, s.declared_hz) for s in outgoing(scenario, run) if s.push]
    made += [(topic, message, rate_hz) for topic, message, rate_hz in bases.topics]
    made += [(topic, message, None) for topic, message in bases.latched.items()]
    return {
        topic: _Carried(
            (wire_type(message), topic), ros_type_of(message), rate_hz, sensors.get(topic)
        )
        for topic, message, rate_hz in made
    }


class RecordedLink:
    """Messages of a recorded run on their way over an emulated link.

    Parameters
    ----------
    recording
        recording of `groundlink record`.
    script
        the link, by sim time.
    """

    def __init__(self, recording: Recording, script: LinkScript) -> None:
        scenario, run = recording.run.scenario, recording.run.run
        settings, streams, bases = scenario.gateway, outgoing(scenario, run), Bases(scenario, run)
        self._recording, self._epoch_nanos = recording, recording.run.epoch_nanos
        self._carried = _carried(scenario, run, bases)
        self._truths = {topic for v in scenario.vehicles for topic in scenario.true_topics(v)}
        self._script = ScriptPlayer(script)
        to_ros, from_ros = (
            LinkDirection[None](getattr(script, name), seed=script.seed, direction=name)
            for name in DIRECTIONS
        )
        self._link = VirtualLink(
            recording.first_nanos,
            to_ros,
            from_ros,
            datagram=settings.datagram,
            repair=repair_table(streams),
            signed_peer=settings.signed_peer,
            limits=queue_limits(streams),
        )
        rates = {c.key: c.declared_hz for c in self._carried.values() if c.declared_hz is not None}
        self._reports = PeerReports(rates, stamps_follow_wall=True)
        self._waiting: list[tuple[int, int, Message]] = []
        """Messages that are not complete yet: when they are sent, number, message."""

        self._numbers = count()
        self._repeated = frozenset(bases.latched)
        self._latched: dict[str, Message] = {}
        self._sent_nanos: dict[str, int] = {}
        """By topic: when its newest message is sent."""

        self._next_nanos = recording.first_nanos + PERIOD_NANOS

    def messages(self) -> Iterator[RecordedMessage]:
        """Yield what ROS receives, the reports of the gateway, and what is copied, by time."""
        for message in self._recording.read():
            yield from self._until(message.nanos)
            carried = self._carried.get(message.topic)
            if carried is not None:
                self._put(message, carried)
            is_copied = message.topic in self._truths or carried is None
            if is_copied and message.topic != DIAGNOSTICS_TOPIC:
                yield message
        yield from self._until((self._recording.end_nanos or self._recording.last_nanos + 1) - 1)

    def _put(self, message: RecordedMessage, carried: _Carried) -> None:
        """Let a message be sent as soon as it is complete, and after those before it."""
        nanos = max(
            carried.sent_nanos(message.nanos, self._epoch_nanos),
            self._sent_nanos.get(message.topic, 0),
        )
        self._sent_nanos[message.topic] = nanos
        msg_type, topic = carried.key
        is_typed = msg_type == TYPED
        body = pack_typed(carried.ros_type, message.cdr) if is_typed else message.cdr
        sent = Message(msg_type, topic, "", message.nanos, 0, body)
        if topic in self._repeated:
            self._latched[topic] = sent
        heapq.heappush(self._waiting, (nanos, next(self._numbers), sent))

    def _until(self, nanos: int) -> Iterator[RecordedMessage]:
        """Send what is due up to an instant, and yield what arrives."""
        while True:
            sent_nanos = self._waiting[0][0] if self._waiting else nanos + 1
            due_nanos = min(sent_nanos, self._next_nanos)
            if due_nanos > nanos:
                break
            yield from self._arrived(due_nanos)
            if due_nanos == self._next_nanos:
                yield from self._periodic()
            else:
                self._set(due_nanos)
                self._link.queue.put(heapq.heappop(self._waiting)[2])
        yield from self._arrived(nanos)

    def _set(self, nanos: int) -> None:
        settings = self._script.at((nanos - self._epoch_nanos) / NANOS)
        self._link.there.settings, self._link.back.settings = (settings[d] for d in DIRECTIONS)

    def _arrived(self, nanos: int) -> Iterator[RecordedMessage]:
        """Advance to an instant; yield what arrives at the ROS node until then."""
        self._link.advance(nanos - self._link.now_nanos)
        for message, at_nanos in self._link.handed:
            carried = self._carried.get(message.topic)
            if carried is None or message.topic in self._truths:
                continue
            is_typed = message.msg_type == TYPED
            offset = parse_typed(message.body).offset if is_typed else 0
            yield RecordedMessage(
                at_nanos, message.topic, carried.ros_type, bytes(message.body[offset:])
            )
        self._link.handed.clear()

    def _periodic(self) -> Iterator[RecordedMessage]:
        """Do what both ends do every second; yield the report of the gateway."""
        nanos = self._next_nanos
        self._next_nanos += PERIOD_NANOS
        self._link.report()
        self._link.advance(0)  # without a delay the report is there at once
        for message in self._latched.values():
            self._link.queue.put(message)
        self._reports.link = self._link.link_report
        streams = self._reports.streams(self._link.queue.delivery.counts(nanos))
        counters = peer_counters(self._reports.link) | {
            f"link_{name}_{outcome}": number
            for name, way in zip(DIRECTIONS, (self._link.there, self._link.back), strict=True)
            for outcome, number in way.counts.items()
        }
        tick = (nanos - self._epoch_nanos) // TICK_NANOS
        health = Health(GATEWAY, 0, tick, counters, tuple(streams))
        yield RecordedMessage(
            nanos, DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, bytes(diagnostics(nanos, [health]))
        )


def write_over_link(
    recording: Recording,
    script: LinkScript,
    out: Path,
    show: Callable[[float], object] = lambda share: None,
) -> None:
    """Write a recording as ROS receives it to a new file; `show` gets the share that is done.

    Its journal is left out: a run that repeats it would give other log times.
    """
    first, span = recording.first_nanos, max(recording.last_nanos - recording.first_nanos, 1)
    file = RosFile(out)
    try:
        file.mcap.add_metadata(metadata.RUN_RECORD, metadata.run_entries(recording.run))
        for topic, ros_type in recording.types.items():
            file.topic(topic, ros_type, latched=is_latched(topic))
        rates = {topic: facts.declared_hz for topic, facts in recording.topics.items()}
        for number, message in enumerate(RecordedLink(recording, script).messages()):
            written = file.topic(message.topic, message.ros_type, latched=is_latched(message.topic))
            written.write(message.nanos, memoryview(message.cdr))
            if number % COMMIT_MESSAGES == 0:
                file.commit(rates)
                show((message.nanos - first) / span)
        file.lacks(recording.dropped)
        if recording.end_nanos is not None:
            file.end(recording.end_nanos)
        file.commit(rates)
    finally:
        file.close()


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Replace a recording by what ROS receives over its emulated link; print shares done."""
    parser = argparse.ArgumentParser(
        prog=GATEWAY, description="Send a recorded run over its emulated link, in virtual time."
    )
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="file to replace")
    options = parser.parse_args(arguments)
    with Recording(options.recording) as recording, write_atomically(options.recording) as part:
        script = recording.run.scenario.gateway.link
        write_over_link(
            recording, script or LinkScript(), part, lambda share: print(share, flush=True)
        )


if __name__ == "__main__":
    process.run(GATEWAY, main)
