# SPDX-License-Identifier: Apache-2.0
"""A Foxglove client plays and seeks a recording; what it subscribes to is simulated."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from groundlink.core.errors import UserError
from groundlink.recording import repeated_run
from groundlink.recording.reader import RecordedMessage, Recording
from services.view.recorded.foxglove_playback import FoxglovePlayback
from services.view.recorded.show import ViewedRecording
from tests.services.view.foxglove_client import BUFFERING, ENDED, PAUSED, Client, joined

from .test_show import EVERY_KIND, with_second_imu

HALF = 300_000_000


class Simulation:
    """A simulation that stops at an instant until it may go on."""

    def __init__(self) -> None:
        self.begun = 0
        self.goes_on = threading.Event()

    @contextmanager
    def simulated(self, recording: Recording, *_: object) -> Iterator[Iterator[RecordedMessage]]:
        self.begun += 1
        yield self._messages(recording)

    def _messages(self, recording: Recording) -> Iterator[RecordedMessage]:
        for message in recording.read(["/imu"]):
            if message.nanos > recording.first_nanos + HALF:
                assert self.goes_on.wait(20)
            yield message._replace(topic="/second")


@pytest.fixture
def simulation(monkeypatch: pytest.MonkeyPatch) -> Simulation:
    made = Simulation()
    monkeypatch.setattr(repeated_run, "simulated", made.simulated)
    return made


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def playback(
    simulation: Simulation, lines: list[str], tmp_path: Path
) -> Iterator[FoxglovePlayback]:
    with Recording(EVERY_KIND) as recording:
        run = ViewedRecording(recording, with_second_imu(recording.run.scenario, tmp_path))
        served = FoxglovePlayback(recording, run, tmp_path, "127.0.0.1", 0, lines.append)
        try:
            yield served
        finally:
            simulation.goes_on.set()
            served.close()


def until(
    playback: FoxglovePlayback, client: Client, there: Callable[[], object], seconds: float = 0.0
) -> None:
    """Turn and read until something is there; `seconds` of play pass with each turn."""
    end = time.monotonic() + 20
    while not there():
        assert time.monotonic() < end, (client.states, client.got[-3:])
        playback.turn(seconds)
        client.read(quiet=0.02)


def stamps(client: Client, topic: str) -> list[int]:
    return [stamp for name, stamp, _ in client.got if name == topic]


def recorded(topic: str) -> list[int]:
    with Recording(EVERY_KIND) as recording:
        return [message.nanos for message in recording.read([topic])]


def test_recorded_topic_is_played_whole_and_in_order(
    playback: FoxglovePlayback, simulation: Simulation
) -> None:
    with joined(playback.port) as client:
        client.subscribe("/imu", "/tf_static")
        until(playback, client, lambda: stamps(client, "/tf_static"))
        assert stamps(client, "/imu") == [], "paused at the start"
        client.control(play=True)
        until(playback, client, lambda: (ENDED, playback.end_nanos) in client.states, 0.05)
        assert stamps(client, "/imu") == recorded("/imu")
    assert simulation.begun == 0


def test_seek_sends_the_newest_message_and_goes_on_from_there(playback: FoxglovePlayback) -> None:
    imu = recorded("/imu")
    middle = imu[20] + 1000
    with joined(playback.port) as client:
        client.subscribe("/imu", "/tf_static")
        until(playback, client, lambda: stamps(client, "/tf_static"))
        client.control(play=False, seek_nanos=middle)
        until(playback, client, lambda: stamps(client, "/imu"))
        assert stamps(client, "/imu") == [imu[20]]
        client.control(play=True)
        until(playback, client, lambda: imu[-1] in stamps(client, "/imu"), 0.05)
        assert stamps(client, "/imu") == imu[20:]


def test_sensor_is_simulated_when_a_client_subscribes_and_playback_waits_for_it(
    playback: FoxglovePlayback, simulation: Simulation
) -> None:
    imu = recorded("/imu")
    with joined(playback.port) as client:
        assert "/second" in client.channels
        assert simulation.begun == 0
        client.subscribe("/second", "/imu")
        client.control(play=True)
        until(
            playback,
            client,
            lambda: stamps(client, "/second") and client.states[-1][0] == BUFFERING,
            0.05,
        )
        half = imu[0] + HALF
        assert simulation.begun == 1
        assert max(stamps(client, "/second")) <= half
        assert max(stamps(client, "/imu")) <= half, "nothing goes on alone"
        simulation.goes_on.set()
        until(playback, client, lambda: (ENDED, playback.end_nanos) in client.states, 0.05)
        assert list(dict.fromkeys(stamps(client, "/second"))) == imu
        client.control(play=False, seek_nanos=imu[5])
        until(playback, client, lambda: stamps(client, "/second")[-1] == imu[5])
    assert simulation.begun == 1


def test_paused_client_gets_the_newest_message_once_it_is_simulated(
    playback: FoxglovePlayback, simulation: Simulation
) -> None:
    late = recorded("/imu")[-5]
    with joined(playback.port) as client:
        client.subscribe("/second")
        client.control(play=False, seek_nanos=late)
        until(playback, client, lambda: (BUFFERING, late) in client.states)
        assert late not in stamps(client, "/second")
        simulation.goes_on.set()
        until(playback, client, lambda: late in stamps(client, "/second"))
        until(playback, client, lambda: client.states[-1] == (PAUSED, late))


def test_playback_goes_on_without_a_sensor_that_cannot_be_simulated(
    playback: FoxglovePlayback, lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise UserError("no camera here")

    monkeypatch.setattr(repeated_run, "simulated", failing)
    with joined(playback.port) as client:
        client.subscribe("/second", "/imu")
        client.control(play=True)
        until(playback, client, lambda: (ENDED, playback.end_nanos) in client.states, 0.05)
        assert stamps(client, "/imu")[-1] == recorded("/imu")[-1]
        assert stamps(client, "/second") == []
    assert "view: cannot simulate rover/second: no camera here" in lines


def test_port_in_use_is_one_line(
    playback: FoxglovePlayback, simulation: Simulation, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, Recording(EVERY_KIND) as recording:
        run = ViewedRecording(recording, with_second_imu(recording.run.scenario, tmp_path))
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match="Fix: choose another port"):
            FoxglovePlayback(recording, run, tmp_path, "127.0.0.1", port, print)
