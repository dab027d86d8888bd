# SPDX-License-Identifier: Apache-2.0
"""What a recorder of a stepped run acknowledges, and when; on a bus without other processes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from groundlink.bus.core_topics import Delivery
from groundlink.bus.inbox import BusInbox
from groundlink.core.clock import TICK_NANOS
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import (
    Ack,
    BusMessage,
    Clock,
    Command,
    Imu,
    State,
    VehicleState,
    encode,
)
from groundlink.recording.reader import Recording
from groundlink.scenario import Scenario
from groundlink.scenario.route import Circle
from groundlink.sim.sim_time import as_stepped
from services.recorder.ordered_mcap_files import OrderedMcapFiles
from services.recorder.recorder import Recorder, participants
from services.recorder.runner import BusRecorder

RUN = "lab"
EPOCH = 10**18
EPISODE = 7
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def lab() -> Scenario:
    """Return the default scenario, stepped, with its IMU alone."""
    scenario = load(str(SHIPPED / "indoor_lab.yaml"))
    (rover,) = scenario.vehicles
    imu = tuple(sensor for sensor in rover.sensors if sensor.name == "imu")
    return as_stepped(replace(scenario, vehicles=(replace(rover, sensors=imu),)))


class StandInBus:
    """Delivers what the test publishes, in order, and keeps what the recorder publishes."""

    def __init__(self) -> None:
        self.published: list[BusMessage] = []

    def subscribe_in_order(
        self,
        key: str,
        type_of: Callable[[str], type[BusMessage] | None],
        inbox: BusInbox[BusMessage],
    ) -> None:
        self._type_of, self._inbox = type_of, inbox

    def deliver(self, key: str, message: BusMessage) -> None:
        key = f"groundlink/{RUN}/{key}"
        assert self._type_of(key) is type(message)
        self._inbox.put(key, encode(message), type(message))

    def publisher(self, key: str, delivery: Delivery) -> Callable[[BusMessage], Any]:
        return self.published.append

    def query(self, key: str, parameters: str, *, seconds: float) -> dict[str, bytes]:
        return {}

    def announce(self, key: str) -> None:
        pass

    def is_connected(self) -> bool:
        return True

    def reconnects(self) -> int:
        return 0

    def present(self, key: str, *, seconds: float) -> set[str]:
        return set()

    def acknowledged(self) -> tuple[int, int]:
        """Return tick and settled tick of the newest acknowledgement."""
        *_, last = (message for message in self.published if isinstance(message, Ack))
        return last.tick, last.settled_tick


class Script:
    """In place of the event that ends a recorder: a step of the test each time that it rests."""

    def __init__(self, *steps: Callable[[], None]) -> None:
        self._steps = list(steps)

    def wait(self, seconds: float) -> bool:
        self._steps.pop(0)()
        return not self._steps


def state(tick: int) -> State:
    rover = VehicleState(*(memoryview(b"") for _ in range(4)))
    return State(RUN, EPISODE, EPOCH, tick, tick * TICK_NANOS, "", {"rover": rover})


def test_what_comes_after_the_clock_is_waited_for(lab: Scenario, tmp_path: Path) -> None:
    """Physics, sensor and program send their last messages after the recorder has the clock."""
    bus, files = StandInBus(), OrderedMcapFiles(tmp_path / "run.mcap", lab, RUN, lambda _: b"")
    recorder = BusRecorder(bus, lab, RUN, files, None, ordered=True)  # type: ignore[arg-type]
    last = 4 * lab.time.ack_ticks
    stamp = EPOCH + last * TICK_NANOS

    def clock() -> None:
        for tick in (0, last):
            bus.deliver("clock", Clock(EPOCH + tick * TICK_NANOS, EPOCH, tick, EPISODE))

    def physics() -> None:
        assert bus.acknowledged() == (last, -1)
        bus.deliver("state", state(last))

    def imu() -> None:
        assert bus.acknowledged() == (last, -1)
        sample = Imu(stamp, "imu_link", UPRIGHT, STILL, STILL, 0, 0, 0)
        bus.deliver("rover/imu", sample)
        bus.deliver("ack/rover/imu", Ack(EPISODE, last, last - 1))

    def program() -> None:
        assert bus.acknowledged() == (last, -1)
        bus.deliver("rover/command", Command(stamp, STILL, STILL))
        bus.deliver("ack/gateway", Ack(EPISODE, last - 1, last))

    def end() -> None:
        assert bus.acknowledged() == (last, last)

    recorder.record(Script(clock, physics, imu, program, end))  # type: ignore[arg-type]
    with Recording(files.path) as recording:
        assert recording.topics["/imu"].messages == 1
        assert recording.topics["/cmd_vel"].messages == 1


def test_a_removed_vehicle_sends_nothing_more(lab: Scenario, tmp_path: Path) -> None:
    files = OrderedMcapFiles(tmp_path / "run.mcap", lab, RUN, lambda _: b"")
    recorder = Recorder(lab, RUN, files.begin, acknowledging=participants(lab))
    recorder.take(f"groundlink/{RUN}/clock", Clock(EPOCH, EPOCH, 0, EPISODE))
    recorder.acknowledged("gateway", Ack(EPISODE, 8, 8))
    recorder.take_state(state(8))
    assert recorder.taken_tick(EPISODE, 8) == -1
    recorder.take_state(replace(state(8), vehicles={}))
    assert recorder.taken_tick(EPISODE, 8) == 8
    assert recorder.taken_tick(EPISODE + 1, 0) == -1
    files.finish(recorder)


def test_a_driver_is_silent_between_its_acknowledgements(lab: Scenario, tmp_path: Path) -> None:
    driven = replace(lab, vehicles=(replace(lab.vehicles[0], route=Circle()),))
    files = OrderedMcapFiles(tmp_path / "run.mcap", driven, RUN, lambda _: b"")
    driver = {"rover/driver": participants(driven)["rover/driver"]}
    recorder = Recorder(driven, RUN, files.begin, acknowledging=driver)
    recorder.take(f"groundlink/{RUN}/clock", Clock(EPOCH, EPOCH, 0, EPISODE))
    recorder.acknowledged("rover/driver", Ack(EPISODE, 16, 16))
    assert [recorder.taken_tick(EPISODE, tick) for tick in (20, 23, 24)] == [20, 23, 23]
    files.finish(recorder)
