# SPDX-License-Identifier: Apache-2.0
"""Analysis of a recording in one pass, and in another one that judges expectations.

Of each topic only what the page shows is decoded: one cloud of each LiDAR, every n-th sample of an
IMU. Memory does not grow with the file.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError

from groundlink.core.clock import NANOS
from groundlink.episode.mission import Mission
from groundlink.episode.mission_tracker import MissionTracker, world_box
from groundlink.expectations.results import ExpectationResult
from groundlink.messages.ground_truth import Vitals
from groundlink.recording.judging import judged
from groundlink.recording.metadata import RunFacts
from groundlink.recording.reader import RecordedMessage, Recording
from groundlink.report.analysis.thumbnails import IMAGE_TYPES, CameraThumbnails
from groundlink.ros.diagnostics import (
    DIAGNOSTICS_TOPIC,
    from_faults,
    from_missing_readings,
    from_vitals,
)
from groundlink.ros.streams import faults_topic, missing_readings_topic
from groundlink.ros.types import STORE
from groundlink.scenario.every_sensor import SensorSpec

from .completeness import StreamCompleteness, stream_completeness
from .diagnostics import RunDiagnostics, SensorFaultHistory
from .energy import MAX_POINTS as ENERGY_POINTS
from .energy import Energy
from .motion import VehicleMotion, stride
from .sensors import MAX_SAMPLES, CloudSample, Readings, readings_of
from .streams import StreamTimes

PROGRESS_MESSAGES = 2_000
"""Messages between progress updates."""


@dataclass
class RunSummary:
    """Analyzed run."""

    path: Path
    size_bytes: int
    run: RunFacts
    first_nanos: int
    last_nanos: int
    messages: int
    streams: list[StreamTimes]
    motions: list[VehicleMotion]
    energies: list[Energy]
    missions: list[Mission]
    """Verdicts on the vehicles whose ground truth was recorded."""

    expectations: list[ExpectationResult]
    """Verdicts on the expectations of the scenario."""

    readings: dict[str, list[Readings]]
    """Plotted readings by vehicle."""

    cameras: list[CameraThumbnails]
    failures: list[SensorFaultHistory]
    completeness: list[StreamCompleteness]
    diagnostics: RunDiagnostics
    undecodable: int
    """Messages that do not match the type of their topic."""

    def seconds(self, nanos: int) -> float:
        """Return sim time from a stamp: seconds since the run's start."""
        return (nanos - self.run.epoch_nanos) / NANOS

    @property
    def duration_seconds(self) -> float:
        """From the first message to the last."""
        return (self.last_nanos - self.first_nanos) / NANOS


def gather(recording: Recording, progress: Callable[[float], object]) -> RunSummary:
    """Read a recording; `progress` is called with the share that is read, 0..1."""
    taking = _Taking(recording)
    span = max(recording.last_nanos - recording.first_nanos, 1)
    for number, message in enumerate(recording.read()):
        taking.take(message)
        if number % PROGRESS_MESSAGES == 0:
            progress((message.nanos - recording.first_nanos) / span)
    progress(1.0)
    missions = [tracker.mission() for tracker in taking.trackers]
    taking.gathered.missions = [mission for mission in missions if mission.seconds]
    taking.gathered.expectations = judged(recording, recording.run.scenario)
    return taking.gathered


class _Taking:
    """Dispatches messages to the parts of the summary."""

    def __init__(self, recording: Recording) -> None:
        run = recording.run
        times = {"first_nanos": recording.first_nanos, "last_nanos": recording.last_nanos}
        counted = recording.topics
        streams = {}
        for topic, ros_type in sorted(recording.types.items()):
            declared = counted[topic].declared_hz if topic in counted else None
            streams[topic] = StreamTimes(topic, ros_type, declared, **times)
        self._streams = streams
        self._handlers: dict[str, Callable[[RecordedMessage], None]] = {}
        self.gathered = RunSummary(
            path=recording.path,
            size_bytes=recording.path.stat().st_size,
            run=run,
            **times,
            messages=recording.messages,
            streams=list(streams.values()),
            motions=[],
            energies=[],
            missions=[],
            expectations=[],
            readings={},
            cameras=[],
            failures=[],
            completeness=stream_completeness(run.scenario, **times, epoch_nanos=run.epoch_nanos),
            diagnostics=RunDiagnostics(),
            undecodable=0,
        )
        self.trackers: list[MissionTracker] = []
        box = world_box(run.scenario)
        self._counted = expected = {name: facts.messages for name, facts in counted.items()}
        for vehicle in run.scenario.vehicles:
            truth = run.scenario.ground_truth_topic(vehicle)
            vitals = run.scenario.vitals_topic(vehicle)
            motion = VehicleMotion(vehicle.name, stride(expected.get(truth, 0)))
            energy = Energy(vehicle.name, -(-expected.get(vitals, 0) // ENERGY_POINTS) or 1)
            asked = stride(expected.get(vehicle.command_topic, 0))
            self.gathered.motions.append(motion)
            self.gathered.energies.append(energy)
            tracker = MissionTracker(vehicle, box, hold=asked)
            self.trackers.append(tracker)
            self._decode(truth, partial(_moved, motion, tracker), motion.stride)
            self._decode(vehicle.command_topic, partial(_asked, motion, tracker), asked)
            self._on_report(vitals, from_vitals, partial(_reported, energy, tracker))
            kept = [reading for s in vehicle.sensors if (reading := self._reading(s))]
            self.gathered.readings[vehicle.name] = kept
        self._by_topic = {stream.topic: stream for stream in self.gathered.completeness}
        for stream in self.gathered.completeness:
            stream.dropped(recording.dropped.get(stream.topic, 0))
            self._on_missing_readings(stream.sensor)
        for sensor in run.scenario.sensor_names():
            failures = SensorFaultHistory(sensor)
            self.gathered.failures.append(failures)
            self._on_report(faults_topic(sensor), from_faults, failures.add)
        self._decode(DIAGNOSTICS_TOPIC, self.gathered.diagnostics.add, 1)
        for topic, ros_type in recording.types.items():
            if ros_type in IMAGE_TYPES:
                camera = CameraThumbnails(topic, recording.first_nanos, recording.last_nanos)
                self._on_images(topic, camera)

    def take(self, message: RecordedMessage) -> None:
        self._streams[message.topic].add(message.nanos, len(message.cdr))
        if stream := self._by_topic.get(message.topic):
            stream.add(message.nanos - self.gathered.run.epoch_nanos)
        if handler := self._handlers.get(message.topic):
            try:
                handler(message)
            except (SerdeError, ValueError, AttributeError, IndexError):
                self.gathered.undecodable += 1

    def _decode(self, topic: str, use: Callable[[float, Any], object], every: int) -> None:
        """Decode every n-th message of a topic and pass it on with its time."""
        stream = self._streams.get(topic)
        if stream is None:
            return

        def handler(message: RecordedMessage) -> None:
            if (stream.messages - 1) % every == 0:
                use(self.gathered.seconds(message.nanos), _decoded(message))

        self._handlers[topic] = handler

    def _reading(self, sensor: SensorSpec) -> Readings | None:
        """Return the plotted readings of a sensor, if it has a plot and was recorded."""
        run = self.gathered
        middle = (run.seconds(run.first_nanos) + run.seconds(run.last_nanos)) / 2
        reading = readings_of(sensor, run.run.scenario.world.datum, middle)
        stream = None if reading is None else self._streams.get(reading.topic)
        if reading is None or stream is None:
            return None
        if isinstance(reading, CloudSample):
            self._handlers[reading.topic] = lambda message: self._cloud(reading, message)
        else:
            counted = self._counted.get(reading.topic, 0)
            self._decode(reading.topic, reading.add, -(-counted // MAX_SAMPLES) or 1)
        return reading

    def _cloud(self, cloud: CloudSample, message: RecordedMessage) -> None:
        """Decode a cloud only where it is shown."""
        seconds = self.gathered.seconds(message.nanos)
        if cloud.is_due(seconds):
            cloud.add(seconds, _decoded(message))

    def _on_report(
        self, topic: str, read: Callable[[Any], Any], use: Callable[[float, Any], object]
    ) -> None:
        """Pass every message of a topic on as `read` returns it."""
        self._decode(topic, lambda seconds, array: use(seconds, read(array)), 1)

    def _on_missing_readings(self, sensor: str) -> None:
        def use(seconds: float, array: Any) -> None:
            report = from_missing_readings(array)
            for stream in self.gathered.completeness:
                if stream.sensor == sensor:
                    stream.add_report(report, self.gathered.run.epoch_nanos)

        self._decode(missing_readings_topic(sensor), use, 1)

    def _on_images(self, topic: str, camera: CameraThumbnails) -> None:
        self.gathered.cameras.append(camera)

        def handler(message: RecordedMessage) -> None:
            if camera.is_due(message.nanos):
                camera.add(self.gathered.seconds(message.nanos), _decoded(message))

        self._handlers[topic] = handler


def _moved(motion: VehicleMotion, tracker: MissionTracker, seconds: float, odometry: Any) -> None:
    """Take a nav_msgs/Odometry of the ground truth."""
    motion.moved(seconds, odometry)
    pose = odometry.pose.pose
    place, turn = pose.position, pose.orientation
    tracker.moved(seconds, (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))


def _asked(motion: VehicleMotion, tracker: MissionTracker, seconds: float, twist: Any) -> None:
    """Take a geometry_msgs/Twist."""
    motion.was_asked(seconds, twist)
    tracker.commanded(seconds, twist.linear.x, twist.angular.z)


def _reported(energy: Energy, tracker: MissionTracker, seconds: float, vitals: Vitals) -> None:
    """Take the vitals."""
    energy.add(seconds, vitals)
    tracker.touched(seconds, (contact.name for contact in vitals.contacts))
    if vitals.has_drowned:
        tracker.drowned()


def _decoded(message: RecordedMessage) -> Any:
    return STORE.deserialize_cdr(message.cdr, message.ros_type)
