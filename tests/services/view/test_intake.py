# SPDX-License-Identifier: Apache-2.0
"""A viewer that falls behind keeps the newest and counts the rest."""

from __future__ import annotations

from typing import Any

from groundlink.inbox import Inbox
from groundlink.messages import Message, PointCloud, State, encode
from services.view.intake import KEPT, Intake

from .scenes import SCENARIO, state


class StandInBus:
    """Has what of a bus is used; what is put under a key arrives at once."""

    def __init__(self) -> None:
        self.inboxes: dict[str, tuple[type[Message], Inbox[Any]]] = {}

    def subscribe(self, key: str, message_type: type[Message], inbox: Inbox[Any]) -> None:
        self.inboxes[key] = message_type, inbox

    def put(self, key: str, payload: bytes) -> None:
        message_type, inbox = self.inboxes[key]
        inbox.put(key, payload, message_type)


def test_the_newest_are_kept_few_of_what_is_large() -> None:
    bus = StandInBus()
    intake = Intake(bus, SCENARIO, "run")  # type: ignore[arg-type]
    for tick in range(2 * KEPT[State]):
        bus.put("groundlink/run/state", encode(state(tick)))
    for stamp in range(10):
        cloud = PointCloud(stamp, "lidar_link", memoryview(bytes(22)))
        bus.put("groundlink/run/rover/lidar", encode(cloud))
    bus.put("groundlink/run/rover/imu", b"\xc1")
    assert intake.states()[-1].tick == 2 * KEPT[State] - 1
    got = list(intake.messages())
    assert [m.stamp_nanos for _, _, m in got if isinstance(m, PointCloud)] == [7, 8, 9]
    assert {path for path, _, _ in got} == {"rover/lidar"}
    assert intake.counters() == {"dropped": KEPT[State] + 7, "refused": 1}
    assert intake.states() == []


def test_everything_that_ros_sees_is_subscribed_to() -> None:
    bus = StandInBus()
    Intake(bus, SCENARIO, "run")  # type: ignore[arg-type]
    keys = {key.removeprefix("groundlink/run/") for key in bus.inboxes}
    assert keys == {
        *("state", "health/**", "clock", "rover/lidar", "rover/imu", "rover/encoders"),
        *("rover/camera", "rover/camera/camera_info"),
        *("rover/ground_truth", "rover/ground_truth/wheels", "bodies"),
        *("rover/command", "rover/from_ros/pose", "rover/from_ros/map"),
    }
