# SPDX-License-Identifier: Apache-2.0
"""What is recorded is shown first; simulated streams follow, placed by the same states."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from groundlink.messages.base import BusMessage, Health, State, measured_nanos
from groundlink.recording import repeated_run
from groundlink.recording.reader import RecordedMessage, Recording
from groundlink.ros.streams import RosStream
from groundlink.scenario import Scenario
from services.view.recorded.show import ViewedRecording

EVERY_KIND = Path(__file__).parents[4] / "tests" / "compatibility" / "every_kind.mcap"


class Seen:
    """A view that keeps what it gets; the user closes it in the middle of a pass."""

    def __init__(self, closes_in_pass: int = 0) -> None:
        self.passes: list[list[tuple[str, int]]] = [[]]
        self.stamps: list[list[int]] = [[]]
        self.texts: list[str] = []
        self._closes_in_pass = closes_in_pass

    def begin_again(self) -> None:
        self.passes.append([])
        self.stamps.append([])

    def take_states(self, states: Sequence[State]) -> None:
        self.stamps[-1] += [state.stamp_nanos for state in states]

    def take(self, path: str, stream: RosStream, message: BusMessage) -> None:
        self.passes[-1].append((path, measured_nanos(message)))

    def take_health(self, health: Health, now_seconds: float) -> None:
        raise AssertionError

    def show_text(self, text: str) -> None:
        self.texts.append(text)

    def flush(self) -> None:
        pass

    def alive(self) -> bool:
        return len(self.passes) != self._closes_in_pass or len(self.passes[-1]) < 20

    def counters(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        pass

    def change(self, scenario: Scenario) -> None:
        raise AssertionError


def with_second_imu(scenario: Scenario, folder: Path) -> Path:
    """Write the scenario with another IMU beside the first one."""
    vehicle = scenario.vehicles[0]
    (imu,) = (sensor for sensor in vehicle.sensors if sensor.name == "imu")
    second = replace(imu, name="second", topic="/second", seed=77)
    vehicles = (replace(vehicle, sensors=(*vehicle.sensors, second)), *scenario.vehicles[1:])
    file = folder / "scenario.msgpack"
    file.write_bytes(msgspec.msgpack.encode(replace(scenario, vehicles=vehicles)))
    return file


@contextmanager
def renamed(recording: Recording, *_: object) -> Iterator[Iterator[RecordedMessage]]:
    """Yield the messages of the recorded IMU as those of the second one."""
    yield (message._replace(topic="/second") for message in recording.read(["/imu"]))


@pytest.fixture(autouse=True)
def simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repeated_run, "simulated", renamed)


def test_recorded_streams_come_first_and_simulated_ones_after_them(tmp_path: Path) -> None:
    with Recording(EVERY_KIND) as recording:
        run = ViewedRecording(recording, with_second_imu(recording.run.scenario, tmp_path))
        seen = Seen()
        assert run.show(seen, threading.Event())
    name = recording.run.scenario.vehicles[0].name
    first, second = seen.passes
    imu = [nanos for path, nanos in first if path == f"{name}/imu"]
    assert len({path for path, _ in first}) > 10
    assert second == [(f"{name}/second", nanos) for nanos in imu]
    assert seen.stamps[0] == seen.stamps[1] != []
    assert f"{name}/second" in run.streams
    progress = [text.split("\n")[0] for text in seen.texts[1:]]
    assert progress[0] == f"**simulated {name}/second: 0 %**"
    assert progress[-1] == f"**simulated {name}/second: 100 %**"


def test_without_changes_there_is_one_pass() -> None:
    with Recording(EVERY_KIND) as recording:
        seen = Seen()
        assert ViewedRecording(recording, None).show(seen, threading.Event())
    assert len(seen.passes) == len(seen.texts) == 1


@pytest.mark.parametrize("passes", [1, 2])
def test_closed_viewer_ends_it(passes: int, tmp_path: Path) -> None:
    with Recording(EVERY_KIND) as recording:
        run = ViewedRecording(recording, with_second_imu(recording.run.scenario, tmp_path))
        seen = Seen(closes_in_pass=passes)
        assert not run.show(seen, threading.Event())
    assert len(seen.passes) == passes
    assert len(seen.passes[-1]) in range(20, 40)
