# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of a viewer: all streams that ROS gets, states and health.

Nothing is acknowledged, so no process waits for a viewer. Each stream has an inbox that keeps the
newest messages, few of large ones. States of a replay are reconstructed from the ground truth.
"""

from collections.abc import Iterator
from typing import Any

from groundlink.bus.core_topics import HEALTH, STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import BusMessage, Health, Imu, M, PointCloud, Relayed, State
from groundlink.messages.ground_truth import LabeledPoints, TruePoints
from groundlink.messages.imagery import CompressedImage, Image
from groundlink.messages.navigation import OccupancyGrid
from groundlink.ros.streams import RosStream, incoming, outgoing
from groundlink.scenario import Scenario
from groundlink.scenario.rotating_lidar import RotatingLidar

from .reconstructed_states import ReceivedMessage, StateReconstructor

KEPT: dict[type[BusMessage], int] = {
    State: 1000,
    Imu: 1000,
    PointCloud: 3,
    TruePoints: 3,
    LabeledPoints: 3,
    Image: 3,
    CompressedImage: 6,
    OccupancyGrid: 1,
    Relayed: 6,
}
"""Messages of a stream that may wait, by type: 2.5 s of states."""

KEPT_OF_OTHERS = 200


def streams_of(scenario: Scenario, run: str) -> dict[str, RosStream]:
    """Return the streams of a run that ROS gets, by their key without the run."""
    every = [*outgoing(scenario, run), *incoming(scenario, run)]
    return {stream.key.split("/", 2)[2]: stream for stream in every}


class ViewerSubscriptions:
    """The inboxes of one viewer."""

    def __init__(self, bus: Bus, scenario: Scenario, run: str) -> None:
        self.streams = streams_of(scenario, run)
        self._states: BusInbox[State] = BusInbox(depth=KEPT[State])
        self._truth: StateReconstructor | None = StateReconstructor(scenario, run)
        self._health: BusInbox[Health] = BusInbox(depth=KEPT_OF_OTHERS)
        self._boxes: dict[str, BusInbox[BusMessage]] = {}
        bus.subscribe(STATE.key_in(run), State, self._states)
        bus.subscribe(HEALTH.key_in(run), Health, self._health)
        for path, stream in self.streams.items():
            depth = KEPT.get(stream.message, KEPT_OF_OTHERS)
            if stream.message in (PointCloud, TruePoints, LabeledPoints):
                depth *= _blocks(scenario, "/".join(path.split("/")[:2]))
            box = self._boxes[path] = BusInbox[BusMessage](depth=depth)
            bus.subscribe(stream.key, stream.message, box)

    def take(self) -> tuple[list[State], list[ReceivedMessage]]:
        """Return waiting states, and the messages of all streams that can be drawn."""
        came = [
            ReceivedMessage(path, self.streams[path], message)
            for path, box in self._boxes.items()
            for message in _waiting(box)
        ]
        states = list(_waiting(self._states))
        if states:
            self._truth = None
        return (states, came) if self._truth is None else self._truth.follow(came)

    def health(self) -> list[Health]:
        """Return waiting health messages."""
        return list(_waiting(self._health))

    def counters(self) -> dict[str, int]:
        """Return how many messages were dropped and refused."""
        boxes: list[BusInbox[Any]] = [self._states, self._health, *self._boxes.values()]
        return {
            "dropped": sum(box.dropped for box in boxes),
            "refused": sum(box.refused for box in boxes),
        }


def _waiting(box: BusInbox[M]) -> Iterator[M]:
    """Yield the messages that were waiting at the call."""
    for _ in range(len(box)):
        if (arrived := box.get(seconds=0)) is None:
            return
        yield arrived[1]


def _blocks(scenario: Scenario, path: str) -> int:
    found = scenario.sensor(path)
    if found is None or not isinstance(found[1], RotatingLidar):
        return 1
    return found[1].blocks_per_revolution
