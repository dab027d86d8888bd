# SPDX-License-Identifier: Apache-2.0
"""Foxglove server of a recorded run: the client plays, pauses and seeks.

Sensors that were not recorded are simulated when a client subscribes to one of their topics. While
playback is ahead of the simulation, it waits and reports `Buffering`.
"""

import math
import threading
from collections.abc import Callable
from pathlib import Path

from foxglove import Channel, Context, Schema, start_server
from foxglove.channels import SceneUpdateChannel
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
    StatusLevel,
)

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.recording import resimulation
from groundlink.recording.reader import RecordedMessage, Recording
from groundlink.recording.repeated_readings import RepeatedReadings
from groundlink.ros.types import DEFINITION_ENCODING, MESSAGE_ENCODING, definition
from services.view.foxglove_scene import scene
from services.view.foxglove_server import SCENE_TOPIC

from .show import ViewedRecording
from .simulated_file import MessageWindows, SimulatedFile

BEFORE_NANOS = NANOS
"""After a seek, the newest message of each topic of this time is sent."""

FRAME_SECONDS = 1 / 30


class FoxglovePlayback(ServerListener):
    """Serves a recorded run to Foxglove and compatible clients.

    Parameters
    ----------
    folder
        folder for simulated files.
    say
        prints progress.
    """

    def __init__(
        self,
        recording: Recording,
        recorded: ViewedRecording,
        folder: Path,
        host: str,
        port: int,
        say: Callable[[str], object],
    ) -> None:
        self._say, self._scenario = say, recorded.scenario
        self._first = recording.first_nanos
        self.end_nanos = resimulation.end_nanos(recording) - 1
        """Stamp at which playback ends."""

        plan, self._context = recorded.plan, Context()
        readings = RepeatedReadings(recorded.scenario, recorded.run, recording.run.epoch_nanos)
        types = {topic: recording.types[topic] for topic in plan.copied}
        types |= {
            topic: readings.types[topic]
            for topic in plan.simulated | plan.latched
            if topic in readings.types
        }
        self._channels = {topic: self._channel(topic, name) for topic, name in types.items()}
        self._scene = SceneUpdateChannel(SCENE_TOPIC, context=self._context)
        self._latched = list(readings.latched(self._first))
        self._latched_topics = {SCENE_TOPIC, *(message.topic for message in self._latched)}
        self._parts = [
            SimulatedFile(recording.path, recorded.scenario, part, folder, self._tell)
            for part in resimulation.separate_parts(plan, recorded.scenario)
        ]
        self._part_of = {topic: part for part in self._parts for topic in part.topics}
        self._recorded = MessageWindows(lambda: (Recording(recording.path), math.inf), plan.copied)
        self._windows = {part: MessageWindows(part.opened, part.topics) for part in self._parts}
        self._lock = threading.Lock()  # guards what is below: clients ask on the server's threads
        self._now = self._first
        self._is_playing, self._speed = False, 1.0
        self._sought = True
        self._is_owed = True
        self._status = PlaybackStatus.Paused
        try:
            self._server = start_server(
                name=f"Groundlink: {recording.path.name}",
                host=host,
                port=port,
                capabilities=[Capability.Time, Capability.PlaybackControl],
                server_listener=self,
                context=self._context,
                session_id=recorded.run,
                playback_time_range=(self._first, self.end_nanos),
            )
        except Exception as error:
            raise UserError(
                f"cannot serve on {host}:{port}: {error}. Fix: choose another port with --port"
            ) from None

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._server.port

    def run(self, stop: threading.Event, clock: Callable[[], float]) -> None:
        """Play until `stop` is set; `clock` returns seconds of a monotonic clock."""
        before = clock()
        while not stop.wait(FRAME_SECONDS):
            now = clock()
            self.turn(now - before)
            before = now

    def turn(self, seconds: float) -> None:
        """Send what is due after some more seconds of the wall clock."""
        with self._lock:
            known = self._known_nanos()
            after, has_sought, self._sought = self._now, self._sought, False
            if self._is_playing and not has_sought:
                wanted = min(self._now + round(seconds * self._speed * NANOS), self.end_nanos)
                self._now = max(self._now, min(wanted, known))
            status = self._status_now(known)
            is_owed, self._is_owed = self._is_owed, False
            now = self._now
        if is_owed:
            for message in self._latched:
                self._log(message)
            self._scene.log(scene(self._scenario, self._first), log_time=self._first)
        if has_sought:
            newest = {each.topic: each for each in self._between(now - BEFORE_NANOS, now)}
            for message in newest.values():
                self._log(message)
        elif now > after:
            for message in self._between(after, now):
                self._log(message)
        self._server.broadcast_time(now)
        if status != self._status:
            with self._lock:
                self._sought |= self._status == PlaybackStatus.Buffering  # and no more
                self._status = status
            state = PlaybackState(status, now, self._speed, did_seek=False, request_id=None)
            self._server.broadcast_playback_state(state)

    def close(self) -> None:
        """End it."""
        for part in self._parts:
            part.end()
        self._server.stop()
        for windows in (self._recorded, *self._windows.values()):
            windows.close()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Begin to simulate the sensor of a topic; called on the server's thread."""
        with self._lock:
            self._is_owed |= channel.topic in self._latched_topics
            if (part := self._part_of.get(channel.topic)) is not None:
                part.begin()
            self._sought = True  # the new subscriber gets the newest message, also while paused

    def on_playback_control_request(
        self, playback_control_request: PlaybackControlRequest
    ) -> PlaybackState:
        """Play, pause or seek; called on the server's thread."""
        request = playback_control_request
        with self._lock:
            self._is_playing = request.playback_command == PlaybackCommand.Play
            self._speed = request.playback_speed
            if request.seek_time is not None:
                self._now = min(max(request.seek_time, self._first), self.end_nanos)
                self._sought = True
            self._status = self._status_now(self._known_nanos())
            return PlaybackState(
                self._status,
                current_time=self._now,
                playback_speed=self._speed,
                did_seek=request.seek_time is not None,
                request_id=request.request_id,
            )

    def _known_nanos(self) -> int:
        """Return the stamp up to which all that clients subscribe to can be read."""
        return min([self.end_nanos, *(part.known_nanos for part in self._parts if part.is_begun)])

    def _status_now(self, known: int) -> PlaybackStatus:
        if self._now >= self.end_nanos:
            self._is_playing = False
            return PlaybackStatus.Ended
        if self._now >= known:
            return PlaybackStatus.Buffering
        return PlaybackStatus.Playing if self._is_playing else PlaybackStatus.Paused

    def _between(self, after: int, until: int) -> list[RecordedMessage]:
        """Return all messages of a span that can be read, by time."""
        found = self._recorded.between(after, until)
        for part in self._parts:
            if part.is_begun and (known := min(until, part.known_nanos)) > after:
                found += self._windows[part].between(after, known)
        return sorted(found, key=lambda message: message.nanos)

    def _channel(self, topic: str, ros_type: str) -> Channel:
        text = definition(ros_type).encode()
        schema = Schema(name=ros_type, encoding=DEFINITION_ENCODING, data=text)
        return Channel(
            topic, schema=schema, message_encoding=MESSAGE_ENCODING, context=self._context
        )

    def _log(self, message: RecordedMessage) -> None:
        channel = self._channels[message.topic]
        if channel.has_sinks():
            channel.log(message.cdr, log_time=message.nanos)

    def _tell(self, line: str) -> None:
        """Show progress in the client and in the terminal."""
        self._say(f"view: {line}")
        self._server.publish_status(line, StatusLevel.Info, "simulation")
