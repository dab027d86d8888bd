# SPDX-License-Identifier: Apache-2.0
"""A viewer that falls behind keeps the newest and counts the rest."""

from typing import Any

from groundlink.bus.inbox import BusInbox
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import BusMessage, Clock, PointCloud, State, encode
from services.view.viewer_subscriptions import KEPT, ViewerSubscriptions

from .scenes import EPOCH, SCENARIO, state, truth


class StandInBus:
    """Has what of a bus is used; what is put under a key arrives at once."""

    def __init__(self) -> None:
        self.inboxes: dict[str, tuple[type[BusMessage], BusInbox[Any]]] = {}

    def subscribe(self, key: str, message_type: type[BusMessage], inbox: BusInbox[Any]) -> None:
        self.inboxes[key] = message_type, inbox

    def put(self, key: str, payload: bytes) -> None:
        message_type, inbox = self.inboxes[key]
        inbox.put(key, payload, message_type)


def test_the_newest_are_kept_few_of_what_is_large() -> None:
    bus = StandInBus()
    intake = ViewerSubscriptions(bus, SCENARIO, "run")  # type: ignore[arg-type]
    for tick in range(2 * KEPT[State]):
        bus.put("groundlink/run/state", encode(state(tick)))
    for stamp in range(10):
        cloud = PointCloud(stamp, "lidar_link", memoryview(bytes(22)))
        bus.put("groundlink/run/rover/lidar", encode(cloud))
    bus.put("groundlink/run/rover/imu", b"\xc1")
    states, got = intake.take()
    assert states[-1].tick == 2 * KEPT[State] - 1
    assert [m.stamp_nanos for _, _, m in got if isinstance(m, PointCloud)] == [7, 8, 9]
    assert {path for path, _, _ in got} == {"rover/lidar"}
    assert intake.counters() == {"dropped": KEPT[State] + 7, "refused": 1}
    assert intake.take() == ([], [])


def test_everything_that_ros_sees_is_subscribed_to() -> None:
    bus = StandInBus()
    ViewerSubscriptions(bus, SCENARIO, "run")  # type: ignore[arg-type]
    keys = {key.removeprefix("groundlink/run/") for key in bus.inboxes}
    assert keys == {
        *("state", "health/**", "clock", "rover/lidar", "rover/imu", "rover/encoders"),
        *("rover/camera", "rover/camera/camera_info"),
        *("rover/ground_truth", "rover/ground_truth/wheels", "bodies"),
        *("rover/command", "rover/from_ros/pose", "rover/from_ros/map"),
    }


def test_a_replay_is_drawn_by_its_ground_truth() -> None:
    bus = StandInBus()
    intake = ViewerSubscriptions(bus, SCENARIO, "run")  # type: ignore[arg-type]
    bus.put("groundlink/run/clock", encode(Clock(EPOCH + TICK_NANOS, EPOCH, 1, EPOCH)))
    bus.put("groundlink/run/rover/ground_truth", encode(truth(1)))
    states, messages = intake.take()
    assert [(s.stamp_nanos, s.epoch_nanos, [*s.vehicles]) for s in states] == [
        (EPOCH + TICK_NANOS, EPOCH, ["rover"])
    ]
    assert {path for path, _, _ in messages} == {"clock", "rover/ground_truth"}


def test_where_physics_tells_states_none_are_made() -> None:
    bus = StandInBus()
    intake = ViewerSubscriptions(bus, SCENARIO, "run")  # type: ignore[arg-type]
    bus.put("groundlink/run/clock", encode(Clock(EPOCH, EPOCH, 0, EPOCH)))
    bus.put("groundlink/run/state", encode(state(0)))
    bus.put("groundlink/run/rover/ground_truth", encode(truth(8)))
    states, _ = intake.take()
    assert [state.tick for state in states] == [0]
    bus.put("groundlink/run/rover/ground_truth", encode(truth(16)))
    cloud = PointCloud(EPOCH, "lidar_link", memoryview(bytes(22)))
    bus.put("groundlink/run/rover/lidar", encode(cloud))
    states, messages = intake.take()
    assert states == []
    assert cloud in [message for _, _, message in messages]
