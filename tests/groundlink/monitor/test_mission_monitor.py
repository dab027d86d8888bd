# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus become missions, episode by episode."""

from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.bus.topics import WHEEL_COMMAND
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.mission import STUCK
from groundlink.loader import load
from groundlink.messages.base import BusMessage, Command, WheelCommand, encode, packed
from groundlink.messages.ground_truth import Contact, Vitals
from groundlink.messages.navigation import JointState, Odometry
from groundlink.monitor.mission_monitor import MissionMonitor
from groundlink.scenario import Scenario
from groundlink.scenario.schema import World
from groundlink.world.solids import Box, Solid

EPOCH = 1_700_000_000 * NANOS
ZERO3 = (0.0, 0.0, 0.0)
NO_ERROR = packed(np.zeros(36))
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class StandInBus:
    """Hands messages to inboxes as Zenoh does."""

    def __init__(self, present: Scenario | None = None) -> None:
        self.present = present
        self.inboxes: dict[str, tuple[type[BusMessage], object]] = {}

    def subscribe(self, key: str, message: type[BusMessage], inbox: object) -> None:
        self.inboxes[key] = message, inbox

    def query(self, key: str, *, seconds: float) -> dict[str, bytes]:
        assert key == "groundlink/lab/scenario"
        return {} if self.present is None else {key: msgspec.msgpack.encode(self.present)}

    def send(self, key: str, message: BusMessage) -> None:
        message_type, inbox = self.inboxes[f"groundlink/lab/{key}"]
        assert type(message) is message_type
        inbox.put(key, encode(message), message_type)  # type: ignore[attr-defined]


def vitals(tick: int, touched: Sequence[str] = (), epoch: int = EPOCH) -> Vitals:
    contacts = tuple(Contact(name, 1.0, tick, 1) for name in touched)
    return Vitals(epoch + tick * TICK_NANOS, "rover", tick, 0.0, 0.0, contacts)


def truth(tick: int, x_m: float, epoch: int = EPOCH) -> Odometry:
    stamp, place = epoch + tick * TICK_NANOS, (x_m, 0.0, 0.2)
    frames = ("world", "base_link")
    return Odometry(stamp, *frames, place, UPRIGHT, ZERO3, ZERO3, NO_ERROR, NO_ERROR)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load("indoor_lab")


def run_of(
    monitor: MissionMonitor,
    seconds: int,
    command: BusMessage,
    epoch: int = EPOCH,
    present: Scenario | None = None,
) -> None:
    """Let the rover stand at a wall for some time, under commands."""
    bus = StandInBus(present)
    monitor.subscribe(bus, "lab")  # type: ignore[arg-type]
    keys = {WheelCommand: "rover/command/wheels", JointState: "rover/command/joints/**"}
    key = keys.get(type(command), "rover/command")
    for tick in range(0, 400 * seconds, 40):
        stamp = epoch + tick * TICK_NANOS
        bus.send("rover/vitals", vitals(tick, ["wall_2"], epoch))
        bus.send(key, replace(command, stamp_nanos=stamp))  # type: ignore[type-var]
        bus.send("rover/ground_truth", truth(tick, 1.5, epoch))
    monitor.update()


AHEAD = Command(0, (0.5, 0.0, 0.0), ZERO3)


@pytest.mark.parametrize(
    "command",
    [
        AHEAD,
        WheelCommand(
            0,
            {f"{end}_{side}_wheel": 3.0 for end in ("front", "rear") for side in ("left", "right")},
        ),
        JointState(
            *(0, "", ("front_left_wheel", "front_right_wheel", "rear_left_wheel", "gripper")),
            *(memoryview(b""), packed(np.full(4, 3.0)), memoryview(b"")),
        ),
    ],
)
def test_a_vehicle_at_a_wall_is_stuck(scenario: Scenario, command: BusMessage) -> None:
    monitor = MissionMonitor(scenario)
    assert monitor.missions() == []
    run_of(monitor, 10, command)
    (mission,) = monitor.missions()
    assert mission.state == STUCK
    assert mission.ending
    assert mission.ending.touching == ("wall_2",)
    assert mission.seconds == pytest.approx(9.9)
    assert mission.to_builtins()["failure"] == mission.failure()


@pytest.mark.parametrize("epoch", [EPOCH, EPOCH + 10 * NANOS])
def test_a_reset_begins_a_new_mission(scenario: Scenario, epoch: int) -> None:
    monitor = MissionMonitor(scenario)
    run_of(monitor, 10, AHEAD)
    run_of(monitor, 2, AHEAD, epoch)
    (mission,) = monitor.missions()
    assert (mission.state, mission.events) == ("driving", ())
    assert mission.seconds == pytest.approx(1.9)


def test_an_episode_in_a_loaded_world_is_judged_by_that_world(scenario: Scenario) -> None:
    """At x = 1.5 m, the rover is in the room, but beyond the edge of a small platform."""
    monitor = MissionMonitor(scenario)
    run_of(monitor, 2, AHEAD)
    platform = Solid("platform", Box(size_m=(1.0, 1.0, 1.0)), "linoleum", (-5.0, 0.0, -0.5))
    world = World(name="small", materials=scenario.world.materials, solids=(platform,))
    for present, is_gone in ((replace(scenario, world=world), True), (scenario, False)):
        run_of(monitor, 2, AHEAD, EPOCH + NANOS * (1 + is_gone), present)
        (mission,) = monitor.missions()
        assert bool(mission.ending) == is_gone, mission


def test_a_removed_vehicle_is_left_out() -> None:
    rovers = load("two_rovers")
    monitor = MissionMonitor(rovers)
    bus = StandInBus()
    monitor.subscribe(bus, "lab")  # type: ignore[arg-type]
    for tick in range(0, 4000, 40):
        for name in ("first", "second") if tick < 2000 else ("first",):
            bus.send(f"{name}/vitals", vitals(tick))
            bus.send(f"{name}/ground_truth", truth(tick, 0.0))
    monitor.update()
    assert [mission.vehicle for mission in monitor.missions()] == ["first"]
    assert f"groundlink/lab/second/{WHEEL_COMMAND.key.partition('/')[2]}" in bus.inboxes
