# SPDX-License-Identifier: Apache-2.0
"""Foxglove server: serves a run's ROS 2 topics over the Foxglove WebSocket protocol.

Topics, types and bytes are those that ROS gets (`groundlink.ros.cdr`); `/ground_truth/tf` is added,
as in a recording. Messages are encoded only while a client subscribes to them. Messages that seldom
change, including the map, are sent again to each new subscriber.
"""

from collections.abc import Mapping, Sequence

from foxglove import Channel, Context, Schema, start_server
from foxglove.channels import SceneUpdateChannel
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from groundlink.core.errors import UserError
from groundlink.messages.base import BadBusMessage, BusMessage, Clock, Health, State
from groundlink.messages.navigation import OccupancyGrid, Transforms
from groundlink.ros.base import Bases
from groundlink.ros.cdr import ros_type_of, to_cdr
from groundlink.ros.streams import TRUE_TF_TOPIC, RosStream, actor_transforms
from groundlink.ros.types import DEFINITION_ENCODING, MESSAGE_ENCODING, definition
from groundlink.scenario import Scenario

from .foxglove_scene import scene

SCENE_TOPIC = "/scene"

BACKLOG = 256
"""Messages that wait for one slow client, about 0.5 s; beyond it the oldest are dropped."""


class FoxgloveServer(ServerListener):
    """Serves a run to Foxglove and compatible clients."""

    def __init__(
        self, scenario: Scenario, run: str, streams: Mapping[str, RosStream], host: str, port: int
    ) -> None:
        self._scenario = scenario
        self._context = Context()
        self._channels = {
            path: self._channel(stream.topic, stream.message, stream.ros_type)
            for path, stream in streams.items()
        }
        self._bases = Bases(scenario, run, truth=True)
        derived: dict[str, type[BusMessage]] = {p.topic: p.message for p in self._bases.topics}
        derived |= {TRUE_TF_TOPIC: Transforms, **self._bases.latched}
        self._derived = {topic: self._channel(topic, message) for topic, message in derived.items()}
        self._scene = SceneUpdateChannel(SCENE_TOPIC, context=self._context)
        maps = {s.topic for s in streams.values() if s.message is OccupancyGrid}
        self._latched = {SCENE_TOPIC, *self._bases.latched, *maps}
        self._maps: dict[str, OccupancyGrid] = {}
        self._epoch_nanos: int | None = None
        self._newest_nanos = self._scene_nanos = 0
        self._is_owed = True
        self.refused = 0
        """Messages that do not fit their ROS type."""

        try:
            self._server = start_server(
                name=f"Groundlink: {run}",
                host=host,
                port=port,
                capabilities=[Capability.Time],
                server_listener=self,
                context=self._context,
                session_id=run,
                message_backlog_size=BACKLOG,
            )
        except Exception as error:
            raise UserError(
                f"cannot serve on {host}:{port}: {error}. Fix: choose another port with --port"
            ) from (None)

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._server.port

    def change(self, scenario: Scenario) -> None:
        """Serve another world from now on."""
        self._scenario = scenario
        self._scene_nanos = self._newest_nanos
        self._is_owed = True

    def take_states(self, states: Sequence[State]) -> None:
        """Record the run's epoch and publish the poses of actors."""
        if not states:
            return
        newest = states[-1]
        self._newest_nanos = newest.stamp_nanos
        if newest.epoch_nanos != self._epoch_nanos:
            self._bases.restart()
            self._epoch_nanos = self._scene_nanos = newest.epoch_nanos
            self._is_owed = True
        if newest.actors and self._scenario.world.actors:
            self._log(self._derived[TRUE_TF_TOPIC], actor_transforms(self._scenario, newest))

    def begin_again(self) -> None:
        """Do nothing: clients place messages themselves."""

    def take(self, path: str, stream: RosStream, message: BusMessage) -> None:
        """Serve a message under its ROS topic."""
        if isinstance(message, Clock):
            self._server.broadcast_time(message.stamp_nanos)
        for topic, derived, _ in self._bases.receive(stream.key, message):
            self._log(self._derived[topic], derived)
        if isinstance(message, OccupancyGrid):
            self._maps[path] = message
        self._log(self._channels[path], message)

    def take_health(self, health: Health, now_seconds: float) -> None:
        """Do nothing: there is no ROS topic for it."""

    def show_text(self, text: str) -> None:
        """Do nothing: there is no ROS topic for it."""

    def flush(self) -> None:
        """Publish messages that seldom change, if there is a new subscriber."""
        if self._is_owed and self._epoch_nanos is not None:
            self._is_owed = False
            for topic, derived, _ in self._bases.still(self._epoch_nanos):
                self._log(self._derived[topic], derived)
            for path, message in self._maps.items():
                self._log(self._channels[path], message)
            stamp_nanos = self._scene_nanos
            self._scene.log(scene(self._scenario, stamp_nanos), log_time=stamp_nanos)

    def alive(self) -> bool:
        """Return True: a server has no window to close."""
        return True

    def counters(self) -> dict[str, int]:
        """Return counters for health."""
        return {"not_served": self.refused}

    def close(self) -> None:
        """End it."""
        self._server.stop()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Record a new subscriber of a latched topic; called on the server's thread."""
        if channel.topic in self._latched:
            self._is_owed = True

    def _channel(self, topic: str, message: type[BusMessage], relayed_type: str = "") -> Channel:
        name = ros_type_of(message, relayed_type)
        schema = Schema(name=name, encoding=DEFINITION_ENCODING, data=definition(name).encode())
        return Channel(
            topic, schema=schema, message_encoding=MESSAGE_ENCODING, context=self._context
        )

    def _log(self, channel: Channel, message: BusMessage) -> None:
        if not channel.has_sinks():
            return
        try:
            cdr = bytes(to_cdr(message))
        except BadBusMessage:
            self.refused += 1
            return
        stamp: int = message.stamp_nanos  # type: ignore[attr-defined]
        channel.log(cdr, log_time=stamp)
